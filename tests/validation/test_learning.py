"""Learning against the exact optimum, on scoring seeds: make validate."""

from functools import partial

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.integrators.sprt_theory import optimal_separation, reward_curve
from bgmodel.learning.gap import fold_sources, increments, regret_on_fresh_trials
from bgmodel.learning.reinforce import GaussianPolicy, Learner, learn, trials_of
from bgmodel.tactile.source import held_out_taps

pytestmark = pytest.mark.validate
XI, T_MAX = 50.0, 30
SCORING_SEEDS = range(101, 121)


@pytest.mark.parametrize("start", [0.5, 7.5])
@pytest.mark.parametrize("period", [1.5, 2.0, 2.5])
def test_learning_ends_within_two_per_cent_of_the_exact_optimum(period, start):
    """18 of 20 scoring seeds, on fold 0; a start within 6 % is flat, and passes nothing."""
    # On 2.5 mm errors are so rare that their rate takes more trials, and wider trials, to measure.
    slow = period == 2.5
    long = Learner(episodes=100_000)
    learner = Learner(episodes=200_000, half_episodes=3000) if slow else long
    policy = GaussianPolicy(last_share=0.0625, half_episodes=20_000) if slow else GaussianPolicy()
    readings = fold_sources(held_out_taps(), period)[0]
    pair = increments(readings)
    optimum = optimal_separation(*pair, XI, t_max=T_MAX)
    start_regret = -float(reward_curve(*pair, start, XI, t_max=T_MAX)) / optimum.cost - 1
    name = ("validation", period, start)
    draws = [
        partial(readings.draw, steps=T_MAX, rng=stream(seed, *name, "trials"))
        for seed in SCORING_SEEDS
    ]
    boundary_separation = learn(
        trials_of(draws, XI),
        start,
        rngs=[stream(seed, *name, "explore") for seed in SCORING_SEEDS],
        policy=policy,
        learner=learner,
    ).learned
    regrets = [
        regret_on_fresh_trials(
            boundary_separation[[i]], readings, optimum, xi=XI, t_max=T_MAX, seed=seed, name=name
        )[0]
        for i, seed in enumerate(SCORING_SEEDS)
    ]
    exact = -reward_curve(*pair, boundary_separation, XI, t_max=T_MAX) / optimum.cost - 1
    passed, surely = np.sum(np.array(regrets) < 0.02), np.sum(np.array(exact) < 0.02)
    print(
        f"{period} mm from {start}: start regret {start_regret:.3f}, within 2 % {passed}/20 "
        f"(exact {surely}/20), worst {max(exact):.3f}"
    )
    if start_regret < 0.06:
        pytest.skip(f"{period} mm from {start} is flat: the start is within 6 %")
    assert passed >= 18
