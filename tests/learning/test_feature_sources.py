"""Drift of the sensor: what stays the same, and that learning follows it."""

import numpy as np
import pytest

from bgmodel.learning.deciders import WeightLearner
from bgmodel.learning.feature_sources import DriftingSensor, GaussianFeatures, tap_features
from bgmodel.learning.weights import learn_weights
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent
from tests.helpers import refused

FOLLOWING = WeightLearner(trials=1500, half_trials=np.inf)


def gratings():
    return tap_features(held_out_taps(), SameDifferent(2.0), t_max=10)


def test_a_drift_moves_the_activity_and_keeps_what_a_tap_says():
    pool = gratings()[0]
    before, after = pool.draw(40, rng=1), pool.drifted(0.5).draw(40, rng=1)
    assert np.array_equal(before.log_likelihood, after.log_likelihood)
    assert np.array_equal(before.truth, after.truth)
    # Interpolated readings within the centres halve.
    inner = np.abs(before.values @ pool.centres) < 0.4 * np.abs(pool.centres).min()
    assert inner.any()
    halved = 0.5 * (before.values @ pool.centres)[inner]
    assert (after.values @ pool.centres)[inner] == pytest.approx(halved, abs=1e-9)


def test_readings_change_linearly_from_the_first_trial_of_the_drift_to_its_last():
    pool = gratings()[0]
    drifting = DriftingSensor(pool, scale=0.6, shift_deg=10.0, begins=1000, lasts=500)
    assert drifting.at_trial(999) is pool
    for number, share in ((1000, 0.0), (1250, 0.5), (1500, 1.0), (9000, 1.0)):
        seen = drifting.at_trial(number).readings[1]
        wanted = (1 - 0.4 * share) * pool.readings[1] + 10 * share
        np.testing.assert_allclose(seen, wanted, rtol=1e-6, atol=1e-12)
    abrupt = DriftingSensor(pool, scale=0.6, begins=1000)
    assert np.array_equal(abrupt.at_trial(1000).readings[0], abrupt.after.readings[0])


def test_nothing_changes_before_the_drift_and_learning_follows_it():
    pool, held_out = gratings()
    still = learn_weights(pool, seed=3, runs=4, learner=FOLLOWING)
    drifting = DriftingSensor(pool, scale=0.5, begins=750)
    followed = learn_weights(drifting, seed=3, runs=4, learner=FOLLOWING)
    same = followed.course.kept <= 750
    assert np.array_equal(followed.course.weights[:, same], still.course.weights[:, same])
    test = held_out.drifted(0.5).draw(500, rng=4)
    # Weights from before the drift read the new activity wrongly.
    assert (followed.calibration(test).r > still.calibration(test).r + 0.05).all()


def test_only_pooled_taps_can_drift():
    with refused("pool must be pooled taps"):
        DriftingSensor(GaussianFeatures())
    with refused("scale"):
        DriftingSensor(gratings()[0], scale=0.0)
