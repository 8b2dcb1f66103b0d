"""Learning of a gap on tactile evidence, against the exact solution."""

import numpy as np
import pytest
from pandas.testing import assert_frame_equal

from bgmodel.deciding.reward import reward_of
from bgmodel.integrators.sprt_theory import OptimalThreshold, optimal_separation
from bgmodel.learning import gap
from bgmodel.learning.gap import (
    fold_sources,
    increments,
    learn_folds,
    policy_for,
    regret_of,
    search_folds,
)
from bgmodel.learning.reinforce import GaussianPolicy, Learner, exhaustive_search
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import held_out_taps

TAPS = held_out_taps()


def test_simulation_agrees_with_the_exact_solution_on_tactile_evidence():
    separations = [0.0, 1.0, 4.0, 8.0]
    trials = 30_000
    options = {"trials": trials, "t_max": 30, "seed": 7, "name": "test"}
    table = search_folds(fold_sources(TAPS, 2.0)[:2], separations, **options)
    p = table["exact_accuracy"]
    z = (table["accuracy"] - p) / np.sqrt(p * (1 - p) / trials)
    assert np.abs(z).max() < 4
    assert np.abs(table["mean_steps"] / table["exact_mean_steps"] - 1).max() < 0.03


def test_regret_is_the_share_that_a_gap_costs_more_and_never_below_zero():
    """Against trials drawn anew."""
    readings, gaps = fold_sources(TAPS, 2.0)[0], np.linspace(0.0, 8.0, 33)
    best = optimal_separation(*increments(readings), 50.0, t_max=30)
    regret = regret_of(gaps, readings, best, 50.0, 30)
    assert regret.min() >= 0
    assert regret_of(np.array([best.boundary_separation]), readings, best, 50.0, 30) < 3e-4
    counts = exhaustive_search(readings.draw(100_000, 30, rng=stream(1, "regret")), gaps)
    cost = -reward_of(1 - counts.accuracy, counts.mean_steps, 50.0)
    assert (1 + regret) * best.cost == pytest.approx(cost, rel=0.03)


def test_by_default_the_best_gap_is_inside_the_range_that_is_learned():
    """0 to 8 nats where that suffices, as in the paper."""
    for best in (0.0, 4.0, 7.9):
        assert policy_for([OptimalThreshold(best, 1.0)]) == GaussianPolicy()
    for best in (8.0, 10.6, 20.0):
        low, high = policy_for([OptimalThreshold(2.0, 1.0), OptimalThreshold(best, 1.0)]).bounds
        assert low == 0 < best < high


def test_every_run_of_every_fold_has_its_own_course_from_the_start_to_what_is_learned(monkeypatch):
    """The running mean over the trials that count ends at the learned gap."""
    monkeypatch.setattr(gap, "FOLDS", 2)
    learner = Learner(episodes=300, last=50)
    options = {"xi": 50.0, "t_max": 10, "seed": 3, "learner": learner, "keep": 4, "window": 50}
    table = learn_folds(TAPS, 2.0, starts=[1.5, 3.0], repeats=2, **options)
    # A start does not change the runs of another.
    for start in (3.0, 1.5):
        alone = learn_folds(TAPS, 2.0, starts=[start], repeats=2, **options)
        some = table[table["start_separation"] == start].reset_index(drop=True)
        assert_frame_equal(some, alone, check_exact=True)
    table = some
    runs = table.groupby(["fold", "repeat"])
    assert list(runs.groups) == [(fold, repeat) for fold in range(2) for repeat in range(2)]
    assert all(run["episode"].tolist() == [0, 100, 199, 299] for _, run in runs)
    last = runs.last()
    np.testing.assert_allclose(last["smoothed_separation"], last["learned_separation"])
    assert (runs["smoothed_separation"].first() == 1.5).all()
    assert last["learned_separation"].nunique() == 4
    # One fold, one optimum; the start costs more than it by the same in both repeats.
    same = table.groupby("fold")[["optimal_separation", "optimal_cost", "start_regret"]].nunique()
    assert (same == 1).all(axis=None)
    assert table["optimal_separation"].nunique() == 2
    assert (table["start_regret"] > 0).all()
