"""The vectorised exponential is that of the library."""

import numpy as np
import pytest

from bgmodel.support.compiling import compiled
from bgmodel.support.exponential import LOWEST, exponential


def _of_each(x):
    powers = np.empty_like(x)
    for i in range(len(x)):
        powers[i] = exponential(x[i])
    return powers


of_each = compiled(_of_each)


def test_it_is_within_two_units_in_the_last_place():
    x = np.concatenate([np.linspace(LOWEST, 700, 400_001), np.linspace(-1e-3, 1e-3, 1001)])
    assert np.abs(of_each(x) / np.exp(x) - 1).max() <= 2 * np.finfo(float).eps


@pytest.mark.parametrize("x", [-701.0, -1e6, -np.inf])
def test_exponents_below_the_lowest_are_the_lowest(x):
    assert of_each(np.array([x])) == pytest.approx(np.exp(LOWEST), rel=1e-12)
