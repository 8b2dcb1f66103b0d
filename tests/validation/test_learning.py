"""Gaps and weights learned from reward against what is exact, on scoring seeds: make validate."""

from functools import partial

import numpy as np
import pytest

import bgmodel as bg
from bgmodel import stream
from bgmodel.integrators.sprt_theory import optimal_separation
from bgmodel.learning.deciders import InCircuit, WeightLearner
from bgmodel.learning.feature_sources import tap_features
from bgmodel.learning.gap import fold_sources, increments, regret_of
from bgmodel.learning.learned_weights import circuit_time_at_accuracy, counted_weights
from bgmodel.learning.reinforce import GaussianPolicy, Learner, learn, trials_of
from bgmodel.learning.weights import learn_weights
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent

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
    start_regret = float(regret_of(np.array([start]), readings, optimum, XI, T_MAX)[0])
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
    regrets = regret_of(boundary_separation, readings, optimum, XI, T_MAX)
    passed = np.sum(regrets < 0.02)
    print(
        f"{period} mm from {start}: start regret {start_regret:.3f}, within 2 % {passed}/20, "
        f"worst {max(regrets):.3f}"
    )
    if start_regret < 0.06:
        pytest.skip(f"{period} mm from {start} is flat: the start is within 6 %")
    assert passed >= 18


SEED, RUNS = 101, 12
"""Step sizes were tuned on seed 1."""


def gratings(period_mm, t_max=40, **options):
    return tap_features(held_out_taps(), SameDifferent(period_mm), t_max=t_max, **options)


UNITS = "1.035: counts of the same readings with the truth known need 1.021, so units carry no more"


@pytest.mark.parametrize(
    ("period", "t_max", "trials"),
    [(2.0, 40, 10_000), pytest.param(1.5, 100, 30_000, marks=pytest.mark.xfail(reason=UNITS))],
)
def test_taps_are_read_as_fast_as_with_the_exact_likelihoods(period, t_max, trials):
    taps, held_out = gratings(period, t_max)
    test = held_out.draw(3000, rng=SEED)
    learned = learn_weights(taps, seed=SEED, runs=RUNS, learner=WeightLearner(trials=trials))
    calibration, ratio = learned.calibration(test), learned.relative_time(test)
    counted = counted_weights(taps.draw(500, rng=SEED), readings=trials)
    print(
        f"{period} mm: time {ratio.mean():.3f}, slope {calibration.slope.mean():.3f}, r "
        f"{calibration.r.mean():.3f}; counts {counted.relative_time(test)[0]:.3f}"
    )
    assert ratio.mean() <= 1.02
    assert calibration.r.mean() > 0.97
    # On 1.5 mm the exact likelihoods are shrunk towards no evidence.
    assert 0.9 < calibration.slope.mean() < (1.1 if period == 2 else 1.2)


def test_a_circuit_learns_from_the_confidence_of_its_own_snr():
    taps, held_out = gratings(2.0, 12, step_ms=200)
    learned = learn_weights(
        taps, decider=InCircuit(bg.BasalGanglia("macaque", seed=SEED)), seed=SEED, runs=16,
        learner=WeightLearner(trials=1500),
    )  # fmt: skip
    test, model = held_out.draw(2000, rng=SEED), bg.BasalGanglia("macaque", seed=SEED + 1)
    exact = circuit_time_at_accuracy(model, test.exact, 0.9)
    times = [circuit_time_at_accuracy(model, learned.to_evidence(test, k), 0.9) for k in range(4)]
    print(f"time {np.mean(times) / exact:.3f} of exact likelihoods, {exact:.0f} ms")
    assert np.mean(times) < 1.05 * exact
