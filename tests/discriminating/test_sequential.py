"""Numbers of trials against exact chains, Wald's theory and simulated experiments."""

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.discriminating.sequential import (
    BOUND_NATS,
    exit_median,
    experiments,
    median_trials,
    wald_mean,
)
from bgmodel.integrators.first_passage import gaussian_pair, walk


def exact_median(d):
    """Return the median of a Gaussian log likelihood ratio, by the exact chain."""
    steps = walk(gaussian_pair(d)[1], -BOUND_NATS, BOUND_NATS, t_max=4000).steps_pmf
    return int(np.searchsorted(np.cumsum(steps), 0.5))


@pytest.mark.parametrize("d", [0.1, 0.2, 0.5])
def test_the_diffusion_has_the_median_of_the_exact_chain(d):
    median = exit_median(d**2 / 2, d**2)
    assert median == pytest.approx(exact_median(d), rel=0.03, abs=0.6)


def test_a_steep_walk_goes_straight_to_its_bound():
    assert exit_median(0.5, 1e-6) == pytest.approx(BOUND_NATS / 0.5, rel=0.01)


def test_walds_mean_is_that_of_two_simple_hypotheses():
    d = 0.1
    exact = walk(gaussian_pair(d)[1], -BOUND_NATS, BOUND_NATS).mean_steps
    assert wald_mean(d**2 / 2) == pytest.approx(exact, rel=0.08)
    assert wald_mean(d**2 / 2) < exact  # overshoot


@pytest.mark.parametrize("shares", [(0.6, 0.4), (0.52, 0.48)])
def test_simulated_experiments_have_the_predicted_median(shares):
    p, q = np.array(shares), np.array(shares[::-1])
    values = np.log(p / q)
    bins = (stream(5, "bins").random(20_000) > p[0]).astype(int)
    rng = stream(6, "experiments")
    ended, right = experiments([values], [bins], [1.0], rng, repeats=1000)
    assert np.median(ended) == pytest.approx(median_trials(values, p), rel=0.12)
    # A Bayes factor of 10 is wrong in at most 1 of 11 experiments.
    assert right.mean() > 1 - 1 / 11 - 0.03


def test_experiments_without_a_difference_do_not_end():
    bins = [np.zeros(10, dtype=int)]
    rng = stream(1, "none")
    ended, right = experiments([np.zeros(1)], bins, [1.0], rng, repeats=5, most=1000)
    assert np.isnan(ended).all()
    assert not right.any()
