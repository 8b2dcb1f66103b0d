"""Heterogeneous cells: the mean over representative cells."""

import numpy as np
import pytest

from circuits.cells import Lif, Phase
from circuits.laws.mean_field import differing, mean_rate_hz

INPUT, LINE_HZ = np.array([0.0, 0.4, 1.1]), np.array([8.0, 20.0, 41.0])


def test_cells_that_do_not_differ_are_one():
    cell = Phase(0.3)
    assert differing(cell, 0.0) == ((cell, 1.0),)
    np.testing.assert_array_equal(mean_rate_hz(cell, 0.0, INPUT, LINE_HZ), LINE_HZ)


@pytest.mark.parametrize("heterogeneity", [0.1, 0.3])
def test_constants_of_those_that_stand_for_all_have_the_mean_and_the_spread(heterogeneity):
    """Three constants, one at a time, at the roots of 3: each varies in a third of all."""
    factors = np.array([factor for _, factor in differing(Phase(0.3), heterogeneity)])
    assert len(factors) == 6
    assert factors.mean() == pytest.approx(1)
    assert factors.std() == pytest.approx(heterogeneity)


def test_the_mean_rate_of_cells_that_differ_is_that_of_their_rates():
    cell = Lif(
        tau_ms=10.0, threshold_mv=15.0, reset_mv=5.0, refractory_ms=2.0, noise_mv=3.0, rest_mv=0.0,
        mv_per_nat=8.0,
    )  # fmt: skip
    current = np.array([10.0, 14.0, 18.0])
    alike = cell.rate_hz(current, LINE_HZ)
    each_hz = [each.rate_hz(current, factor * LINE_HZ) for each, factor in differing(cell, 0.2)]
    mean_hz = mean_rate_hz(cell, 0.2, current, LINE_HZ)
    np.testing.assert_allclose(mean_hz, np.mean(each_hz, axis=0), rtol=1e-12)
    assert (np.abs(mean_hz / alike - 1) > 1e-4).all()
