"""From decisions to responses: mass, moments, lapses, and trials without a response."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, gamma, norm

from bgmodel.fitting.responses import BIN_S, BinnedResponses, Grid, moments, responded

GRID = Grid(300)
T0 = st.floats(0.2, 0.6)
T0_SD = st.floats(0.01, 0.05)
SEEDS = st.integers(0, 2**32)


def some_decided(seed, cells=2):
    """Return random masses between 0.2 and 1.5 s, which no t0 above takes off the grid."""
    rng = np.random.default_rng(seed)
    decided = np.zeros((cells, 2, GRID.bins))
    decided[:, :, 20:150] = rng.gamma(0.3, size=(cells, 2, 130)) + 1e-9
    return decided / decided.sum(axis=(1, 2), keepdims=True)


def heard(decided, t0_s, t0_sd_s, lapse=0.0):
    every = [np.broadcast_to(x, (len(decided),)).astype(float) for x in (t0_s, t0_sd_s, lapse)]
    return responded(decided, GRID, t0_s=every[0], t0_sd_s=every[1], lapse=every[2])


@given(SEEDS, st.floats(0.05, 1.5), st.floats(0.01, 0.3), st.floats(0, 0.2))
@settings(max_examples=20)
def test_responses_are_sums_over_every_pair_of_bins(seed, t0_s, t0_sd_s, lapse):
    """By one matrix of the shares of all later and earlier bins."""
    decided = some_decided(seed)
    decided[0, 0, 40] = -1e-5  # an estimate from simulated trials may be negative
    later = (np.arange(GRID.bins) - np.arange(GRID.bins)[:, None]) * BIN_S
    sd = np.sqrt(max(t0_sd_s**2 - BIN_S**2 / 3, (BIN_S / 20) ** 2))
    edges = [norm.cdf(later + side * BIN_S / 2, t0_s, sd) for side in (1, -1)]
    wanted = np.maximum(decided @ (edges[0] - edges[1]) / BIN_S, 0)
    wanted = (1 - lapse) * wanted + lapse / 2 / (GRID.bins * BIN_S)
    mixture = heard(decided, t0_s, t0_sd_s, lapse)
    assert mixture == pytest.approx(wanted, rel=1e-10, abs=1e-13)
    assert np.abs(heard(decided, t0_s + 0.001, t0_sd_s, lapse) - wanted).max() > 1e-6


@pytest.mark.parametrize("sd_s", [0.01, 0.05])
def test_the_likelihood_of_gamma_decisions_is_that_of_the_exact_sum(sd_s):
    """Of a smooth density, that rises from 0 as those of decisions do."""
    times, rt_s = (np.arange(3000) + 0.5) * 5e-4, np.arange(0.3, 1.8, 0.0037)
    mass = gamma.pdf(times, 4, scale=0.06) * 5e-4
    exact = norm.pdf(rt_s[:, None] - 0.3 - times, 0, sd_s) @ mass
    edges = np.arange(GRID.bins + 1) * BIN_S
    decided = np.stack([np.zeros(GRID.bins), np.diff(gamma.cdf(edges, 4, scale=0.06))])[None]
    seen = BinnedResponses(np.zeros(len(rt_s), int), np.ones(len(rt_s), int), rt_s, GRID)

    def nats(given_s):
        """Return what 10 000 trials lose by the error of the density."""
        binned = np.exp(seen.each(heard(decided, 0.3, given_s)))
        return 1e4 * 0.0037 * (exact * np.log(exact / binned) - exact + binned).sum()

    # The variance that bins would add without correction costs more than ten times as much.
    assert 0 < nats(sd_s) < 0.1 * nats(np.sqrt(sd_s**2 + BIN_S**2 / 3))
    assert nats(sd_s) < 0.05


@given(SEEDS, T0, T0_SD)
@settings(max_examples=20)
def test_each_cell_has_its_own_t0_and_each_response_its_own_mass(seed, t0_s, t0_sd_s):
    decided = some_decided(seed)
    both = heard(decided, [t0_s, t0_s + 0.05], [t0_sd_s, 0.02], [0.0, 0.1])
    alone = heard(decided[1:], t0_s + 0.05, 0.02, 0.1)
    assert both[1:] == pytest.approx(alone, abs=1e-12)
    shares = heard(decided, t0_s, t0_sd_s).sum(axis=2) * BIN_S
    assert shares == pytest.approx(decided.sum(axis=2), abs=1e-9)


def observed(response, rt_s, deadline_s=None):
    response = np.asarray(response)
    return BinnedResponses(
        np.zeros(len(response), int), response, np.asarray(rt_s), GRID, deadline_s
    )


@given(SEEDS, st.floats(0.5, 2.9), st.floats(0, 0.3))
@settings(max_examples=30)
def test_all_that_can_happen_by_a_deadline_has_probability_1(seed, deadline_s, lapse):
    density = heard(some_decided(seed, 1), 0.3, 0.04, lapse)
    within = GRID.middles_s[GRID.middles_s < deadline_s]
    rt = np.concatenate([within, within, [np.nan]])
    response = np.repeat([0, 1, -1], [len(within), len(within), 1])
    likelihoods = np.exp(observed(response, rt, deadline_s).each(density))
    assert likelihoods[:-1].sum() * BIN_S + likelihoods[-1] == pytest.approx(1, abs=1e-9)


@given(SEEDS, st.integers(30, 200), st.floats(0, 1), st.integers(0, 1))
@settings(max_examples=40)
def test_a_time_between_two_middles_has_the_density_between_theirs(seed, low, toward, response):
    density = heard(some_decided(seed, 1), 0.3, 0.04, 0.02)
    rt = GRID.middles_s[low] + toward * BIN_S
    expected = np.interp(rt, GRID.middles_s, density[0, response])
    log_density = observed([response], [rt]).each(density)
    assert log_density == pytest.approx(np.log(expected), abs=1e-9)


def test_moments_are_those_of_the_trials_that_responded():
    rng = np.random.default_rng(5)
    rt, right = rng.uniform(0.2, 1.4, 4000), rng.random(4000) < 0.7
    density = np.zeros((1, 2, GRID.bins))
    np.add.at(density, (0, right.astype(int), (rt / BIN_S).astype(int)), 1 / 5000 / BIN_S)
    computed = moments(density, GRID)
    assert computed["answered"] == pytest.approx(0.8)
    assert computed["accuracy"] == pytest.approx(right.mean())
    assert computed["mean_s"] == pytest.approx(rt.mean(), abs=1e-3)
    assert computed["sd_s"] == pytest.approx(rt.std(), abs=1e-3)


def test_a_time_before_the_first_middle_or_beyond_the_last_has_the_density_there():
    density = np.zeros((1, 2, GRID.bins))
    density[0, 1] = np.linspace(1, 4, GRID.bins)
    end_s = GRID.bins * BIN_S
    log_density = observed([1, 1, 1], [0.0, end_s, 2 * end_s]).each(density)
    assert np.exp(log_density) == pytest.approx([1, 4, 4], rel=1e-6)


@pytest.mark.parametrize("window_s", [(0.0, np.inf), (0.513, 1.207)])
def test_new_trials_have_the_probabilities_of_outcomes(window_s):
    trials = 40_000
    decided = 0.8 * some_decided(8)
    density = heard(decided, 0.3, 0.04, 0.1)
    cell = np.repeat([0, 1], trials)
    seen = BinnedResponses(cell, np.zeros_like(cell), np.ones(len(cell)), GRID, 3.0, window_s)
    rt_s, response = seen.drawn(density, np.random.default_rng(81))
    mass, missing = seen.outcomes(density)
    never = response == -1
    assert np.array_equal(never, np.isnan(rt_s))
    assert ((rt_s >= window_s[0]) & (rt_s <= window_s[1]))[~never].all()
    for k in range(2):
        bins = np.where(never[cell == k], 0, np.nan_to_num(rt_s[cell == k]) / BIN_S).astype(int)
        place = np.where(never[cell == k], 2 * GRID.bins, GRID.bins * response[cell == k] + bins)
        counts = np.bincount(place, minlength=2 * GRID.bins + 1)
        expected = trials * np.append(mass[k].ravel(), missing[k])
        often = expected > 10
        assert counts[~often].sum() == pytest.approx(expected[~often].sum(), abs=60)
        square = ((counts - expected)[often] ** 2 / expected[often]).sum()
        assert 0.001 < chi2.sf(square, often.sum()) < 0.999
