"""Engines by name and by record: options are typed, and what is unknown or wrong is refused."""

import pickle
from dataclasses import dataclass, make_dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits import anatomy, engines
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import wire
from circuits.engines.engine import blocks, cells
from circuits.engines.spikes.plan import plan, workspace
from tests.helpers import refused


@pytest.mark.parametrize("name", engines.ENGINES)
def test_a_name_is_the_engine_with_its_defaults(name):
    engine = engines.engine_of(name)
    assert engine == engines.ENGINES[name]()
    assert str(engine) == engine.id == name
    assert repr(engine) == f"{type(engine).__name__}()"
    assert pickle.loads(pickle.dumps(engine)) == engine


@pytest.mark.parametrize("name", ["nest", "", None, 3, engines.Populations])
def test_an_unknown_engine_lists_those_that_there_are(name):
    for make in (engines.engine_of, lambda engine: BasalGanglia("macaque", engine)):
        with refused("engine must be one of algebra, rate, .*"):
            make(name)


@pytest.mark.parametrize("name", engines.ENGINES)
def test_an_option_that_there_is_not_is_refused(name):
    spikes = () if engines.ENGINES[name].spiking else ("spikes",)
    for option in ("sampel_ms", "step_ms", "seed", "first_trial", *spikes):
        with refused(f"{option} the {name} engine takes no '{option}'"):
            engines.engine_of(name, **{option: 1})


@pytest.mark.parametrize(
    ("kind", "option", "values"),
    [
        (engines.Algebra, "laws", ["lines", 3, None]),
        (engines.Populations, "laws", ["table", None]),
        (engines.Populations, "noise", ["no", 1]),
        (engines.Rates, "dt_ms", ["a", 0, -1, np.nan]),
        (engines.Plain, "sample_ms", ["a", 0, None]),
        (engines.Spikes, "settle_ms", [-1, np.inf]),
        (engines.Spikes, "workers", [0, 1.5, "2", True]),
        (engines.Spikes, "drop_below", ["a", np.nan]),
        (engines.Spikes, "rates", ["no"]),
        (engines.Plain, "spikes", [(1,), 3]),
    ],
)
def test_an_option_of_the_wrong_type_or_out_of_range_is_refused(kind, option, values):
    for value in values:
        with refused(option):
            kind(**{option: value})


def test_a_field_of_a_record_takes_a_name_or_an_engine():
    by_name = BasalGanglia("macaque", "population", seed=1)
    assert by_name == BasalGanglia("macaque", engines.Populations(), seed=1)
    assert replace(by_name, engine="rate").engine == engines.Rates()
    assert BasalGanglia("macaque").engine == engines.Populations()


@dataclass(frozen=True)
class Mine(engines.Engine):
    id: ClassVar[str] = "mine"
    description: ClassVar[str] = "an example"


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        (3, "engine subclass"),
        (type("Undecorated", (Mine,), {}), "engine frozen=True"),
        (dataclass(frozen=True)(type("Nameless", (engines.Engine,), {})), "id text"),
        (dataclass(frozen=True)(type("Taken", (Mine,), {"id": "rate"})), "engine already"),
        (make_dataclass("Needy", ["option"], bases=(Mine,), frozen=True), "engine every option"),
    ],
)
def test_what_is_no_engine_is_not_registered(kind, says):
    before = dict(engines.ENGINES)
    with refused(says):
        engines.register(kind)
    assert before == engines.ENGINES


def test_engines_without_an_option_return_themselves():
    engine = engines.Algebra()
    tuned = ({"workers": 2}, {"workers": 2, "rates": False}, {"sample_ms": 5.0})
    same = [*(engine.tuned(**options) for options in tuned), engine.until(0.1)]
    same += [engine.recording(("STN",)), engine.coarse(), engine.at_rest()]
    assert all(other is engine for other in same)


def test_noise_at_rest_is_measured_by_what_is_compiled():
    times = {"dt_ms": 0.05, "settle_ms": 100.0}
    for kind in ("plain", "brian2", "spikes"):
        asked = engines.engine_of(kind, **times, spikes=("STN",)).at_rest()
        assert asked == engines.Spikes(**times, rates=False)
    asked = engines.Populations(**times, sample_ms=5.0, drop_below=0.3, workers=2).at_rest()
    assert asked == engines.Populations(**times, rates=False, workers=2)


MSPRT = anatomy.spiking_msprt(2)
STEP_MS, STEPS = 20.0, 6
POPULATIONS = "rate", "population"
TABLES = {
    "spiking_msprt": MSPRT.with_neurons(40),
    "lesioned": MSPRT.with_neurons(40).lesion("STN", 0.3),
    "sparse": MSPRT.with_neurons(40).with_connections(0.5),
    "macaque": anatomy.macaque(3).with_neurons(40),
    "course": anatomy.macaque(2).with_neurons(40).add("dopamine", amount=0.2, from_ms=30),
}


# Populations have no connections of single cells, and for those with a course a loop is compiled
# that no other test needs. Of the plain engine, which is slow, one table tells.
STREAMED = [
    *(("spikes", name) for name in TABLES),
    *product(POPULATIONS, ("spiking_msprt", "lesioned", "macaque")),
    *(pytest.param(engine, "course", marks=pytest.mark.validate) for engine in POPULATIONS),
    ("plain", "macaque"),
]


@pytest.mark.parametrize(("engine", "name"), STREAMED)
def test_readings_one_by_one_give_the_bytes_of_all_at_once(engine, name):
    circuit, made = TABLES[name], engines.engine_of(engine)
    trials, steps, step_ms = 3, STEPS, STEP_MS
    if engine == "plain":
        circuit, trials, steps, step_ms = circuit.with_neurons(8), 1, 2, 5.0
        made = engines.engine_of(engine, settle_ms=20)
    rng = np.random.default_rng(0)
    drive = rng.normal(0, 0.4, (trials, steps, circuit.channels)).cumsum(axis=1)
    activity = made.run(circuit, drive, step_ms=step_ms, seed=7, first_trial=4)
    for trial in {0, trials - 1}:
        stream = made.stream(circuit, step_ms=step_ms, steps=steps, seed=7, trial=4 + trial)
        out = np.concatenate([stream.add(reading).copy() for reading in drive[trial]])
        assert out.tobytes() == activity.output_nats[trial].tobytes()
        assert np.array_equal(stream.time_ms, activity.time_ms)


def test_a_trial_takes_as_many_readings_as_it_said():
    stream = engines.engine_of("rate").stream(TABLES["macaque"], step_ms=STEP_MS, steps=1)
    stream.add([0.0, 0.0, 0.0])
    with refused("reading all its 1 readings"):
        stream.add([0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", ["algebra", "rate", "population"])
def test_memory_of_engines_without_cells_is_that_of_what_they_return(name):
    """The fixed point takes half as much again as its rates on the way."""
    engine = engines.engine_of(name)
    activity = engines.run(MSPRT, np.zeros((3, 4, 2)), engine=engine, step_ms=5, seed=1)
    samples = activity.output_nats.shape[1]
    rates = sum(x.nbytes for x in activity.rates_hz.values())
    bytes_needed = activity.output_nats.nbytes + rates * (1 if engine.timed else 1.5)
    assert engine.memory_bytes(MSPRT, 3, samples) == bytes_needed
    out = activity.output_nats.nbytes if engine.threaded else bytes_needed
    assert engine.tuned(workers=2, rates=False).memory_bytes(MSPRT, 3, samples) == out


def test_memory_of_cells_is_that_of_what_each_thread_or_trial_works_in():
    of = {
        (name, workers): engines.engine_of(name).tuned(workers=workers).memory_bytes(MSPRT, 10, 50)
        for name in ("spikes", "brian2", "plain")
        for workers in (1, 2)
    }
    kept = 10 * 50 * (8 * MSPRT.channels + 4 * blocks(MSPRT))
    each = (of["spikes", 1] - kept) / cells(MSPRT)
    wiring = wire(MSPRT)
    work = workspace(plan(wiring, Clock(1, 50), np.zeros(wiring.blocks, bool)))
    assert sum(part.nbytes for part in work) / cells(MSPRT) == pytest.approx(each, rel=0.2)
    assert of["spikes", 2] - of["spikes", 1] == each * cells(MSPRT)
    # Python's arrays of a cell's variables and constants, each in double precision.
    assert of["brian2", 2] - kept == pytest.approx(10 * 100 * cells(MSPRT))
    assert of["plain", 1] - kept == pytest.approx(100 * cells(MSPRT))
