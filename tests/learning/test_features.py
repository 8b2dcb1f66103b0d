"""Readings as the activity of sensory units, against closed forms and the readings themselves."""

import numpy as np
import pytest
from scipy.stats import poisson

from bgmodel.learning.feature_sources import GaussianFeatures, PoissonFeatures, tap_features
from bgmodel.learning.features import (
    Features,
    check_learnable,
    even_centres,
    soft_histogram,
)
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from tests.helpers import refused, refusing

NAMES = ("left", "right")
GOOD = {"values": np.ones((2, 3, 2)), "truth": [0, 1], "names": NAMES}


def test_a_soft_histogram_interpolates_between_its_centres():
    centres = np.array([-3.0, -1.0, 0.0, 4.0])
    x = np.linspace(-5, 6, 100)
    activity = soft_histogram(x, centres)
    assert activity.sum(axis=1) == pytest.approx(1)
    assert activity @ centres == pytest.approx(np.clip(x, -3, 4))
    assert (activity > 0).sum(axis=1).max() == 2


def test_even_centres_make_units_equally_active():
    rng = np.random.default_rng(1)
    readings = [rng.normal(0, 1, 4000), rng.normal(8, 3, 4000)]
    mean = soft_histogram(np.concatenate(readings), even_centres(readings, 10)).mean(axis=0)
    assert np.ptp(mean[1:-1]) < 0.03
    with refused("readings must differ enough"):
        even_centres([np.zeros(50)], 4)


def test_gaussian_features_have_the_log_ratios_of_the_classic_problem():
    drawn = GaussianFeatures(d_prime=0.8, t_max=10).draw(2000, rng=1)
    ratio = drawn.log_likelihood[..., 1] - drawn.log_likelihood[..., 0]
    toward = np.where(drawn.truth == 1, 1, -1)[:, None] * ratio
    # Mean d'^2 / 2 and variance d'^2.
    assert abs(toward.mean() - 0.32) / (0.8 / np.sqrt(20_000)) < 4
    assert toward.std() == pytest.approx(0.8, rel=0.02)
    assert drawn.values.sum(axis=2) == pytest.approx(2)


@pytest.mark.parametrize("centred", [False, True])
def test_exact_likelihoods_of_counts_are_those_of_poisson_cells(centred):
    cells = PoissonFeatures(channels=3, units=6, centred=centred, t_max=5)
    drawn = cells.draw(40, rng=2)
    counts = drawn.values if drawn.removed is None else drawn.values + drawn.removed
    assert counts == pytest.approx(counts.round())
    known = poisson.logpmf(counts.round()[:, :, None, :], cells.means).sum(axis=3)
    differences = (drawn.log_likelihood - known) - (drawn.log_likelihood - known)[:, :, :1]
    assert differences == pytest.approx(0, abs=1e-9)


def test_taps_are_scored_on_a_fold_that_teaches_nothing():
    taps, task = held_out_taps(), SameDifferent(2.0)
    learned, scored = tap_features(taps, task, fold=2, units=12)
    held = source(taps, task, fold=2)
    for mine, exact in zip(scored.log_likelihood, held.log_likelihood, strict=True):
        assert np.array_equal(mine, exact)
    assert len(learned.values[1]) > 20 * len(scored.values[1])
    drawn = scored.draw(30, rng=3)
    assert drawn.units == 12
    assert drawn.values.sum(axis=2) == pytest.approx(1)
    assert np.bincount(drawn.truth).tolist() == [15, 15]


test_features_that_do_not_fit_are_refused = refusing(
    ({"values": np.ones((2, 3))}, "values"),
    ({"values": np.full((2, 3, 2), np.inf)}, "values"),
    ({"names": ("left",)}, "names"),
    ({"truth": [0, 2]}, "truth"),
    ({"truth": [0, 1, 1]}, "truth"),
    ({"truth": None}, "truth"),
    ({"step_ms": 0.0}, "step_ms"),
    ({"lengths": np.array([4, 1])}, "lengths"),
    ({"lengths": np.array([3, 2])}, "lengths features after the last"),
    ({"log_likelihood": np.zeros((2, 3, 3))}, "log_likelihood"),
    of=lambda change: Features(**GOOD | change),
)


def test_whole_trials_are_drawn_from_a_table():
    values = np.arange(12.0).reshape(3, 2, 2)
    drawn = Features(values, [0, 1, 1], NAMES).draw(50, rng=1)
    assert drawn.trials == 50
    assert {tuple(v.ravel()) for v in drawn.values} == {tuple(v.ravel()) for v in values}
    check_learnable(drawn)
    assert "units 2" in repr(drawn)


def test_the_first_and_last_units_of_a_circular_histogram_are_neighbours():
    activity = soft_histogram([85.0, -95.0, 75.0], [-80.0, -20.0, 70.0], period=180)
    assert activity[0] == pytest.approx([0.5, 0, 0.5])
    assert activity[1] == pytest.approx(activity[0])
    assert activity[2] == pytest.approx([1 / 6, 0, 5 / 6])
