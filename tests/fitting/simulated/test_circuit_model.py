"""A circuit as a model: what is stored, what it depends on, and what its axes do."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated import circuit_model as module
from bgmodel.fitting.simulated.circuit_model import MECHANISMS, Axis, CircuitModel, Mechanism
from bgmodel.fitting.simulated.crossings import FirstPassageTimes, simulated
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import digest
from tests.drawn import GAIN, ideal
from tests.helpers import refusing

MACAQUE = load_circuit("macaque", 2)
SMALL = {"seconds": 1.0, "trials": 16, "engine": "rate"}
GRID = Grid(100)
ARRAYS = ("bins", "choice", "evidence", "thresholds_nats", "drifts")


def model(folder=None, **options):
    options = {**SMALL, **options}
    return CircuitModel(options.pop("circuit", MACAQUE), folder=folder, **options)


def same(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        and getattr(one, name).dtype == getattr(other, name).dtype
        for name in ARRAYS
    )


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    return folder, model(folder).stored(())


def test_the_same_seed_writes_the_same_bytes(kept, tmp_path):
    folder, _ = kept
    model(tmp_path).stored(())
    (one,), (other,) = folder.iterdir(), tmp_path.iterdir()
    assert one.name == other.name
    assert one.read_bytes() == other.read_bytes()


SETTINGS = {"seed": 5, "trials": 17, "seconds": 1.5, "noise_nats": 2.5, "engine": "population"}
CHANGES = [
    *({"circuit": each} for each in (MACAQUE.dopamine(1.1), load_circuit("spiking_msprt", 2))),
    *({name: value} for name, value in SETTINGS.items()),
]


@pytest.mark.parametrize("changed", CHANGES, ids=lambda changed: next(iter(changed)))
def test_what_changes_a_trial_changes_the_file(kept, changed):
    folder, _ = kept
    assert model(folder, **changed).entry(()).path != model(folder).entry(()).path
    assert model(folder, **changed).identity() != model(folder).identity()


def test_a_model_that_is_changed_after_its_trials_were_simulated_has_new_ones():
    first = model()
    before = first.stored(())
    after = replace(first, seed=5).stored(())
    assert same(after, model(seed=5).stored(()))
    assert not same(after, before)


def test_the_thresholds_are_part_of_the_file_too(kept, monkeypatch):
    folder, _ = kept
    before = model(folder).entry(()).path
    monkeypatch.setattr(module, "LEVELS", 30)
    assert model(folder).entry(()).path != before


test_models_that_cannot_be_are_refused = refusing(
    ({"circuit": load_circuit("macaque", 3)}, "circuit two channels for a fit, got 3"),
    ({"engine": "abacus"}, "engine must be one of .* got 'abacus'"),
    *(({"trials": n}, "trials whole number >= 16") for n in (0, 1, 2, 15, 16.5, "many")),
    of=lambda options: model(**options),
)


def test_the_range_of_an_axis_does_not_compute_a_point_anew(tmp_path):
    axis = Axis(Parameter("dopamine", 0.8, 1.2, 1.0), 3)
    narrow = model(tmp_path, mechanism=replace(MECHANISMS["dopamine"], axes=(axis,)))
    usual = model(tmp_path, mechanism=MECHANISMS["dopamine"])
    assert narrow.entry((1.0,)).path == usual.entry((1.0,)).path


def test_two_circuits_and_their_controls_hear_the_same_evidence(monkeypatch):
    seen = []
    real = module.simulated

    def watched(run, *arguments, **named):
        def heard(read, first):
            seen.append(read)
            return run(read, first)

        return real(heard, *arguments, **named)

    monkeypatch.setattr(module, "simulated", watched)
    for other in (MACAQUE, load_circuit("spiking_msprt", 2)):
        model(circuit=other).stored(())
    # Each of them at seven drifts, as does the ideal integrator used for comparison.
    assert len(seen) == 4 * 7
    for place in range(4):
        some = seen[7 * place : 7 * place + 7]
        assert all(np.array_equal(a, b) for a, b in zip(seen[:7], some, strict=True))


OPEN = [name for name, each in MECHANISMS.items() if each.axes]


@pytest.mark.parametrize("name", OPEN)
def test_at_its_start_a_criterion_leaves_the_decisions_of_the_circuit(kept, name):
    _, plain = kept
    mechanism = MECHANISMS[name]
    edited = model(mechanism=mechanism)
    start = tuple(axis.parameter.start for axis in mechanism.axes)
    assert same(edited.stored(start), plain)
    away = tuple(axis.parameter.high for axis in mechanism.axes)
    assert not same(edited.stored(away), plain)


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_criterion_that_stands_in_place_of_the_threshold_holds_it(name):
    mechanism = MECHANISMS[name]
    parameters = {each.name: each for each in model(mechanism=mechanism).parameters}
    assert set(parameters) == {
        "sensitivity", "threshold_nats", "bias_nats", "t0_s", "t0_sd_s", "lapse",
        *(axis.parameter.name for axis in mechanism.axes),
    }  # fmt: skip
    assert parameters["threshold_nats"].free != mechanism.instead
    named = model(mechanism=mechanism).threshold_name
    assert named == (name if mechanism.instead else "threshold_nats")
    assert parameters[named].free


class Later(CircuitModel):
    """All trials decide at the same time: in the bin given by the sum of the axes' values."""

    def stored(self, point, bias=0.0):
        bins = np.full((module.LEVELS, 20), round(sum(point)))
        still = np.zeros((module.LEVELS, 20))
        return FirstPassageTimes(self.thresholds_nats, np.zeros(1), bins, np.ones_like(bins), still)


@pytest.mark.parametrize(("a", "b"), [(10, 0), (12, 0), (17.5, 3), (23, 31), (30, 40)])
def test_between_values_of_axes_a_trial_decides_between_its_times(a, b):
    axes = (Axis(Parameter("a", 10.0, 30.0, 10.0), 3), Axis(Parameter("b", 0.0, 40.0, 0.0), 5))
    made = Later(MACAQUE, "rate", Mechanism((), axes))
    values = {"sensitivity": 0.0, "threshold_nats": 0.3, "a": a, "b": b}
    every = {name: np.array([float(value)]) for name, value in values.items()}
    computed = moments(made.decided(every, np.ones(1), GRID) / BIN_S, GRID)
    assert computed["mean_s"] == pytest.approx((a + b + 0.5) * BIN_S, abs=1e-6)


def test_a_fixed_point_that_is_the_softmax_crosses_as_the_ideal_integrator():
    """Decisions and evidence, bin by bin: readings are heard when they are read."""
    made = model(circuit=load_circuit("bogacz_gurney", 2), engine="algebra", noise_nats=GAIN)
    stored = made.stored(())
    exact = simulated(ideal, made.thresholds_nats, seconds=1.0, trials=16, seed=made.seed)
    assert (exact.choice >= 0).mean() > 0.5
    assert same(stored, exact)


def test_what_channels_have_in_common_reaches_no_circuit_that_needs_evidence_centred():
    """A table like that has no fixed point far from there."""
    read = np.random.default_rng(2).normal(0, 0.07, (5, 50, 2)).cumsum(axis=1)
    for name in ("bogacz_gurney", "spiking_msprt"):
        run = model(circuit=load_circuit(name, 2), engine="algebra").run((), 0.1)
        assert run(read + 3.0, 0).out_nats == pytest.approx(run(read, 0).out_nats, abs=1e-9)
    raw = model(engine="algebra").run((), 0.1)
    assert not np.allclose(raw(read + 3.0, 0).out_nats, raw(read, 0).out_nats, atol=1e-6)


@pytest.mark.parametrize("name", OPEN)
def test_an_axis_goes_evenly_from_bound_to_bound_by_its_start(name):
    for axis in MECHANISMS[name].axes:
        each = axis.parameter
        assert [axis.values[0], axis.values[-1]] == [each.low, each.high]
        assert np.diff(axis.values) == pytest.approx((each.high - each.low) / (axis.points - 1))
        # Where a parameter stands unless it is moved, the circuit itself is simulated.
        assert np.abs(axis.values - each.start).min() < 1e-9


def test_values_go_where_their_names_stand_and_the_threshold_alone_edits_nothing():
    assert MECHANISMS["threshold"].apply(MACAQUE, ()) is MACAQUE
    motif = MACAQUE.edited("add urgency").courses[0]
    fitted = MECHANISMS["urgency"].apply(MACAQUE, (0.5,)).courses[0]
    assert replace(fitted, cite=motif.cite) == motif
    made = MECHANISMS["dopamine"].apply(MACAQUE, (0.75,))
    assert digest(made) == digest(MACAQUE.dopamine(0.75))
