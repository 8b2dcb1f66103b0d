"""The clock and the rate of a tick; courses held to fixed points and closed forms of a filter."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy
from circuits.cells import Rate
from circuits.circuit import Circuit
from circuits.declaration.courses import Course
from circuits.declaration.rows import Population, Projection
from circuits.dynamics import noise
from circuits.dynamics.ticks import Clock, cell_factors, spike_hz, timed
from circuits.dynamics.wiring import wire
from circuits.engines import ENGINES, run


def test_the_clock_counts_what_it_says():
    clock = Clock(4, 5.0, dt_ms=0.5, sample_ms=2.5, settle_ms=10)
    assert (clock.ticks, clock.samples) == (20 + 40, 8)
    assert clock.time_ms[[0, -1]].tolist() == [2.5, 20.0]
    assert [clock.step_of(k) for k in (0, 19, 20, 29, 30, 59)] == [-1, -1, 0, 0, 1, 3]


@pytest.mark.parametrize("neurons", [1, 12, 300, 7000])
def test_the_rate_of_a_tick_is_exact_in_whatever_order_spikes_are_added(neurons):
    each = spike_hz(neurons, 0.1)
    npt.assert_allclose(each, 1e4 / neurons, rtol=1e-12)
    one_by_one = np.cumsum(np.full(neurons, each))
    npt.assert_array_equal(one_by_one, each * np.arange(1, neurons + 1))


def test_constants_of_cells_follow_their_draws_down_to_a_tenth():
    """More ones in a cell's word, larger constants; the mean of a channel is the row's."""
    circuit = anatomy.spiking_msprt().with_neurons(400)
    key = noise.stream_key(circuit.wiring_seed, 0, "GPe/1")
    for heterogeneity in (0.2, 1.0):
        by_channel = cell_factors(circuit.with_heterogeneity(heterogeneity), "GPe", 1)
        for i, factors in enumerate(by_channel):
            draws = noise.bits32(key, noise.CELLS_TICK + i, 400)
            assert (np.diff(factors[np.argsort(draws)]) >= 0).all()
        if heterogeneity == 1:
            assert by_channel.min() == 0.1
        else:
            assert by_channel.min() > 0.1
            npt.assert_allclose(by_channel.mean(axis=1), 1, rtol=1e-12)
            npt.assert_allclose(by_channel.std(axis=1), heterogeneity, rtol=0.1)


TABLES = {name: anatomy.load_circuit(name, 3) for name in ("spiking_msprt", "macaque")}
SPREAD = np.array([0.5, 0.1, -0.6])
HELD = np.tile(SPREAD, (1, 8, 1))
SINGLE = 2e-4
"""Single precision and what is left of settling, nats."""


def settled(circuit, drive=HELD, step_ms=1000.0, **options):
    """Return OUT and rates at the end of a run without noise."""
    activity = run(circuit, drive, engine="rate", step_ms=step_ms, **options)
    return activity.output_nats[0, -1], {k: v[0, -1] for k, v in activity.rates_hz.items()}


def agree(actual, expected, atol=SINGLE):
    np.testing.assert_allclose(actual[0], expected[0], atol=atol, rtol=0)
    for name, rates in expected[1].items():
        np.testing.assert_allclose(actual[1][name], rates, atol=50 * atol, rtol=0, err_msg=name)


@pytest.mark.parametrize("amount", [-0.15, 0.15])
@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_a_level_that_is_held_settles_at_the_fixed_point_of_that_level(table, amount):
    with_course = settled(table.with_rows(Course("dopamine", amount)))
    level = table.dopamine(1 + amount)
    exact = run(level, HELD[:, :1], engine="algebra", step_ms=1)
    agree(with_course, (exact.output_nats[0, 0], {k: v[0, 0] for k, v in exact.rates_hz.items()}))
    agree(with_course, settled(level))


def test_a_course_of_dopamine_is_relative_to_the_level_of_the_edited_circuit():
    table = TABLES["macaque"]
    before = table.with_rows(Course("dopamine", 0.1)).dopamine(1.1)
    after = table.dopamine(1.1).with_rows(Course("dopamine", 0.1))
    assert before == after
    agree(settled(before), settled(table.dopamine(1.1).dopamine(1.1)))


@pytest.mark.parametrize("engine", sorted(set(ENGINES) - {"algebra"}))
def test_a_course_of_the_input_is_a_drive_of_all_channels(engine):
    table = TABLES["macaque"].with_neurons(30)
    drive = np.tile(SPREAD, (1, 3, 1))
    options = {"engine": engine, "step_ms": 20.0, "settle_ms": 10.0, "seed": 4}
    pushed = drive + np.array([0, 0.3, 0])[:, None] / table.drive_gain
    expected = run(table, pushed, **options).output_nats
    out = run(table.with_rows(Course(table.input, 0.3, 20, 40)), drive, **options).output_nats
    npt.assert_allclose(out, expected, rtol=0, atol=1e-12 if ENGINES[engine].spiking else 1e-4)


def relay(tau_ms=20.0, **path):
    """Return a population without noise that follows a source through a linear filter.

    The source is constant, so that its delay of 1 ms changes nothing but how many ticks the
    engines advance at a time.
    """
    path = {"delay_ms": 1.0} | path
    rows = (
        Population("ctx", Rate(signed=True), 0.0, 10.0),
        Population("SNr", Rate(signed=True), 0.0, 10.0, "GABA", tau_ms=tau_ms, receptor="D1"),
    )
    projection = Projection("ctx", "SNr", 0.8, **path)
    return Circuit("relay", rows, (projection,), reference_nats=1.5 + np.log(2))


def response(time_ms, course, tau):
    """Return a linear filter's response to a course: tau dx/dt = course - x."""
    rise, decay = course.rise_ms, course.decay_ms
    last = course.to_ms - course.from_ms

    def filtered(since, fade_ms):
        """Return the filter's response to exp(-t / own), at rest before."""
        fade = np.exp(-since / fade_ms) if fade_ms else 0 * since
        return fade_ms * (fade - np.exp(-since / tau)) / (fade_ms - tau)

    def on(since):
        step = 1 - np.exp(-since / tau)
        return course.amount * (step - (filtered(since, rise) if rise else 0))

    since = np.clip(time_ms - course.from_ms, 0, last)
    later = np.clip(time_ms - course.to_ms, 0, None)
    fall = course.reached * filtered(later, decay) if decay else 0
    return np.where(later > 0, on(last) * np.exp(-later / tau) + fall, on(since))


PULSES = [
    Course("SNr", 0.7, 30, 90),
    Course("SNr", 0.7, 30, 90, rise_ms=8, decay_ms=15),
    Course("SNr", -0.4, 12.3, 47.7, rise_ms=60),
    Course("SNr", 0.5, 0, 40, decay_ms=150),
]


@pytest.mark.parametrize("course", PULSES)
@pytest.mark.parametrize("engine", ["plain", "rate"])
@pytest.mark.parametrize(("what", "adds"), [("SNr", 1.0), ("dopamine", 1.2)])
def test_a_pulse_through_a_linear_population_has_its_closed_form(engine, course, what, adds):
    """The source is at 1.5 nats, its weight 0.8, so that a level of 1 + a adds 1.2 a."""
    options = {"step_ms": 200.0, "dt_ms": 0.1, "sample_ms": 0.2, "settle_ms": 20.0}
    options |= {"seed": 1} if engine == "plain" else {}
    circuit = relay().with_rows(replace(course, what=what))
    ran = run(circuit, np.zeros((1, 1, 2)), engine=engine, **options)
    filtered = ran.rates_hz["SNr"][0] / 10 - 1.2
    ticks = adds * response(np.arange(1, 2001) / 10, course, 20.0)
    expected = ticks.reshape(-1, 2).mean(axis=1)
    np.testing.assert_allclose(filtered, np.tile(expected[:, None], 2), atol=4e-5, rtol=0)


def test_a_pivot_stays_where_it_is_while_dopamine_turns_the_gain():
    circuit = relay().with_population("SNr", operating_point_nats=1.5).add("dopamine", amount=0.8)
    ran = run(circuit, np.zeros((1, 1, 2)), engine="rate", step_ms=200.0)
    np.testing.assert_allclose(ran.decoded_nats("SNr"), 1.2, atol=1e-5)


@pytest.mark.parametrize("engine", sorted(set(ENGINES) - {"algebra"}))
def test_a_course_of_nothing_changes_no_byte(engine):
    table = TABLES["macaque"].with_neurons(20)
    options = {"engine": engine, "step_ms": 10.0, "settle_ms": 5.0, "seed": 4}
    nothing = table.edited("add dopamine amount=0 to_ms=9", "add STN amount=-0", "add GPe amount=0")
    one, two = (run(circuit, HELD[:, :2], **options) for circuit in (table, nothing))
    np.testing.assert_array_equal(one.output_nats, two.output_nats)
    for name, rates in one.rates_hz.items():
        np.testing.assert_array_equal(rates, two.rates_hz[name])


NUCLEI = ["ctx", "D1", "D2", "STN", "GPe"]
WINDOWS = st.tuples(
    st.sampled_from(NUCLEI),
    st.sampled_from([None, 0, 1, 2]),
    st.floats(-1, 1),
    st.floats(0, 60).map(lambda t: round(t, 2)),
    st.floats(1, 60).map(lambda t: round(t, 2)),
)


def window(name, channel, amount, from_ms, lasts_ms):
    what = name if channel is None else f"{name}[{channel}]"
    return Course(what, amount, from_ms, from_ms + lasts_ms)


@given(st.lists(WINDOWS, min_size=1, max_size=4), st.booleans())
@settings(max_examples=30)
def test_a_window_on_all_channels_is_the_sum_of_those_on_each(windows, dopamine):
    level = ("add dopamine amount=0.1 to_ms=30",) if dopamine else ()
    of = {None: range(3), 0: [0], 1: [1], 2: [2]}
    each = [window(name, k, *rest) for name, which, *rest in windows for k in of[which]]
    table, clock = TABLES["macaque"].edited(*level), Clock(2, 50)
    both = ([window(*w) for w in windows], each)
    one, two = (timed(wire(table.with_rows(*rows)), clock) for rows in both)
    np.testing.assert_array_equal(one.nats[one.of_block], two.nats[two.of_block])
    np.testing.assert_array_equal(one.factors[one.of_unit], two.factors[two.of_unit])
