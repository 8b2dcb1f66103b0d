"""Bounds that are raised under way: limits that are known, and simulated paths."""

import numpy as np
import pytest

from bgmodel.fitting.passage import accuracy
from bgmodel.fitting.stop_process import crossed_later, raised_bound, threshold_nats


def test_the_threshold_is_that_of_the_posterior_at_the_bound():
    # Palmer's accuracy is the posterior of the test at its bound.
    v, a = np.array([1.0, 3.0]), np.array([0.4, 0.6])
    assert np.exp(-threshold_nats(a, 2 * v)) == pytest.approx(accuracy(v, a))


def test_the_raised_bound_has_the_posterior_that_the_stop_leaves():
    a, n = np.array([0.5]), np.array([2.0])
    theta = threshold_nats(a, n)
    assert raised_bound(a, n, 0.0) == pytest.approx(a)
    assert threshold_nats(raised_bound(a, n, 0.1), n) == pytest.approx(theta - 0.1)
    assert np.isinf(raised_bound(a, n, float(theta[0])))
    assert np.isinf(raised_bound(a, n, 2.0))


def test_nothing_is_crossed_without_time_or_without_a_bound():
    u = np.array([0.0, 0.1, 0.5])
    assert crossed_later(3.0, 0.5, np.inf, u, u + 1).tolist() == [0, 0, 0]
    assert crossed_later(3.0, 0.5, 0.8, u, np.zeros(3)).tolist() == [0, 0, 0]
    # With a long time all are.
    assert crossed_later(3.0, 0.5, 0.8, u, np.full(3, 50.0)) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("u", "b"), [(0.1, 0.7), (0.25, 1.0)])
def test_simulated_paths_cross_as_often(u, b):
    rng = np.random.default_rng(7)
    v, a, w, dt, paths = 2.0, 0.5, 0.3, 2e-4, 8000
    # The discrete walk overshoots: its bounds are 0.583 steps too far (Siegmund 1985).
    less = 0.583 * np.sqrt(dt)
    x = np.zeros(paths)
    before, after = round(u / dt), round(w / dt)
    for _ in range(before):
        x += v * dt + np.sqrt(dt) * rng.standard_normal(len(x))
        x = x[np.abs(x) < a - less]
    alive = len(x)
    for _ in range(after):
        x += v * dt + np.sqrt(dt) * rng.standard_normal(len(x))
        x = x[np.abs(x) < b - less]
    share = 1 - len(x) / alive
    error = np.sqrt(share * (1 - share) / alive)
    crossed = crossed_later(v, a, b, np.array([u]), np.array([w]))[0]
    assert crossed == pytest.approx(share, abs=4 * error + 0.005)
