"""Readings one by one give what all of them at once give, to the byte, on every engine."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy
from circuits.engines import engine_of
from tests.helpers import refused

STEP_MS, STEPS = 20.0, 6
TABLES = {
    "spiking_msprt": anatomy.spiking_msprt(2).with_neurons(40),
    "lesioned": anatomy.spiking_msprt(2).with_neurons(40).lesion("STN", 0.3),
    "sparse": anatomy.spiking_msprt(2).with_neurons(40).with_connections(0.5),
    "macaque": anatomy.macaque(3).with_neurons(40),
    "course": anatomy.macaque(2).with_neurons(40).add("dopamine", amount=0.2, from_ms=30),
}


def drive_of(circuit, seed=0, steps=STEPS):
    rng = np.random.default_rng(seed)
    return rng.normal(0, 0.4, (steps, circuit.channels)).cumsum(axis=0)


def streamed(circuit, engine, drive, trial, step_ms=STEP_MS):
    stream = engine.stream(circuit, step_ms=step_ms, steps=len(drive), seed=7, trial=trial)
    parts = [stream.add(reading).copy() for reading in drive]
    return stream, np.concatenate(parts)


# For populations with a course a loop is compiled that no other test needs.
STREAMED = [
    pytest.param(
        engine,
        name,
        marks=[pytest.mark.validate] * (name == "course" and engine in ("rate", "population")),
    )
    for engine in ("rate", "population", "spikes", "plain")
    for name in TABLES
]


@pytest.mark.parametrize(("engine", "name"), STREAMED)
def test_readings_one_by_one_give_the_bytes_of_all_at_once(engine, name):
    circuit, made = TABLES[name], engine_of(engine)
    if engine in ("rate", "population") and name == "sparse":
        pytest.skip("populations have no connections of single cells")
    if engine == "plain" and name != "macaque":
        pytest.skip("one table tells, and it is slow")
    trials, steps, step_ms = 3, STEPS, STEP_MS
    if engine == "plain":
        circuit, trials, steps, step_ms = circuit.with_neurons(8), 1, 2, 5.0
        made = engine_of(engine, settle_ms=20)
    drive = np.stack([drive_of(circuit, seed, steps) for seed in range(trials)])
    activity = made.run(circuit, drive, step_ms=step_ms, seed=7, first_trial=4)
    for trial in {0, trials - 1}:
        stream, out = streamed(circuit, made, drive[trial], 4 + trial, step_ms)
        assert out.tobytes() == activity.output_nats[trial].tobytes()
        assert np.array_equal(stream.time_ms, activity.time_ms)


@pytest.mark.parametrize("engine", ["rate", "population", "spikes"])
@given(st.integers(1, STEPS - 1), st.integers(0, 2**16))
@settings(max_examples=10, deadline=None)
def test_later_readings_change_nothing_of_what_was_before(engine, step, seed):
    circuit, made = TABLES["macaque"], engine_of(engine)
    drive = drive_of(circuit, seed)
    other = drive.copy()
    other[step:] = drive_of(circuit, seed + 1)[step:]
    a, b = (streamed(circuit, made, each, 1)[1] for each in (drive, other))
    per = len(a) // STEPS
    assert np.array_equal(a[: step * per], b[: step * per])
    assert not np.array_equal(a[step * per :], b[step * per :])


def test_a_trial_takes_as_many_readings_as_it_said_and_those_that_fit():
    circuit = TABLES["macaque"]
    stream = engine_of("rate").stream(circuit, step_ms=STEP_MS, steps=1)
    stream.add([0.0, 0.0, 0.0])
    with refused("reading all its 1 readings"):
        stream.add([0.0, 0.0, 0.0])
