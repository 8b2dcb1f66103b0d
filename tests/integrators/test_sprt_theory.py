"""The exact sequential test against tables and identities."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from bgmodel.integrators.first_passage import Empirical, GaussianIncrements, gaussian_pair, walk
from bgmodel.integrators.sprt_theory import OVERSHOOT, optimal_separation, reward_curve, sprt
from tests.helpers import refusing

# d, theta: exact ER and E[T], as printed.
TABLE = [
    (0.25, 3, "0.04127", "92.608"),
    (0.5, 1, "0.21582", "6.124"),
    (1, 1, "0.16916", "2.373"),
    (1, 3, "0.02714", "7.046"),
    (2, 3, "0.01582", "2.294"),
]


@pytest.mark.parametrize(("d", "theta", "error", "steps"), TABLE)
def test_tabulated_values_are_met_to_every_digit(d, theta, error, steps):
    test = sprt(*gaussian_pair(d), 2 * theta)
    assert (f"{test.error_rate:.5f}", f"{test.mean_steps:.3f}") == (error, steps)


@pytest.mark.parametrize(
    ("d", "xi", "theta"), [(0.5, 50, 1.051), (1, 50, 2.372), (1, 200, 3.931), (1.5, 50, 3.018)]
)
def test_the_optimal_threshold_is_tabulated(d, xi, theta):
    best = optimal_separation(*gaussian_pair(d), xi, t_max=None, bounds=(0, 10))
    assert best.boundary_separation / 2 == pytest.approx(theta, abs=6e-4)


@pytest.mark.parametrize("d", [1.0, 2.0])
def test_the_best_gap_grows_by_twice_the_logarithm_of_the_cost_of_an_error(d):
    """Without end: sinh(theta) + theta = xi d^2 / 4 (Wald), theta half the gap and the overshoot.

    The optimum costs no more than any gap of a far wider grid, and is inside it.
    """
    costs = np.geomspace(200, 2e6, 3)
    optima = [optimal_separation(*gaussian_pair(d), xi, t_max=None) for xi in costs]
    separations = np.array([one.boundary_separation for one in optima])
    theta = separations / 2 + OVERSHOOT * d
    assert np.sinh(theta) + theta == pytest.approx(costs * d**2 / 4, rel=0.08)
    slope = np.diff(separations)[-1] / np.diff(np.log(costs))[-1]
    assert slope == pytest.approx(2, rel=0.03)
    wide = np.linspace(2, 38, 10)
    for xi, one in zip(costs, optima, strict=True):
        assert one.cost <= -reward_curve(*gaussian_pair(d), wide, xi).max() + 1e-9
    # At a gap of 8 an error of 3 000 readings costs far more.
    at_8 = -reward_curve(*gaussian_pair(1.0), 8.0, 3000.0)
    assert at_8 / optimal_separation(*gaussian_pair(1.0), 3000, t_max=None).cost > 2.3
    # A range that is given is kept.
    assert (
        optimal_separation(*gaussian_pair(d), 2e6, t_max=None, bounds=(0, 8)).boundary_separation
        > 7.99
    )


def test_of_gaps_that_cost_the_same_the_least_is_the_best():
    """Of five readings of a nat three decide: gaps of more than 4 and up to 6 are one test."""
    p = 1 / (1 + np.exp(-1))
    pair = Empirical([-1.0, 1.0], [p, 1 - p]), Empirical([-1.0, 1.0], [1 - p, p])
    best = optimal_separation(*pair, 1e6, t_max=5)
    assert 4 < best.boundary_separation < 4.3
    every = -reward_curve(*pair, [4.1, 5.0, 6.0, 8.0, 100.0], 1e6, t_max=5)
    assert every[:3] == pytest.approx(best.cost, rel=1e-12)
    assert every[3:].min() > best.cost


def test_one_reading_is_optimal_where_errors_are_cheap():
    assert optimal_separation(*gaussian_pair(0.5), 10, t_max=None).boundary_separation == 0


@pytest.mark.parametrize(
    ("c", "theta", "error", "steps", "reward"),
    [
        (0.005, 3.230, 0.0262, 15.69, -0.1046),
        (0.01, 2.425, 0.0567, 11.49, -0.1715),
        (0.02, 1.597, 0.1209, 7.03, -0.2616),
        (0.05, 0.630, 0.2637, 2.44, -0.3858),
    ],
)
def test_optima_of_lepora_2016_are_met(c, theta, error, steps, reward):
    """Readings N(+-1/3, 1), an error costs 1 and a reading c."""
    pair = gaussian_pair(2 / 3)
    best = optimal_separation(*pair, 1 / c, t_max=None)
    test = sprt(*pair, 2 * theta)
    assert best.boundary_separation / 2 == pytest.approx(theta, abs=6e-4)
    assert test.error_rate == pytest.approx(error, abs=5.1e-5)
    assert test.mean_steps == pytest.approx(steps, abs=5.1e-3)
    assert -c * best.cost == pytest.approx(reward, abs=5.1e-5)


def test_swapping_the_states_leaves_the_symmetric_test():
    s1, s2 = gaussian_pair(0.8)
    even = sprt(s1, s2, [0.5, 3.0], t_max=9)
    swapped = sprt(
        GaussianIncrements(-s2.mean, s2.sd),
        GaussianIncrements(-s1.mean, s1.sd),
        [0.5, 3.0],
        t_max=9,
    )
    assert even.error_rate == pytest.approx(swapped.error_rate, abs=1e-12)
    tilted = sprt(s1, s2, [0.5, 3.0], prior_s2=0.7, t_max=9)
    other = sprt(s1, s2, [0.5, 3.0], prior_s2=0.3, t_max=9)
    assert tilted.error_rate == pytest.approx(other.error_rate, abs=1e-12)
    assert tilted.mean_steps == pytest.approx(other.mean_steps, abs=1e-9)
    assert np.all(tilted.error_rate < even.error_rate)  # a prior is worth something


def likelihood_ratio_pair(values, p):
    """Atoms x under S2 with probabilities p, and under S1 with p exp(-x), both made to sum to 1."""
    s1 = p * np.exp(-values)
    return Empirical(values, s1 / s1.sum()), Empirical(values, p)


@pytest.mark.parametrize("steps", [1, 2, 5])
@pytest.mark.parametrize("stay", [0.0, 0.4])
def test_wald_is_exact_without_overshoot(steps, stay):
    """Readings worth -c, 0 or c that meet the bounds: ER = 1 / (1 + e^theta), m E[T] = E[Z_T]."""
    c = 0.37
    up = (1 - stay) / (1 + np.exp(-c))
    s1, s2 = likelihood_ratio_pair(np.array([-c, 0, c]), np.array([1 - stay - up, stay, up]))
    test = sprt(s1, s2, 2 * steps * c)
    assert test.error_rate == pytest.approx(1 / (1 + np.exp(steps * c)), rel=1e-11)
    mean = s2.weights @ s2.values
    expected = steps * c * (1 - 2 * test.error_rate) / mean
    assert test.mean_steps == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("theta", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("d", [0.3, 1.0])
def test_likelihood_ratio_identity_bounds_the_errors(d, theta):
    """P1(R2) = E2[exp(-Z_T); R2] with theta <= Z_T < theta + the largest possible overshoot."""
    s1, s2 = gaussian_pair(d)
    ratio = walk(s1, -theta, theta).p_upper / walk(s2, -theta, theta).p_upper
    assert theta + 0.5 * d < -np.log(ratio) < theta + 0.7 * d
    cap = d
    grid = np.clip(s2.mean + d * ndtri((np.arange(5000) + 0.5) / 5000), -cap, cap)
    weights = np.full(grid.size, 1 / grid.size)
    shift = np.log(weights @ np.exp(-grid))  # makes the capped values true likelihood ratios
    capped = likelihood_ratio_pair(grid + shift, weights)
    ratio = walk(capped[0], -theta, theta).p_upper / walk(capped[1], -theta, theta).p_upper
    assert theta < -np.log(ratio) < theta + cap + shift


def test_delta_zero_takes_the_sign_of_one_reading():
    d = np.array([0.4, 1.0, 2.0])
    for separation in d:
        test = sprt(*gaussian_pair(separation), 0.0)
        assert test.error_rate == pytest.approx(ndtr(-separation / 2), abs=1e-13)
        assert test.mean_steps == pytest.approx(1.0, abs=1e-13)
    tied = Empirical(np.array([-1.0, 0.0, 1.0]), np.array([0.2, 0.5, 0.3]))
    assert walk(tied, 0, 0).p_lower == pytest.approx(0.2 + 0.5 / 2)  # a tie goes to each by half
    assert walk(tied, -5, 5, t_max=1).p_lower == pytest.approx(0.2 + 0.5 / 2)


G = GaussianIncrements(0.1, 1.0)


test_errors_name_the_argument = refusing(
    (lambda: GaussianIncrements(0.0, 0.0), "sd"),
    (lambda: GaussianIncrements(np.nan, 1.0), "mean"),
    (lambda: gaussian_pair(-1.0), "d"),
    (lambda: Empirical.of_sample([]), "values"),
    (lambda: Empirical.of_sample([1.0, np.inf]), "values"),
    (lambda: Empirical(np.ones((2, 2)), np.full((2, 2), 0.25)), "values"),
    (lambda: Empirical(np.ones(2), np.ones(2)), "weights"),
    (lambda: Empirical(np.ones(2), np.array([1.5, -0.5])), "weights"),
    (lambda: Empirical(np.ones(2), np.ones(1)), "weights"),
    (lambda: walk(G, 1.0, -1.0), "lower"),
    (lambda: walk(G, -1.0, np.inf), "upper"),
    (lambda: walk(G, -1.0, 1.0, start=np.nan), "start"),
    (lambda: walk(G, -1.0, 1.0, t_max=0), "t_max"),
    (lambda: walk(G, -1.0, 1.0, t_max=2.5), "t_max"),
    (lambda: walk(G, -1.0, 1.0, cells=2), "cells"),
    (lambda: walk(G, -1e5, 1e5), "upper"),
    (lambda: walk(Empirical.of_sample([0.0]), -1.0, 1.0), "increments"),
    (lambda: sprt(G, G, [1.0, -0.1]), "boundary_separation"),
    (lambda: sprt(G, G, 1.0, prior_s2=1.0), "prior_s2"),
    (lambda: optimal_separation(G, G, -2.0, t_max=5), "xi"),
    (lambda: optimal_separation(G, G, 2.0, t_max=5, bounds=(3.0, 1.0)), "bounds"),
)
