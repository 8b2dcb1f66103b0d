"""The scale on which people differ."""

import numpy as np
import pytest
from scipy.stats import logistic

from bgmodel.fitting.hierarchy.scale import FURTHEST, Scale, log_logistic

SCALE = Scale(np.array([0.1, 0.001]), np.array([8.0, 0.2]))


def test_it_returns_to_where_it_came_from():
    natural = np.array([[0.7, 0.01], [7.9, 0.1999]])
    assert SCALE.back(SCALE.to(natural)) == pytest.approx(natural)


def test_bounds_are_finite_and_within_the_range():
    scaled = SCALE.to(np.array([[0.1, 0.2]]))
    assert scaled.tolist() == [[-FURTHEST, FURTHEST]]
    back = SCALE.back(scaled)
    assert (back > SCALE.low).all()
    assert (back < SCALE.high).all()


def test_slope_is_the_derivative():
    at = np.array([-2.3, 0.4])
    numeric = (SCALE.back(at + 1e-6) - SCALE.back(at - 1e-6)) / 2e-6
    assert SCALE.slope(at) == pytest.approx(numeric)


def test_far_below_the_upper_bound_it_is_nearly_a_logarithm():
    wide = Scale(np.zeros(1), np.full(1, 1000.0))
    ratio = wide.to(np.array([2.0])) - wide.to(np.array([1.0]))
    assert ratio == pytest.approx(np.log(2), abs=2e-3)


def test_a_logistic_distribution_on_the_scale_is_uniform_in_the_range():
    at = np.linspace(-4, 4, 9)
    assert log_logistic(at) == pytest.approx(logistic.logpdf(at))
    one = Scale(np.zeros(1), np.ones(1))
    density = np.exp(log_logistic(at)) / one.slope(at)
    assert density == pytest.approx(np.ones(9))
