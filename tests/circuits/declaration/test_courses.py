"""Courses: what a row says, its values and means, and what makes no sense is refused at once."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circuits import anatomy, table_reader
from circuits.cells import Rate
from circuits.declaration import table_writer
from circuits.declaration.courses import Course, extremes
from circuits.declaration.rows import Population
from circuits.engines import run
from circuits.show import courses, html, text
from tests.helpers import refused

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


@given(st.floats(0.001, 0.3), st.floats(0, 9))
def test_a_pulse_shorter_than_a_tick_keeps_its_area(width, first):
    course = Course("STN", 2.0, first, first + width)
    assert course.in_ticks(200, 0.5).sum() * 0.5 == pytest.approx(2 * width)


@given(
    st.floats(0, 20).map(lambda t: round(t, 2)),
    st.sampled_from([20.0, 130.0, 185.0]),
    st.floats(0.05, 5.0).map(lambda t: round(t, 2)),
    st.sampled_from([0.1, 0.5, 1.0]),
)
def test_a_train_keeps_the_area_of_its_pulses_tick_by_tick(first, rate_hz, width, dt_ms):
    train = Course("STN", 0.8, first, 220.0, rate_hz=rate_hz, pulse_ms=width)
    pulses = train.in_ticks(round(220 / dt_ms), dt_ms)
    starts = np.arange(first, 220.0, 1000 / rate_hz)
    each = sum(
        Course("STN", 0.8, start, min(start + width, 220.0)).in_ticks(len(pulses), dt_ms)
        for start in starts
        if start < 220.0 - 1e-6
    )
    np.testing.assert_allclose(pulses, each, atol=1e-6)


def test_a_train_is_on_within_its_pulses():
    train = Course("STN", 1.5, 10, 50, rate_hz=100, pulse_ms=2)
    at = train.at(np.array([9.9, 10, 11.9, 12, 19.9, 20, 21, 22, 49, 50, 50.5]))
    np.testing.assert_array_equal(at, [0, 1.5, 1.5, 0, 0, 1.5, 1.5, 0, 0, 0, 0])
    assert extremes([train])[1][0] == 1.5
    assert extremes([train])[0][0] == 0


def test_a_train_averages_to_a_constant_of_its_duty_cycle():
    """At 130 Hz STN's filter of 5 ms leaves little of the pulses: OUT is that of their mean."""
    drive = np.tile([0.6, -0.6], (1, 10, 1))
    pulses = anatomy.load_circuit("macaque").edited("add STN amount=2 rate_hz=130 pulse_ms=1")
    constant = anatomy.load_circuit("macaque").edited("add STN amount=0.26")
    out = [
        run(each, drive, engine="rate", step_ms=50.0).output_nats[0, 200:, 0].mean()
        for each in (pulses, constant)
    ]
    assert out[0] == pytest.approx(out[1], abs=0.02)


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


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"amount": math.nan}, "amount course of STN from 0 to inf ms: amount must be finite"),
        ({"amount": "much"}, "amount course of STN: amount must be a number, got 'much'"),
        ({"from_ms": -1}, "from_ms must be >= 0, when the drive begins, got -1"),
        ({"from_ms": math.inf}, "from_ms must be finite, got inf"),
        ({"from_ms": 5, "to_ms": 5}, "to_ms must come after from_ms, 5, got 5"),
        ({"to_ms": math.nan}, "to_ms must come after from_ms, 0, got nan"),
        ({"rise_ms": -1}, "rise_ms must be >= 0 and finite, got -1"),
        ({"to_ms": 5, "decay_ms": math.inf}, "decay_ms must be >= 0 and finite, got inf"),
        ({"decay_ms": 5}, "decay_ms without an end, to_ms, there is no decay_ms"),
        ({"rate_hz": 100.0}, "pulse_ms a train of pulses needs both"),
        ({"pulse_ms": 2.0}, "rate_hz a train of pulses needs both"),
        ({"rate_hz": 100.0, "pulse_ms": 10.0}, "pulse_ms must be shorter than the period, 10 ms"),
        ({"rate_hz": -1.0, "pulse_ms": 1.0}, "rate_hz must be >= 0"),
        ({"rate_hz": 100.0, "pulse_ms": 1.0, "rise_ms": 2.0}, "rise_ms must be 0 in a train"),
    ],
)
def test_numbers_without_sense_are_refused(fields, says):
    with refused(says):
        Course("STN", **{"amount": 0.1, **fields})


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("TRN amount=1", "course of TRN from 0 to inf ms: spiking_msprt has no nucleus 'TRN': a "),
        ("ctx->D1 amount=1", "has no nucleus 'ctx->D1': a course is of dopamine, ctx, common, D1"),
        ("TRN[0] amount=1", "has no nucleus 'TRN[0]': a course is of dopamine, ctx, common, D1"),
        ("dopamine[0] amount=1", "has no nucleus 'dopamine[0]': a course is of dopamine, ctx"),
        ("STN[2] amount=1", "of STN[2] from 0 to inf ms: channel must be within 0..1, got 2"),
        ("STN[0] amount=1 from_ms=9 to_ms=4", "from 9 to 4 ms: to_ms must come after from_ms, 9"),
        ("STN from_ms=3", "a course of STN needs amount"),
        ("dopamine to_ms=3", "a course of dopamine needs amount"),
        ("STN amount=1 until_ms=3", "a course of STN has no 'until_ms': amount, from_ms, to_ms"),
        ("dopamine amount=1.1", "of dopamine must be within 0..2, with this row it is 2.1"),
        ("dopamine amount=-1.1 from_ms=40 rise_ms=9", "0..2, with this row it is -0.1"),
    ],
)
def test_a_course_of_nothing_and_a_level_out_of_range_are_refused(row, says):
    with pytest.raises(ValueError, match=r".") as error:
        TABLE.edited(f"add {row}")
    assert str(error.value).startswith(f"{row!r}: ")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_the_level_is_that_of_all_rows_together():
    first = Course("dopamine", 0.8, 0, 100)
    assert TABLE.with_rows(first, replace(first, from_ms=100, to_ms=200))
    assert TABLE.with_rows(first, replace(first, from_ms=50), Course("dopamine", -0.7, 50))
    slow = Course("dopamine", 5.0, 0, 10, rise_ms=100)
    assert slow.reached < 1
    assert TABLE.with_rows(slow)
    with refused("courses"):
        TABLE.with_rows(first, replace(first, from_ms=50))


def test_dopamine_without_a_receptor_or_with_two_meanings_is_refused():
    bare = replace(TABLE, populations=tuple(replace(p, receptor="") for p in TABLE.populations))
    with refused("courses"):
        bare.with_rows(PULSE)
    named = TABLE.with_rows(Population("dopamine", Rate()))
    with refused("courses"):
        named.with_rows(PULSE)
    lopsided = TABLE.scale("ctx->D1", 0.9, channel=0)
    with refused("dopamine"):
        lopsided.with_rows(PULSE)


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
    hashes = {
        table_writer.digest(TABLE.edited(f"add STN{k} amount=-2")) for k in ("", "[0]", "[1]")
    }
    assert len(hashes) == 3
    with refused("channel within 0..1, got 2"):
        TABLE.with_channels(3).add("STN[2]", amount=1).with_channels(2)


def test_a_nucleus_called_dopamine_takes_courses_as_any_other():
    named = TABLE.with_rows(Population("dopamine", Rate())).edited("add dopamine[0] amount=1")
    assert run(named, np.zeros((1, 1, 2)), engine="rate", step_ms=10.0).output_nats.size


def test_courses_go_through_edits_and_are_taken_off():
    edited = TIMED.lesion("STN", 0.2).scale("D1->SNr", 0.9).dopamine(1.1).with_neurons(20)
    assert edited.courses == TIMED.courses
    assert TIMED.steady == TABLE
    assert TABLE.steady is TABLE
    assert edited.unlesioned.courses == TIMED.courses
    exact = anatomy.bogacz_gurney()
    assert exact.exact
    assert not exact.with_rows(DRIVE).exact
    with refused("row"):
        replace(TABLE, courses=("x",))


@given(st.lists(drawn_courses(), max_size=3))
def test_courses_come_back_from_a_file(rows):
    circuit = TABLE.with_rows(*rows)
    restored = table_reader.parse(table_writer.text(circuit), "mine.toml")
    assert restored == circuit
    assert table_writer.digest(restored) == table_writer.digest(circuit)
    assert (table_writer.digest(circuit) == table_writer.digest(TABLE)) == (not rows)


def test_a_file_without_courses_has_none_of_them():
    assert "courses" not in table_writer.text(TABLE)
    assert "courses" not in table_writer.plain(TABLE)
    written = table_writer.text(TIMED.with_rows(PULSE.__class__("dopamine", 0.1), DRIVE, DRIVE))
    assert len(table_reader.parse(written, "mine.toml").courses) == 5


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"amount"', '"size"', "there is no column of courses 'size'; there are what, amount"),
        ("0.5, ", "-1.5,", "course of dopamine from 20 to 120 ms: the level of dopamine must"),
        ('"STN",      -0.2', '"TRN",      -0.2', "course of TRN from 0 to 50 ms: spiking_msprt"),
        ("120,", " 12,", "to_ms must come after from_ms, 20, got 12"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_with_its_line(old, new, says):
    written = table_writer.text(TIMED)
    before, _, after = written.partition("[courses]")
    assert old in after
    wrong = before + "[courses]" + after.replace(old, new, 1)
    with pytest.raises(ValueError, match=r"^mine\.toml, line \d+: ") as error:
        table_reader.parse(wrong, "mine.toml")
    assert says in str(error.value)


def test_a_page_shows_the_pulses_of_a_train():
    train = Course("STN", 2.0, rate_hz=130, pulse_ms=1)
    assert "rate_hz" not in courses(TIMED)
    assert courses(TIMED.with_rows(train))[["rate_hz", "pulse_ms"]].values.tolist()[-1] == [130, 1]


def test_a_page_shows_courses_where_there_are_some():
    assert list(courses(TIMED)["course"]) == ["dopamine", "STN"]
    assert "assumed" in text(TIMED)
    for page in (text, html):
        assert "decay_ms" in page(TIMED)
        assert "decay_ms" not in page(TABLE)
    assert repr(TIMED) != repr(TABLE)
    assert "2 courses" in repr(TIMED)
