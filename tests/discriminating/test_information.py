"""Information per trial against closed forms, its bias and its error."""

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel import stream
from bgmodel.discriminating.information import (
    BINS,
    CORRECT,
    MISSED,
    OTHER,
    Partition,
    Recorded,
    divergence,
    information,
)

MEAN_MS, SD_MS, APART_MS = 500.0, 100.0, 50.0


def timed(mean_ms, trials, seed):
    times = mean_ms + SD_MS * stream(seed, "times").standard_normal(trials)
    return Recorded(np.full(trials, CORRECT), times)


def chosen(share, trials, seed):
    """Return trials with one bin per choice: the times are all alike."""
    right = stream(seed, "choices").random(trials) < share
    return Recorded(np.where(right, CORRECT, OTHER), np.full(trials, MEAN_MS))


def test_two_gaussians_have_the_divergence_of_their_bins():
    true, other = timed(MEAN_MS, 40_000, 1), timed(MEAN_MS + APART_MS, 40_000, 2)
    estimate, [bins] = information([true], [other], [1.0])
    cuts = np.concatenate([[-np.inf], bins.edges[CORRECT], [np.inf]])
    p, q = (np.diff(norm.cdf(cuts, mean, SD_MS)) for mean in (MEAN_MS, MEAN_MS + APART_MS))
    exact = float(p @ np.log(p / q))
    assert len(p) == BINS
    assert abs(estimate.nats - exact) < 4 * estimate.error < 0.02
    # Bins lose some of what times tell: (apart / sd)^2 / 2 nats.
    assert 0.8 * APART_MS**2 / (2 * SD_MS**2) < estimate.nats < APART_MS**2 / (2 * SD_MS**2)


def test_choices_have_the_divergence_of_two_proportions():
    estimate, _ = information([chosen(0.9, 40_000, 1)], [chosen(0.8, 40_000, 2)], [1.0])
    exact = 0.9 * np.log(0.9 / 0.8) + 0.1 * np.log(0.1 / 0.2)
    assert abs(estimate.nats - exact) < 4 * estimate.error < 0.02


def test_a_model_against_itself_tells_nothing_within_the_error():
    """Thirty pairs of independent samples: the mean is 0, where the plain estimate is biased."""
    corrected, plain, errors = [], [], []
    for seed in range(30):
        both = [timed(MEAN_MS, 600, 10 * seed + k) for k in (1, 2)]
        estimate, _ = information([both[0]], [both[1]], [1.0])
        corrected.append(estimate.nats)
        plain.append(estimate.plain_nats)
        errors.append(estimate.error)
    spread = np.std(corrected) / np.sqrt(len(corrected))
    assert abs(np.mean(corrected)) < 3 * spread
    assert np.mean(plain) > 6 * spread
    # (bins - 1) / trials for two independent samples
    assert np.mean(plain) == pytest.approx((BINS - 1) / 600, rel=0.4)
    beyond = np.mean(np.asarray(corrected) > 1.96 * np.asarray(errors))
    assert beyond <= 0.1
    assert 0.7 < np.mean(errors) / np.std(corrected) < 2.5


def test_the_same_trials_tell_exactly_nothing():
    one = timed(MEAN_MS, 500, 1)
    estimate, _ = information([one], [one], [1.0])
    assert (estimate.nats, estimate.error) == (0.0, 0.0)


def test_common_random_numbers_reduce_the_error():
    one = timed(MEAN_MS, 2000, 1)
    paired, _ = information([one], [one.later(5.0)], [1.0])
    apart, _ = information([one], [timed(MEAN_MS + 5.0, 2000, 2)], [1.0])
    assert paired.error < 0.7 * apart.error


def test_missed_trials_have_a_bin_without_times():
    one = timed(MEAN_MS, 500, 1)
    late = Recorded(np.where(np.arange(500) < 100, MISSED, CORRECT), np.full(500, np.nan))
    bins = Partition.of(one)
    assert (bins.place(late)[:100] == bins.bins - 1).all()
    assert (bins.place(one) < bins.bins - 1).all()


def test_kinds_of_trials_count_by_their_share():
    same, true, other = chosen(0.5, 4000, 1), chosen(0.9, 4000, 2), chosen(0.6, 4000, 3)
    alone, _ = information([true], [other], [1.0])
    mixed, _ = information([same, true], [same, other], [0.75, 0.25])
    assert mixed.nats == pytest.approx(0.25 * alone.nats, rel=1e-9)
    assert divergence([same, true], [same, other], [0.75, 0.25]) == pytest.approx(mixed.plain_nats)
    assert mixed.weights.sum() == pytest.approx(1)
