"""The distribution of a group: a mean and a standard deviation of each parameter on the scale."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from bgmodel.fitting.hierarchy.scale import log_uniform
from bgmodel.support.arrays import Array, Integers, Truths

SPREAD, FREEDOM = 2.0, 3.0
"""Scale and degrees of freedom of the half-t prior of standard deviations between people: on the
scale, where the default value of a parameter is 4 above its lower bound."""
ALMOST = 0.01
"""Standard deviation between people, on the scale, of a parameter that they share: so small that
nobody differs visibly, and not 0, so that the same moves reach all parameters."""


@dataclass(frozen=True)
class Predictors:
    """Variables that differ between people and shift their parameters, such as a diagnosis."""

    names: tuple[str, ...]  # names of slopes, such as ``bound[group[T.patient]]``.
    # (slopes, people), with mean 0 over people, so that slopes do not depend on means
    columns: Array
    of: Integers  # (slopes,), the parameter that each moves

    def offsets(self, slopes: Array, size: int) -> Array:
        """Return by how much each person's mean differs from the group's, (people, parameters)."""
        offsets = np.zeros((self.columns.shape[1], size))
        for slope, column, k in zip(slopes, self.columns, self.of, strict=True):
            offsets[:, k] += slope * column
        return offsets


ALIKE = Predictors((), np.zeros((0, 0)), np.zeros(0, np.int64))
"""No predictors: everyone has the mean of the group."""


@dataclass(frozen=True)
class Group:
    """People's parameters are Gaussian on the scale, independent of each other."""

    mean: Array
    variance: Array  # (parameters,), between people, on the scale
    highest: Array | float = np.inf  # Upper end of the range of each mean, on the scale.
    # Change of a person's mean, on the scale, per unit of each predictor.
    slopes: Array = field(default_factory=lambda: np.zeros(0))
    predictors: Predictors = ALIKE
    # Which parameters people share: their variance is ``ALMOST**2`` and is not drawn.
    shared: Truths | bool = False

    @property
    def offsets(self) -> Array | float:
        """By how much each person's mean differs from that of the group, (people, parameters)."""
        if not len(self.slopes):
            return 0.0
        return self.predictors.offsets(self.slopes, len(self.mean))

    @property
    def means(self) -> Array:
        """Each person's mean, (people, parameters), or (parameters,) without predictors."""
        return np.asarray(self.mean + self.offsets)

    def log_prior(self, scaled: Array) -> Array:
        """Return the log density of people's parameters (people, parameters), up to a constant."""
        return np.asarray(-0.5 * ((scaled - self.means) ** 2 / self.variance).sum(axis=-1))

    def drawn(self, scaled: Array, rng: np.random.Generator) -> Group:
        """Return a draw from the conditional posterior given people's parameters on the scale.

        The prior of each mean is uniform over the range of the parameter, and accepts or rejects a
        draw under one that is uniform on the scale. That of each standard deviation is half-t with
        ``FREEDOM`` degrees of freedom and scale ``SPREAD`` (Gelman 2006), a mixture of inverse
        gammas (Wand et al. 2011); that of slopes is Gaussian with standard deviation ``SPREAD``.
        """
        every, scaled = scaled, scaled - self.offsets
        people, size = scaled.shape
        asked = scaled.mean(axis=0) + np.sqrt(self.variance / people) * rng.normal(size=size)
        ratio = log_uniform(asked) - log_uniform(self.mean)
        taken = (asked <= self.highest) & (np.log(rng.uniform(size=size)) < ratio)
        mean = np.where(taken, asked, self.mean)
        rate = FREEDOM / self.variance + 1 / SPREAD**2
        mixing = rate / rng.gamma((FREEDOM + 1) / 2, size=size)
        squares = ((scaled - mean) ** 2).sum(axis=0)
        shape = (FREEDOM + people) / 2
        variance = (FREEDOM / mixing + squares / 2) / rng.gamma(shape, size=size)
        variance = np.where(self.shared, self.variance, variance)
        group = replace(self, mean=mean, variance=variance)
        for n in range(len(self.slopes)):
            group = group._slope_drawn(n, every, rng)
        return group

    def _slope_drawn(self, n: int, scaled: Array, rng: np.random.Generator) -> Group:
        """Return the group with a draw of one slope, given people and the rest of the group."""
        k, column = self.predictors.of[n], self.predictors.columns[n]
        rest = (scaled - self.means)[:, k] + self.slopes[n] * column
        precision = (column**2).sum() / self.variance[k] + 1 / SPREAD**2
        middle = (column @ rest) / self.variance[k] / precision
        slopes = self.slopes.copy()
        slopes[n] = middle + rng.normal() / np.sqrt(precision)
        return replace(self, slopes=slopes)

    def log_own_prior(self) -> float:
        """Return the log prior density of means and standard deviations, up to a constant."""
        if (self.mean > self.highest).any():
            return -np.inf
        tails = (FREEDOM + 1) / 2 * np.log1p(self.variance / (FREEDOM * SPREAD**2))
        return float((log_uniform(self.mean) - tails).sum())


def group_of(means: Array, variances: Array | None = None, shared: Truths | bool = False) -> Group:
    """Return the mean and variance of people's estimates (people, parameters), as a start.

    Their error variances are added, as in the EM algorithm.
    """
    spread = means.var(axis=0)
    if variances is not None:
        spread = spread + variances.mean(axis=0)
    people = len(means)
    pulled = (people * spread + FREEDOM * SPREAD**2 / 20) / (people + FREEDOM)
    variance = np.where(shared, ALMOST**2, pulled)
    return Group(means.mean(axis=0), variance, shared=shared)
