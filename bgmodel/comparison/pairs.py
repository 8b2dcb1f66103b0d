"""Trial-by-trial measures of two integrators, and their chance levels.

Chance: two integrators run on trials of the same truth agree although neither sees the evidence of
the other. The chance level is the mean over all pairs of two different trials of one truth, in
closed form (Cohen 1960 for one truth); without a truth, over all pairs. Every measure is an
expression in weights of trials, (B, trials), so that it gives the value and its resamples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.deciding.tradeoff import ChoicesAndTimes
from circuits.arrays import Array, Integers, Truths

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
    from scipy.stats import rankdata

    x, y = test.time_ms, other.time_ms
    lag_ms = float(np.median(y - x))
    late = y - x - lag_ms
    r = correlation(x, y, weights)
    strata = np.zeros(len(x), dtype=np.int64) if truth is None else truth
    measures = _against_chance("agreement", SameChoice(test.choice, other.choice), strata, weights)
    measures |= _against_chance("within_50_ms", NearInTime(x, y, lag_ms), strata, weights)
    measures |= {
        "pearson_r": r,
        "pearson_r_chance": _shuffled_correlation(x, y, strata, weights),
        "spearman_r": correlation(rankdata(x), rankdata(y), weights),
        "residual_sd_ms": np.sqrt(mean(late**2, weights) - mean(late, weights) ** 2),
        "test_ms": mean(x, weights),
    }
    if again is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            measures["r_noise_corrected"] = r / np.sqrt(correlation(y, again.time_ms, weights))
    if truth is not None:
        wrong = (test.choice != truth).astype(np.float64)
        measures["test_accuracy"] = 1 - mean(wrong, weights)
        measures["accuracy"] = mean((other.choice == truth).astype(np.float64), weights)
        same = SameChoice(test.choice, other.choice)
        measures |= _against_chance("error_agreement", same, strata, weights, wrong)
    return measures


@dataclass(frozen=True)
class SameChoice:
    """Whether trial n of the test and trial m of the other have the same choice."""

    test: Integers
    other: Integers

    def own(self) -> Array:
        """Return the value of each trial with itself, (trials,)."""
        return np.asarray(self.test == self.other, dtype=np.float64)

    def summed(self, here: Truths, first: Array, second: Array) -> Array:
        """Return the weighted sum over all pairs of trials ``here``, (B,)."""
        x, y = self.test[here], self.other[here]
        kinds = np.union1d(x, y)[:, None]
        return np.asarray(((first @ (x == kinds).T) * (second @ (y == kinds).T)).sum(axis=1))


@dataclass(frozen=True)
class NearInTime:
    """Whether trial m of the other is within 50 ms of the median lag after trial n of the test."""

    test_ms: Array
    other_ms: Array
    lag_ms: float

    def own(self) -> Array:
        """Return the value of each trial with itself, (trials,)."""
        late = self.other_ms - self.test_ms - self.lag_ms
        return (np.abs(late) <= NEAR_MS + ROUNDING_MS).astype(np.float64)

    def summed(self, here: Truths, first: Array, second: Array) -> Array:
        """Return the weighted sum over all pairs of trials ``here``, (B,)."""
        order = np.argsort(self.other_ms[here])
        rising, due = self.other_ms[here][order], self.test_ms[here] + self.lag_ms
        up_to = np.cumsum(np.pad(second[:, order], ((0, 0), (1, 0))), axis=1)
        end = np.searchsorted(rising, due + NEAR_MS + ROUNDING_MS, side="right")
        begin = np.searchsorted(rising, due - NEAR_MS - ROUNDING_MS, side="left")
        return np.asarray((first * (up_to[:, end] - up_to[:, begin])).sum(axis=1))


@dataclass(frozen=True)
class Product:
    """Product of a value of the test in trial n and of the other in trial m."""

    test: Array
    other: Array

    def own(self) -> Array:
        """Return the value of each trial with itself, (trials,)."""
        return np.asarray(self.test * self.other)

    def summed(self, here: Truths, first: Array, second: Array) -> Array:
        """Return the weighted sum over all pairs of trials ``here``, (B,)."""
        return np.asarray((first @ self.test[here]) * (second @ self.other[here]))


def by_chance(
    of_pair: SameChoice | NearInTime | Product, strata: Integers, first: Array, second: Array
) -> Array:
    """Return the mean of a quantity over pairs of different trials of one stratum, (B,).

    Strata are weighted by ``first``, the weights of the test's trials (B, trials); strata without
    two trials are left out.
    """
    total, counted = np.zeros(len(first)), np.zeros(len(first))
    with_itself = of_pair.own()
    for stratum in np.unique(strata):
        here = strata == stratum
        u, w = first[:, here], second[:, here]
        both, weight = u * w, u.sum(axis=1)
        pairs = weight * w.sum(axis=1) - both.sum(axis=1)
        known = pairs > 0
        met = of_pair.summed(here, u, w) - both @ with_itself[here]
        total += weight * np.divide(met, pairs, out=np.zeros_like(met), where=known)
        counted += np.where(known, weight, 0)
    return np.divide(total, counted, out=np.full_like(total, np.nan), where=counted > 0)


def _against_chance(
    name: str,
    of_pair: SameChoice | NearInTime,
    strata: Integers,
    weights: Array,
    among: Array | None = None,
) -> dict[str, Array]:
    """Return a share, its chance level and ``(share - chance) / (1 - chance)``.

    ``among`` is 1 for the trials of the test that count, 0 for others; by default all count.
    """
    counted = weights if among is None else weights * among
    with np.errstate(invalid="ignore", divide="ignore"):
        share = mean(of_pair.own(), counted)
        chance = by_chance(of_pair, strata, counted, weights)
        corrected = (share - chance) / (1 - chance)
    return {
        name: share,
        f"{name}_chance": chance,
        f"{name}_corrected": np.where(chance < 1, corrected, np.nan),
    }


def _shuffled_correlation(x: Array, y: Array, strata: Integers, weights: Array) -> Array:
    """Return the correlation over pairs of different trials of one stratum, (B,)."""
    x, y = x - x.mean(), y - y.mean()
    product = by_chance(Product(x, y), strata, weights, weights)
    return _correlation(product, x, y, weights)


def correlation(x: Array, y: Array, weights: Array) -> Array:
    """Return Pearson's correlation, (B,); NaN if x or y is constant."""
    x, y = x - x.mean(), y - y.mean()
    return _correlation(mean(x * y, weights), x, y, weights)


def _correlation(product: Array, x: Array, y: Array, weights: Array) -> Array:
    mx, my = mean(x, weights), mean(y, weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.sqrt((mean(x * x, weights) - mx**2) * (mean(y * y, weights) - my**2))
        return np.asarray((product - mx * my) / spread)


def mean(values: Array, weights: Array) -> Array:
    """Return the weighted mean of values (trials,), (B,)."""
    return np.asarray(weights @ values / weights.sum(axis=1))
