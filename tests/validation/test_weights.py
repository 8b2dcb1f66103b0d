"""Weights learned from reward against exact likelihoods, on scoring seeds: make validate."""

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.learning.deciders import InCircuit, WeightLearner
from bgmodel.learning.feature_sources import tap_features
from bgmodel.learning.learned_weights import circuit_time_at_accuracy, counted_weights
from bgmodel.learning.weights import learn_weights, learn_weights_in_circuit
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent

pytestmark = pytest.mark.validate
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
    learned = learn_weights_in_circuit(
        taps, InCircuit(bg.BasalGanglia("macaque", seed=SEED)), seed=SEED, runs=16,
        learner=WeightLearner(trials=1500),
    )  # fmt: skip
    test, model = held_out.draw(2000, rng=SEED), bg.BasalGanglia("macaque", seed=SEED + 1)
    exact = circuit_time_at_accuracy(model, test.exact, 0.9)
    times = [circuit_time_at_accuracy(model, learned.to_evidence(test, k), 0.9) for k in range(4)]
    print(f"time {np.mean(times) / exact:.3f} of exact likelihoods, {exact:.0f} ms")
    assert np.mean(times) < 1.05 * exact
