"""Trial-by-trial measures of two integrators, and the agreement expected by chance.

Chance: two integrators run on trials of the same truth agree although neither sees the evidence of
the other. The chance level is the mean over all pairs of two different trials of one truth, in
closed form (Cohen 1960 for one truth); without a truth, over all pairs. Every measure is an
expression in weights of trials, (B, trials), so that it gives the value and its resamples.
"""

from __future__ import annotations

import numpy as np

from bgmodel.deciding.tradeoff import ChoicesAndTimes
from circuits.arrays import Array, Integers

NEAR_MS = 50.0
"""Decisions count as near in time if their lag differs from the median lag by at most this, ms."""
ROUNDING_MS = 1e-6
"""Sums of times that differ by less count as equal."""


def side_by_side(
    test: ChoicesAndTimes,
    other: ChoicesAndTimes,
    truth: Integers | None,
    weights: Array,
    *,
    again: ChoicesAndTimes | None = None,
) -> dict[str, Array]:
    """Return the trial-by-trial measures by name, (B,) each."""
    x, y = test.time_ms, other.time_ms
    late = y - x - float(np.median(y - x))
    r = correlation(x, y, weights)
    same = (test.choice == other.choice).astype(np.float64)
    strata = np.zeros(len(x), dtype=np.int64) if truth is None else truth
    share, chance = mean(same, weights), by_chance(test.choice, other.choice, strata, weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        corrected = (share - chance) / (1 - chance)
    measures = {
        "agreement": share,
        "agreement_chance": chance,
        "agreement_corrected": np.where(chance < 1, corrected, np.nan),
        "within_50_ms": mean((np.abs(late) <= NEAR_MS + ROUNDING_MS).astype(np.float64), weights),
        "pearson_r": r,
        "test_ms": mean(x, weights),
    }
    if again is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            measures["r_noise_corrected"] = r / np.sqrt(correlation(y, again.time_ms, weights))
    if truth is not None:
        wrong = (test.choice != truth).astype(np.float64)
        measures["test_accuracy"] = 1 - mean(wrong, weights)
        measures["accuracy"] = mean((other.choice == truth).astype(np.float64), weights)
        with np.errstate(invalid="ignore"):  # the test may make no errors
            measures["error_agreement"] = mean(same, weights * wrong)
    return measures


def by_chance(x: Integers, y: Integers, strata: Integers, weights: Array) -> Array:
    """Return the share of equal values of x and y in different trials of one stratum, (B,).

    Strata are weighted by their trials; those without two trials are left out.
    """
    total, counted = np.zeros(len(weights)), np.zeros(len(weights))
    for stratum in np.unique(strata):
        here = strata == stratum
        first, second, w = x[here], y[here], weights[:, here]
        kinds = np.union1d(first, second)[:, None]
        weight, itself = w.sum(axis=1), w * w
        pairs = weight**2 - itself.sum(axis=1)
        known = pairs > 0
        met = ((w @ (first == kinds).T) * (w @ (second == kinds).T)).sum(axis=1)
        met -= itself @ (first == second)
        total += weight * np.divide(met, pairs, out=np.zeros_like(met), where=known)
        counted += np.where(known, weight, 0)
    return np.divide(total, counted, out=np.full_like(total, np.nan), where=counted > 0)


def correlation(x: Array, y: Array, weights: Array) -> Array:
    """Return Pearson's correlation, (B,); NaN if x or y is constant."""
    x, y = x - x.mean(), y - y.mean()
    product, mx, my = mean(x * y, weights), mean(x, weights), mean(y, weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.sqrt((mean(x * x, weights) - mx**2) * (mean(y * y, weights) - my**2))
        return np.asarray((product - mx * my) / spread)


def mean(values: Array, weights: Array) -> Array:
    """Return the weighted mean of values (trials,), (B,)."""
    return np.asarray(weights @ values / weights.sum(axis=1))
