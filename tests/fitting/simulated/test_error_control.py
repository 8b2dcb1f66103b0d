"""Walks on the stored evidence, against their exact law."""

import numpy as np
import pytest

from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated.crossings import simulated
from bgmodel.fitting.simulated.error import Control, decided, exact, ideal, matched
from bgmodel.integrators.first_passage import GaussianIncrements, walk
from tests import drawn

BOUNDS = np.linspace(1.2, 0.1, 23)
ODDS = np.linspace(2.2, 0.3, 20)
SETUP = {"seconds": 2.0, "trials": 600, "seed": 5}
GRID = Grid(200)


@pytest.fixture(scope="module")
def walks():
    return simulated(ideal, -BOUNDS, **SETUP)


@pytest.mark.parametrize("v", [0.0, 2.0, -5.0])
@pytest.mark.parametrize("bound", [0.3, 0.9])
def test_the_law_of_a_walk_with_drift_is_that_of_the_exact_chain(bound, v):
    law = exact(bound, 200, (v,))[:, :, 0]
    chain = walk(GaussianIncrements(v * BIN_S, np.sqrt(BIN_S)), -bound, bound, t_max=200)
    ended = chain.steps_pmf[1:].copy()
    ended[-1] -= chain.p_forced
    assert law.sum(axis=1) == pytest.approx(ended, abs=1e-9)
    endless = walk(GaussianIncrements(v * BIN_S, np.sqrt(BIN_S)), -bound, bound)
    forced = chain.p_forced
    assert law[:, 1].sum() == pytest.approx(endless.p_upper, abs=forced + 1e-9)


def test_the_excess_of_walks_has_no_mean():
    """Over stores it is 0 within its scatter, whatever bound and lag are taken."""
    excess = []
    for seed in range(40):
        walks = simulated(ideal, -BOUNDS, **{**SETUP, "seed": seed, "trials": 60})
        control = Control(walks, np.array([0.0, 0.5, 0.03]), 2.4)
        excess.append(
            control.excess(1.1, np.array([0.0, 3.0]), 100).reshape(5, 20, 2, 2).sum(axis=1)
        )
    z = np.mean(excess, axis=0) / (np.std(excess, axis=0) / np.sqrt(40) + 1e-6)
    assert np.abs(z).max() < 4
    assert np.std(excess, axis=0).max() > 0.003


def stored(seed, *, controlled):
    """Return what an ideal integrator with log odds of twice the evidence stores."""
    setup = {**SETUP, "seed": seed, "trials": 150}
    crossings = simulated(drawn.ideal, np.log1p(np.exp(-ODDS)), **setup)
    walks = simulated(ideal, -BOUNDS, **setup)
    if not controlled:
        return crossings
    from dataclasses import replace

    return replace(crossings, control=matched(crossings, walks))


def test_walks_are_matched_to_the_bound_of_the_circuit(walks):
    """Without noise or delay the bound is the log odds over the gain, and the lag is 0."""
    control = stored(1, controlled=True).control
    expected = ODDS / drawn.GAIN
    assert np.polyval(control.bound_of_odds, ODDS) == pytest.approx(expected, abs=0.03)
    assert control.lag == pytest.approx(0, abs=0.5)


def test_a_control_keeps_the_mean_and_takes_most_of_the_scatter():
    threshold = float(np.log1p(np.exp(-1.13)))
    law = exact(1.13 / drawn.GAIN, 200, (0.0, 3.0)).transpose(2, 1, 0)
    early = {}
    for controlled in (False, True):
        each = [
            decided([(stored(seed, controlled=controlled), 1.0)], threshold, [0.0, 3.0], GRID)
            for seed in range(20)
        ]
        early[controlled] = np.array([one[:, :, :25].sum(axis=2) for one in each])
    expected = law[:, :, :25].sum(axis=2)
    scatter = {k: v.std(axis=0).mean() for k, v in early.items()}
    assert scatter[True] < 0.4 * scatter[False]
    error = early[True].std(axis=0) / np.sqrt(20)
    assert np.abs(early[True].mean(axis=0) - expected).max() < 4 * error.max() + 0.003
