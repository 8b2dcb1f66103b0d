"""Correlation of trials with the same initial state, on numbers with a known one."""

import numpy as np
import pytest

from benchmarks.scores.settled import correlation, larger_error
from circuits.engines.population.settled import number_of


@pytest.mark.parametrize("rho", [0.0, 0.05])
def test_a_known_correlation_is_found(rho):
    """Values with a common part per state; groups have 1 to 24 trials."""
    rng = np.random.default_rng(3)
    state = number_of(np.arange(20_000))
    common = rng.normal(size=state.max() + 1)[state]
    values = np.sqrt(rho) * common + np.sqrt(1 - rho) * rng.normal(size=len(state))
    found, low, high = correlation(values, state)
    assert low < found < high
    assert found == pytest.approx(rho, abs=2 * (high - low) / 1.96)
    assert (low > 0) == bool(rho)


def test_the_error_of_a_mean_grows_by_the_variance_of_shared_states():
    """Simulated: the variance of means over 2 000 trials, of which 4 share a state."""
    rng, rho, trials = np.random.default_rng(4), 0.3, 2000
    state = number_of(np.arange(trials))
    common = rng.normal(size=(4000, state.max() + 1))
    means = np.sqrt(rho) * common[:, state].mean(axis=1)
    means += np.sqrt((1 - rho) / trials) * rng.normal(size=4000)
    exact = means.std() * np.sqrt(trials) - 1
    assert larger_error(rho, trials) == pytest.approx(exact, abs=0.05)
    assert larger_error(0.0, trials) == 0
