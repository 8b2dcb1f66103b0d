"""Courses: what a row says, its values and means, and what makes no sense is refused at once."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from circuits import anatomy, table_reader
from circuits.declaration import table_writer
from circuits.declaration.courses import Course, extremes
from circuits.show import courses

TABLE = anatomy.spiking_msprt()
PULSE = Course("dopamine", 0.5, 20, 120, rise_ms=10, decay_ms=40, cite="assumed")
DRIVE = Course("STN", -0.2, to_ms=50)
TIMED = TABLE.with_rows(PULSE, DRIVE)
TIMES = st.floats(0, 300).map(lambda t: round(t, 2))
TAUS = st.sampled_from([0.0, 0.01, 3.0, 40.0, 5000.0])


@st.composite
def drawn_courses(draw):
    """Return a course of STN."""
    first = draw(TIMES)
    last = draw(st.one_of(st.just(math.inf), st.floats(0.01, 300).map(lambda t: first + t)))
    decay = 0.0 if math.isinf(last) else draw(TAUS)
    return Course("STN", draw(st.floats(-2, 2)), first, last, draw(TAUS), decay)


def test_a_course_rises_to_its_amount_and_decays_from_what_it_reached():
    at = PULSE.at(np.array([0, 20, 30, 119.99999, 120, 160, 1e4]))
    reached = 0.5 * (1 - math.exp(-10))
    expected = [0, 0, 0.5 * (1 - math.exp(-1)), reached, reached, reached / math.e, 0]
    np.testing.assert_allclose(at, expected, atol=1e-6)
    step = Course("STN", 0.3, 20, 30)
    np.testing.assert_array_equal(step.at(np.array([19.9, 20, 29.9, 30])), [0, 0.3, 0.3, 0])


@given(drawn_courses(), st.sampled_from([0.1, 0.5]))
def test_a_tick_holds_the_mean_of_the_course_in_it(course, dt_ms):
    ticks = 4000
    edges = np.arange(ticks + 1) * dt_ms
    # Where a course jumps or is fast the area is known in closed form alone: so between its edges.
    means = course.in_ticks(ticks, dt_ms)
    fine = (edges[:-1, None] + dt_ms * (np.arange(50) + 0.5) / 50).ravel()
    expected = course.at(fine).reshape(ticks, 50).mean(axis=1)
    steps = [e for e in (course.from_ms, course.to_ms) if math.isfinite(e)]
    near = np.abs(edges[:-1, None] + dt_ms / 2 - np.array(steps)).min(axis=1) < 1.5 * dt_ms
    np.testing.assert_allclose(means[~near], expected[~near], atol=1e-4)
    assert (np.abs(means) <= abs(course.amount) * (1 + 1e-9)).all()
    np.testing.assert_allclose(means[near], expected[near], atol=0.05 * abs(course.amount) + 1e-12)


@given(
    st.floats(0, 20).map(lambda t: round(t, 2)),
    st.sampled_from([20.0, 130.0, 185.0]),
    st.floats(0.05, 5.0).map(lambda t: round(t, 2)),
    st.sampled_from([0.1, 0.5, 1.0]),
)
def test_a_train_keeps_the_area_of_its_pulses_tick_by_tick(first, rate_hz, width, dt_ms):
    train = Course("STN", 0.8, first, 220.0, rate_hz=rate_hz, pulse_ms=width)
    pulses = train.in_ticks(round(220 / dt_ms), dt_ms)
    starts = np.arange(first, 220.0 - 1e-6, 1000 / rate_hz)
    each = (Course("STN", 0.8, start, min(start + width, 220.0)) for start in starts)
    wanted = sum(pulse.in_ticks(len(pulses), dt_ms) for pulse in each)
    np.testing.assert_allclose(pulses, wanted, atol=1e-6)


def test_a_train_is_on_within_its_pulses():
    train = Course("STN", 1.5, 10, 50, rate_hz=100, pulse_ms=2)
    at = train.at(np.array([9.9, 10, 11.9, 12, 19.9, 20, 21, 22, 49, 50, 50.5]))
    np.testing.assert_array_equal(at, [0, 1.5, 1.5, 0, 0, 1.5, 1.5, 0, 0, 0, 0])
    assert extremes([train])[1][0] == 1.5
    assert extremes([train])[0][0] == 0


def test_a_step_at_a_tick_is_there_in_that_tick_and_whole():
    step = Course("STN", 0.3, 0.7, 1.2).in_ticks(20, 0.1)
    np.testing.assert_array_equal(step, [0.3 if 7 <= k < 12 else 0 for k in range(20)])


@given(st.lists(drawn_courses(), min_size=1, max_size=4))
def test_extremes_are_those_of_the_sum(rows):
    (low, _), (high, at) = extremes(rows)
    dense = np.linspace(0, 600, 5000)
    total = np.sum([row.at(dense) for row in rows], axis=0)
    size = sum(abs(row.amount) for row in rows)
    assert low <= total.min() + 0.01 * size
    assert high >= total.max() - 0.01 * size
    assert math.isfinite(at)


def test_the_level_is_that_of_all_rows_together():
    first = Course("dopamine", 0.8, 0, 100)
    assert TABLE.with_rows(first, replace(first, from_ms=100, to_ms=200))
    assert TABLE.with_rows(first, replace(first, from_ms=50), Course("dopamine", -0.7, 50))
    slow = Course("dopamine", 5.0, 0, 10, rise_ms=100)
    assert slow.reached < 1
    assert TABLE.with_rows(slow)


def test_text_and_python_give_equal_courses():
    told = TABLE.edited(
        "add dopamine amount=0.5 from_ms=20 to_ms=120 rise_ms=10 decay_ms=40 cite=assumed",
        "add STN amount=-0.2 to_ms=50",
    )
    assert told == TIMED
    assert told.courses == (PULSE, DRIVE)
    assert TABLE.edited("add TRN like=STN", "add TRN amount=1").courses == (Course("TRN", 1.0),)


def test_text_and_python_give_equal_courses_of_one_channel(tmp_path):
    course = Course("STN[1]", -2.0, 200, 400)
    line = "add STN[1] amount=-2 from_ms=200 to_ms=400"
    circuit = TABLE.with_rows(course)
    for text_ in (line, line.replace("[1]", " [ 1]"), line.replace("=", " = ")):
        assert TABLE.edited(text_) == circuit
    assert table_reader.parse(table_writer.text(circuit), "mine.toml") == circuit
    assert list(courses(circuit)["course"]) == ["STN[1]"]
    edited = (TABLE.edited(f"add STN{k} amount=-2") for k in ("", "[0]", "[1]"))
    assert len(set(map(table_writer.digest, edited))) == 3


def test_courses_go_through_edits_and_are_taken_off():
    edited = TIMED.lesion("STN", 0.2).scale("D1->SNr", 0.9).dopamine(1.1).with_neurons(20)
    assert edited.courses == TIMED.courses
    assert TIMED.steady == TABLE
    assert TABLE.steady is TABLE
    assert edited.unlesioned.courses == TIMED.courses
    exact = anatomy.bogacz_gurney()
    assert exact.exact
    assert not exact.with_rows(DRIVE).exact


@given(st.lists(drawn_courses(), max_size=3))
def test_courses_come_back_from_a_file(rows):
    circuit = TABLE.with_rows(*rows)
    restored = table_reader.parse(table_writer.text(circuit), "mine.toml")
    assert restored == circuit
    assert table_writer.digest(restored) == table_writer.digest(circuit)
    assert (table_writer.digest(circuit) == table_writer.digest(TABLE)) == (not rows)
