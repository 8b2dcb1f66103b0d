"""Learning of a gap on tactile evidence, against the exact solution."""

import numpy as np
import pytest

from bgmodel.learning.gap import fold_sources, increments, regret_on_fresh_trials, search_folds
from bgmodel.tactile.task import held_out_taps
from bgmodel.theory.sprt import optimal_delta, reward_curve

TAPS = held_out_taps()


def test_simulation_agrees_with_the_exact_solution_on_tactile_evidence():
    deltas = [0.0, 1.0, 4.0, 8.0]
    trials = 30_000
    table = search_folds(
        fold_sources(TAPS, 2.0)[:2], deltas, trials=trials, t_max=30, seed=7, name="test"
    )
    p = table["exact_accuracy"]
    z = (table["accuracy"] - p) / np.sqrt(p * (1 - p) / trials)
    assert np.abs(z).max() < 4
    assert np.abs(table["mean_steps"] / table["exact_mean_steps"] - 1).max() < 0.03


def test_regret_is_the_share_that_a_gap_costs_more():
    readings = fold_sources(TAPS, 2.0)[0]
    best = optimal_delta(*increments(readings), 50.0, t_max=30)
    deltas = np.array([0.5, best.delta])
    regret = regret_on_fresh_trials(
        deltas, readings, best, xi=50.0, t_max=30, seed=1, name="regret"
    )
    cost = -reward_curve(*increments(readings), deltas, 50.0, t_max=30)
    assert regret == pytest.approx(cost / best.cost - 1, abs=0.03)
    assert regret[0] > 0.3
    assert abs(regret[1]) < 0.03
