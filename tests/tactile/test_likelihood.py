"""Likelihoods: right where a density is known, calibrated on unseen taps, silent on noise."""

import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import binned_statistic, norm

from bgmodel.support.seeds import stream
from bgmodel.tactile.likelihood import _log_density, _silverman, _thinned, fit_likelihood
from tests.helpers import refused, refusing


def as_they_are(pool):
    return list(pool)


def normal_pool(gap, taps=1000, seed=1):
    rng = stream(seed, "likelihood", gap)
    return [rng.normal(-gap / 2, 20, taps), rng.normal(gap / 2, 20, taps)]


@pytest.mark.parametrize("period", [None, 180.0])
@pytest.mark.parametrize("step", [0.5, 1.0])
def test_the_density_of_taps_that_say_the_same_is_the_kernel(period, step):
    grid = np.arange(-90, 90 + step, step)
    logs = _log_density(np.full(50, 10.0), grid, period, 50)
    np.testing.assert_allclose(np.exp(logs) / step, norm.pdf(grid, 10, 1), atol=1e-7)


def test_a_bandwidth_is_silvermans_of_a_spread_that_a_few_wild_readings_leave():
    """Silverman (1986, eq. 3.31), 0.9 A n^(-1/5): of sd 12 and 32 taps it is 5.4."""
    normal = 12 * norm.ppf((np.arange(4000) + 0.5) / 4000)
    assert _silverman(normal, None, 32) == pytest.approx(5.4, rel=2e-3)
    assert _silverman(normal, None, 1024) == pytest.approx(2.7, rel=2e-3)
    wild = np.concatenate([normal, np.full(40, 3000.0), np.full(40, -3000.0)])
    assert _silverman(wild, None, 32) == pytest.approx(5.4, rel=0.05)
    # Of two values the sd is the smaller spread; where most taps are alike, the only one.
    flat = np.where(np.arange(4000) % 2, 12.0, -12.0)
    assert _silverman(flat, None, 32) == pytest.approx(5.4)
    alike = np.where(np.arange(4000) < 3600, 0.0, 40.0)
    assert _silverman(alike, None, 32) == pytest.approx(0.45 * alike.std())


def test_the_log_ratio_of_two_gaussians_is_the_exact_one():
    likelihood = fit_likelihood(normal_pool(30, 20_000), as_they_are, (-180, 180))
    x = np.linspace(-30, 30, 13)
    fitted = np.diff(likelihood(x))[:, 0]
    exact = norm.logpdf(x, 15, 20) - norm.logpdf(x, -15, 20)
    # Smoothing widens a density of sd 20 by a few per cent, which pulls ratios towards 0.
    assert np.abs(fitted - exact).max() < 0.15 + 0.1 * np.abs(exact).max()
    assert np.corrcoef(fitted, exact)[0, 1] > 0.995


def test_no_difference_gives_no_evidence():
    """Without shrinkage, two samples of one density do seem to differ: the over-fit to avoid."""
    pools = (normal_pool(0, 500, seed) for seed in range(20))
    silent = [fit_likelihood(pool, as_they_are, (-180, 180)).shrink for pool in pools]
    # A gain above one standard error comes by chance about one time in six.
    assert np.count_nonzero(silent) <= 8
    assert np.median(silent) == 0
    raw = [_log_density(x, np.linspace(-180, 180, 721), None, 500) for x in normal_pool(0, 500, 3)]
    assert np.abs(raw[0] - raw[1])[280:441].max() > 0.1


@pytest.mark.parametrize("taps", [(400, 400), (2000, 90)])
def test_left_out_the_cap_is_the_odds_that_so_many_taps_could_contradict(taps):
    """Odds of n to 1 need n taps; of two kinds of stimulus, the one with fewer taps counts."""
    rng = stream(1, "likelihood", taps)
    pool = [rng.normal(-100, 20, taps[0]), rng.normal(100, 20, taps[1])]
    likelihood = fit_likelihood(pool, as_they_are, (-180, 180))
    ratio = np.abs(np.diff(likelihood(np.linspace(-170, 170, 99))))
    assert np.exp(ratio.max()) == pytest.approx(min(taps))


def test_a_likelihood_takes_four_taps_per_inner_fold_and_is_known_at_each_half_degree():
    few = normal_pool(80, 40)
    likelihood = fit_likelihood(few, as_they_are, (-180, 180))
    np.testing.assert_allclose(np.diff(likelihood.grid_deg), 0.5)
    with refused("pool at least 40 taps of each kind"):
        fit_likelihood([few[0], few[1][1:]], as_they_are, (-180, 180))


@pytest.mark.parametrize("rows", [7918, 7920, 8000])
def test_a_part_of_many_pairs_has_about_as_many_of_each_tap(rows):
    """Pairs come in rows, one per tap: none is taken twice, whatever the length of a row."""
    pairs = np.arange(10 * rows)
    some = _thinned(pairs)
    assert len(np.unique(some)) == len(some) == 4000
    in_row = np.bincount(some // rows, minlength=10)
    assert np.abs(in_row - 400).max() < 40
    for few in (pairs[:3999], pairs[:4000]):
        assert np.array_equal(_thinned(few), few)


def test_stated_posteriors_are_observed():
    pool, fresh = normal_pool(30, 3000), normal_pool(30, 20_000, seed=2)
    likelihood = fit_likelihood(pool, as_they_are, (-180, 180))
    hit = np.repeat([[1, 0], [0, 1]], 20_000, axis=0).ravel()
    # The control: ratios twice too large are not calibrated.
    for times, calibrated in ((1, True), (2, False)):
        stated = softmax(times * likelihood(np.concatenate(fresh)), axis=1).ravel()
        observed, ends, index = binned_statistic(stated, hit, bins=10, range=(0, 1))
        off = observed - binned_statistic(stated, stated, bins=ends)[0]
        often = np.bincount(index, minlength=11)[1:11] > 500
        assert (np.abs(off[often]).max() < 0.05) == calibrated
        assert calibrated or np.abs(off[often]).max() > 0.1


FITTED = fit_likelihood(normal_pool(9), as_they_are, (-180, 180))
test_bad_input_gets_one_clear_sentence = refusing(
    (lambda: fit_likelihood(normal_pool(1, 10), as_they_are, (-9, 9)), "pool at least 40 taps"),
    (lambda: fit_likelihood([np.full(50, np.nan)] * 2, as_they_are, (-9, 9)), "readings"),
    (lambda: FITTED(181.0), "reading_deg covers -180..180 degrees"),
    (lambda: FITTED(np.nan), "reading_deg finite degrees"),
)


def test_inner_folds_without_a_reading_are_left_out_or_refused():
    pool = normal_pool(80, 60)

    def late(part, pool):
        # Readings of the second hypothesis come from few taps.
        return [pool[0], pool[1][pool[1] > part]]

    some = np.sort(pool[1])[-4] - 1e-9
    fitted = fit_likelihood(pool, lambda p: late(some, p), (-180, 180))
    assert fitted.shrink > 0
    with refused("pool too few taps to judge"):
        # A small part of the taps never gives a reading of the second hypothesis.
        fit_likelihood(pool, lambda p: [p[0], p[1] if len(p[1]) > 30 else p[1][:0]], (-180, 180))
