"""Engines by name and by record: options are typed, and what is unknown or wrong is refused."""

import pickle
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.engines import (
    ENGINES,
    Algebra,
    Engine,
    Plain,
    Population,
    Rate,
    Spikes,
    engine_of,
    register,
)
from tests.helpers import refused


@pytest.mark.parametrize("name", ENGINES)
def test_a_name_is_the_engine_with_its_defaults(name):
    engine = engine_of(name)
    assert engine == ENGINES[name]()
    assert str(engine) == engine.id == name
    assert repr(engine) == f"{type(engine).__name__}()"
    assert pickle.loads(pickle.dumps(engine)) == engine


@pytest.mark.parametrize("name", ["nest", "", None, 3, Population])
def test_an_unknown_engine_lists_those_that_there_are(name):
    for make in (engine_of, lambda engine: BasalGanglia("macaque", engine)):
        with refused("engine must be one of algebra, rate, .*"):
            make(name)


@pytest.mark.parametrize("name", ENGINES)
def test_an_option_that_there_is_not_is_refused(name):
    spikes = () if ENGINES[name].spiking else ("spikes",)
    for option in ("sampel_ms", "step_ms", "seed", "first_trial", *spikes):
        with refused(f"{option} the {name} engine takes no '{option}'"):
            engine_of(name, **{option: 1})


@pytest.mark.parametrize(
    ("kind", "option", "values"),
    [
        (Algebra, "laws", ["lines", 3, None]),
        (Population, "laws", ["table", None]),
        (Population, "noise", ["no", 1]),
        (Rate, "dt_ms", ["a", 0, -1, float("nan")]),
        (Plain, "sample_ms", ["a", 0, None]),
        (Spikes, "settle_ms", [-1, float("inf")]),
        (Spikes, "workers", [0, 1.5, "2", True]),
        (Spikes, "drop_below", ["a", float("nan")]),
        (Spikes, "rates", ["no"]),
        (Plain, "spikes", [(1,), 3]),
    ],
)
def test_an_option_of_the_wrong_type_or_out_of_range_is_one_sentence(kind, option, values):
    for value in values:
        with pytest.raises(ValueError, match=f"{option} must be") as caught:
            kind(**{option: value})
        assert "\n" not in str(caught.value)


def test_a_field_of_a_record_takes_a_name_or_an_engine():
    by_name = BasalGanglia("macaque", "population", seed=1)
    assert by_name == BasalGanglia("macaque", Population(), seed=1)
    other = replace(by_name, engine="rate")
    assert (other.engine, BasalGanglia("macaque").engine) == (Rate(), Population())


@dataclass(frozen=True)
class Mine(Engine):
    id: ClassVar[str] = "mine"
    description: ClassVar[str] = "an example"


@dataclass
class Thawed:
    pass


@dataclass(frozen=True)
class Needy(Mine):
    option: int


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        (3, "engine subclass"),
        (Thawed, "engine subclass"),
        (type("Undecorated", (Mine,), {}), "engine frozen=True"),
        (dataclass(frozen=True)(type("Nameless", (Engine,), {})), "id text"),
        (dataclass(frozen=True)(type("Taken", (Mine,), {"id": "rate"})), "engine already"),
        (Needy, "engine every option needs a default"),
    ],
)
def test_what_is_no_engine_is_not_registered(kind, says):
    before = dict(ENGINES)
    with refused(says):
        register(kind)
    assert before == ENGINES


def test_engines_without_an_option_return_themselves():
    engine = Algebra()
    same = [
        engine.tuned(workers=2),
        engine.tuned(workers=2, rates=False),
        engine.tuned(sample_ms=5.0),
        engine.until(0.1),
    ]
    same += [engine.recording(("STN",)), engine.coarse(), engine.at_rest()]
    assert all(other is engine for other in same)


def test_noise_at_rest_is_measured_by_what_is_compiled():
    times = {"dt_ms": 0.05, "settle_ms": 100.0}
    for kind in ("plain", "brian2", "spikes"):
        asked = engine_of(kind, **times, spikes=("STN",)).at_rest()
        assert asked == Spikes(**times, rates=False)
    asked = Population(**times, sample_ms=5.0, drop_below=0.3, workers=2).at_rest()
    assert asked == Population(**times, rates=False, workers=2)
