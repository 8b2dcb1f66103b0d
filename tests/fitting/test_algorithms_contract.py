"""What holds for every model of decisions: exact, simulated, of two alternatives and of more."""

import json

import numpy as np
import pytest

from bgmodel.fitting.algorithms import BIAS, GAPS, SENSITIVITY, GapModel
from bgmodel.fitting.parameters import RESPONSE
from bgmodel.fitting.responses import Grid
from bgmodel.fitting.simulated.alternatives import ManyCircuitModel
from bgmodel.fitting.simulated.circuit_model import MECHANISMS, CircuitModel
from bgmodel.fitting.simulated.error import PARTS
from bgmodel.fitting.simulated.msprt import MsprtModel
from bgmodel.fitting.simulated.race import LcaModel, RaceModel
from circuits.anatomy import load_circuit

GRID = Grid(100)
SMALL, MACAQUE = {"seconds": 1.0, "trials": 64}, load_circuit("macaque", 2)
MODELS = {
    **{gap.name: (GapModel(gap), 2) for gap in GAPS.values()},
    "msprt": (MsprtModel(4, 2000, 11), 4),
    "race": (RaceModel(5), 5),
    "lca": (LcaModel(3, 3000, 7, 1.0), 3),
    "circuit": (CircuitModel(MACAQUE, "algebra", **SMALL), 2),
    "circuit of three": (ManyCircuitModel(load_circuit("macaque", 3), "algebra", **SMALL), 3),
    "dopamine": (CircuitModel(MACAQUE, "algebra", MECHANISMS["dopamine"], **SMALL), 2),
}
EACH = pytest.mark.parametrize("name", MODELS)


def decided(model, strength=(0.5, 1.5), sensitivity=2.0, **values):
    every = {each.name: np.full(len(strength), each.start) for each in model.parameters}
    every["sensitivity"] = np.full(len(strength), sensitivity)
    every |= {name: np.asarray(each, float) for name, each in values.items()}
    return model.decided(every, np.asarray(strength, float), GRID)


@EACH
def test_mass_is_that_of_probabilities_and_rises_with_evidence(name):
    model, _ = MODELS[name]
    mass = decided(model)
    assert mass.shape == (2, 2, GRID.bins)
    assert (mass.sum(axis=(1, 2)) <= 1 + 1e-4).all()
    assert mass.min() > -0.01  # a control variate may leave less than its error below 0
    share = mass[:, 1].sum(axis=1) / mass.sum(axis=(1, 2))
    assert share[1] > share[0] > 1 / MODELS[name][1]


@EACH
def test_without_evidence_all_alternatives_are_equally_likely(name):
    model, number = MODELS[name]
    weak = decided(model, (0.0, 3.0))[0]  # the gain of the test is that of the mean strength
    share = weak[1].sum() / weak.sum()
    paths = {"lca": 750, "msprt": 8000}.get(name)
    error = 1e-6 if paths is None else 4 * ((1 - 1 / number) / number / paths) ** 0.5
    assert share == pytest.approx(1 / number, abs=error)


@EACH
def test_drift_is_sensitivity_times_strength_and_each_cell_has_its_own_parameters(name):
    model, _ = MODELS[name]
    one, other = decided(model, (0.5, 1.5), 2.0), decided(model, (5.0, 15.0), 0.2)
    assert one == pytest.approx(other, abs=1e-9)
    # Trials with a bias take seconds to simulate.
    of_decisions = [each for each in model.parameters if each not in (SENSITIVITY, *RESPONSE, BIAS)]
    for each in of_decisions:
        ends = [each.start, each.start + 0.2 * (each.high - each.start)]
        both = decided(model, (1.0, 1.0), **{each.name: ends})
        for cell, value in enumerate(ends):
            alone = decided(model, (1.0,), **{each.name: [value]})
            assert both[cell] == pytest.approx(alone[0], abs=1e-12)
        assert not np.allclose(*both, atol=1e-9), each.name
    assert model.threshold_name in {each.name for each in of_decisions}


@EACH
def test_parts_are_other_trials_and_an_exact_model_has_none(name):
    model, _ = MODELS[name]
    halves = [decided(each).tobytes() for each in model.halves()]
    left = {decided(each).tobytes() for each in model.left_out()}
    exact = isinstance(model, (GapModel, RaceModel))
    assert len(set(halves)) == (1 if exact else 2)
    assert len(left) == (0 if exact else PARTS)
    if name in ("msprt", "lca"):
        mean = np.mean([decided(each) for each in model.halves()], axis=0)
        assert mean == pytest.approx(decided(model), abs=1e-3)


def test_each_model_has_its_own_record():
    records = [json.dumps(model.identity(), sort_keys=True) for model, _ in MODELS.values()]
    assert len(set(records)) == len(records)
