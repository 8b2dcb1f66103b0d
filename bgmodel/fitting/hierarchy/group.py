"""The distribution of a group: means, standard deviations and correlations on the scale."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bgmodel.bootstrap import Z95
from bgmodel.fitting.parameters import SCALES, ParameterSpace
from bgmodel.support.compiling import compiled
from circuits.arrays import Array, Integers, Truths

LOWEST = -12.0
"""Lowest position on the scale: 6e-6 units above the lower end of the range."""
PARTS = 4
"""Typical value of a parameter above the lower end of its range, in units of the scale."""


@dataclass(frozen=True)
class Scale:
    """A parameter is ``low + unit log(1 + exp(x))``, at most ``high``, at x on the scale.

    Well above its lower bound it is linear in x, so that people are Gaussian in the parameter
    itself; near the bound, which it cannot cross, it is exponential.
    """

    low: Array
    high: Array
    unit: Array

    @classmethod
    def of(cls, space: ParameterSpace, typical: Array | None = None) -> Scale:
        """Return the scale for the free parameters of a fit, from ``typical`` values or starts.

        The unit is a quarter of the height above the lower bound; that of a coefficient follows
        from its parameter's default, and that of parameters that differ by factors from the range.
        """
        width = space.high - space.low
        above = (space.start if typical is None else typical) - space.low
        above = np.where(above > 1e-3 * width, above, width / 5)
        heights = {each.name: each.start - each.low for each in space.parameters}
        for k, each in enumerate(space.moved):
            if each.effect:
                above[k] = heights[each.parameter.name] / np.abs(each.weights).max()
        return cls(space.low, space.high, np.where(space.by_factors, width, above) / PARTS)

    @property
    def heights(self) -> Array:
        """Ranges of the parameters, in units of the scale, (parameters,)."""
        return np.asarray((self.high - self.low) / self.unit)

    def to(self, natural: Array) -> Array:
        """Return parameters (..., parameters) on the scale."""
        height = (np.asarray(natural, float) - self.low) / self.unit
        with np.errstate(divide="ignore"):
            scaled = height + np.log(-np.expm1(-height))
        return np.asarray(np.maximum(scaled, LOWEST))

    def back(self, scaled: Array) -> Array:
        """Return parameters (..., parameters) in their own units."""
        return np.asarray(np.minimum(self.low + self.unit * np.logaddexp(0, scaled), self.high))

    def slope(self, scaled: Array) -> Array:
        """Return the derivative of a parameter by its position on the scale."""
        return np.asarray(self.unit * np.exp(log_uniform(scaled)))


def log_uniform(scaled: Array) -> Array:
    """Return the log density on the scale of a uniform distribution, up to a constant."""
    return np.asarray(-np.logaddexp(0, -np.asarray(scaled)))


SPREAD, FREEDOM = 2.0, 3.0
"""Scale and degrees of freedom of the half-t prior of standard deviations between people: on the
scale, where the default value of a parameter is 4 above its lower bound."""
CORRELATED = 2.0
"""Degrees of freedom if people's parameters are correlated: correlations are uniform a priori."""
ALMOST = 0.01
"""Standard deviation between people, on the scale, of a parameter that they share: so small that
nobody differs visibly, and not 0, so that the same moves reach all parameters."""


@dataclass(frozen=True)
class Predictors:
    """Variables that differ between people and shift their parameters, such as a diagnosis."""

    names: tuple[str, ...]  # names of slopes, such as ``bound[group[T.patient]]``.
    # (slopes, people), with mean 0 over people, so that slopes do not depend on means, and a range
    # of 1
    columns: Array
    of: Integers  # (slopes,), the parameter that each moves
    widths: Array  # (slopes,), the range of each in its own unit

    def offsets(self, slopes: Array, size: int) -> Array:
        """Return by how much each person's mean differs from the group's, (people, parameters)."""
        offsets = np.zeros((self.columns.shape[1], size))
        for slope, column, k in zip(slopes, self.columns, self.of, strict=True):
            offsets[:, k] += slope * column
        return offsets


ALIKE = Predictors((), np.zeros((0, 0)), np.zeros(0, np.int64), np.ones(0))
"""No predictors: everyone has the mean of the group."""


# Of a group, for compiled functions: inverse of the correlations, priors of means, their highest
# values, and the parameters that are correlated, none if people are independent in all.
Law = tuple[Array, Array, Array, Integers]


@dataclass(frozen=True)
class Group:
    """People's parameters are Gaussian on the scale."""

    mean: Array
    variance: Array  # (parameters,), between people, on the scale
    highest: Array | float = np.inf  # Upper end of the range of each mean, on the scale.
    # Change of a person's mean, on the scale, per unit of each predictor.
    slopes: Array = field(default_factory=lambda: np.zeros(0))
    predictors: Predictors = ALIKE
    # Which parameters people share: their variance is ``ALMOST**2`` and is not drawn.
    shared: Truths | bool = False
    prior: Array | None = None  # Of the means, as from ``priors_of``; uniform if None.
    correlation: Array | None = None  # (parameters, parameters); independent if None.

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

    @cached_property
    def law(self) -> Law:
        """What the compiled functions of a group need."""
        size, free = len(self.mean), np.logical_not(self.shared)
        related = np.eye(size) if self.correlation is None else self.correlation
        prior = np.tile(FLAT, (size, 1)) if self.prior is None else self.prior
        highest = np.broadcast_to(self.highest, size).astype(float)
        if self.correlation is None:
            free = np.zeros(size, bool)
        which = np.flatnonzero(np.broadcast_to(free, size)).astype(np.int64)
        return np.asarray(np.linalg.inv(related)), prior, highest, which

    @property
    def precision(self) -> Array:
        """Inverse of the covariance between people, (parameters, parameters)."""
        sd = np.sqrt(self.variance)
        independent = self.correlation is None
        return np.diag(1 / self.variance) if independent else self.law[0] / np.outer(sd, sd)

    def with_law(self, inverse: Array, **changed: Array) -> Group:
        """Return the group with the inverse of its correlations, and other changes."""
        if self.correlation is not None:
            covariance = np.linalg.inv(inverse)
            sd = np.sqrt(np.diag(covariance))
            changed["correlation"] = covariance / np.outer(sd, sd)
        return replace(self, **changed)  # type: ignore[arg-type]

    def log_prior(self, scaled: Array) -> Array:
        """Return the log density of people's parameters (people, parameters), up to a constant."""
        away = scaled - self.means
        if self.correlation is None:
            return np.asarray(-0.5 * (away**2 / self.variance).sum(axis=-1))
        return np.asarray(-0.5 * ((away @ self.precision) * away).sum(axis=-1))

    def drawn(self, scaled: Array, rng: np.random.Generator) -> Group:
        """Return a draw from the conditional posterior given people's parameters on the scale.

        Means: as stated for the fit, or uniform. Standard deviations: half-t (Gelman 2006), a
        mixture of inverse gammas (Wand et al. 2011). Slopes: Gaussian. See ``draw_covariance``.
        """
        every, scaled = scaled, scaled - self.offsets
        people, size = scaled.shape
        mean, average = self.mean.copy(), scaled.mean(axis=0)
        sd, error = np.sqrt(self.variance), np.asarray(np.sqrt(self.variance / people))
        normal, uniform = np.asarray(rng.normal(size=size)), np.asarray(rng.uniform(size=size))
        for k in range(size):
            asked = asked_mean(k, mean, sd, average, error[k], normal[k], self.law)
            if np.log(uniform[k]) < gain_of_mean(k, mean[k], asked, self.law):
                mean[k] = asked
        if self.correlation is not None:
            inverse = self.law[0].copy()
            draw_covariance(scaled - mean, sd, (inverse, *self.law[1:]), rng)
            group = self.with_law(inverse, mean=mean, variance=sd**2)
        else:
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
        inverse, away = self.law[0], scaled - self.means
        moved = np.array([shift(z, k, inverse) for z in away / np.sqrt(self.variance)])
        rest = away[:, k] - np.sqrt(self.variance[k]) * moved + self.slopes[n] * column
        own = self.variance[k] / inverse[k, k]
        precision = (column**2).sum() / own + 1 / SPREAD**2
        middle = (column @ rest) / own / precision
        slopes = self.slopes.copy()
        slopes[n] = middle + rng.normal() / np.sqrt(precision)
        return replace(self, slopes=slopes)

    def log_own_prior(self) -> float:
        """Return the log prior total of means and standard deviations given correlations."""
        inverse, prior, highest, unshared = self.law
        if (self.mean > highest).any():
            return -np.inf
        sd, total = np.sqrt(self.variance), 0.0
        for k in range(len(self.mean)):
            total += log_mean(self.mean[k], prior[k]) + log_sd(sd[k], inverse[k, k], len(unshared))
        return total


FLAT = (0.0, 1.0, 0.0, 0.0, np.inf, 0.0, 0.0)
"""Row of ``priors_of`` of a mean with a uniform prior over the range of its parameter."""


def priors_of(space: ParameterSpace, scale: Scale) -> Array:
    """Return the priors of a group's means, (parameters, 7), for ``log_mean``.

    Lower end and unit on ``scale``, number of the own scale, mean and sd on it; mean and precision
    of the nearest Gaussian on ``scale``.
    """
    rows = np.tile(FLAT, (len(space.moved), 1))
    ends = np.stack([space.low, space.high], axis=1)
    for name, interval in space.stated.items():
        ends[space.names.index(name)] = interval
    first, last = scale.to(np.clip(ends.T, space.low, space.high))
    for k, each in enumerate(space.moved):
        if each.stated and each.parameter.prior is not None:
            median, sd = each.parameter.prior
            kind, middle = list(SCALES).index(each.parameter.scale), each.parameter.scaled(median)
            near = (first[k] + last[k]) / 2, (2 * Z95 / (last[k] - first[k])) ** 2
            rows[k] = (scale.low[k], scale.unit[k], kind, float(middle), sd, *near)
    return rows


@compiled
def log_mean(mean: float, prior: Array) -> float:
    """Return the log prior density of a mean on the scale, up to a constant."""
    low, unit, kind, middle, sd, _, _ = prior
    density = -np.logaddexp(0.0, -mean)
    if sd == np.inf:
        return float(density)
    at = low + unit * np.logaddexp(0.0, mean)
    if kind == 1:
        density, at = density - np.log(at), np.log(at)
    elif kind == 2:
        density, at = density - np.log(at) - np.log1p(-at), np.log(at) - np.log1p(-at)
    elif kind == 3:
        density, at = density - np.log1p(-(at**2)), np.arctanh(at)
    return float(density - ((at - middle) / sd) ** 2 / 2)


@compiled
def log_sd(sd: float, inverse: float, correlated: int) -> float:
    """Return the log prior density of a standard deviation, up to a constant.

    Half-t; with correlations given the inverse of these (Huang & Wand 2013).
    """
    freedom = CORRELATED if correlated else FREEDOM
    tails = np.log(inverse + sd**2 / (freedom * SPREAD**2))
    return float(-(freedom + max(correlated, 1)) / 2 * tails)


@compiled
def shift(scores: Array, k: int, inverse: Array) -> float:
    """Return the expectation of a standard score given all others."""
    total = 0.0
    for j in range(len(scores)):
        if j != k:
            total -= inverse[k, j] * scores[j]
    return total / float(inverse[k, k])


@compiled
def asked_mean(
    k: int, mean: Array, sd: Array, average: Array, error: float, normal: float, law: Law
) -> float:
    """Return a proposal for a mean given people and the other means; see ``gain_of_mean``."""
    inverse, prior, _, _ = law
    middle = average[k] + sd[k] * -shift((average - mean) / sd, k, inverse)
    spread = error / np.sqrt(inverse[k, k])
    pull = prior[k, 6] / (prior[k, 6] + 1 / spread**2)
    middle += pull * (prior[k, 5] - middle)
    return float(middle + spread * np.sqrt(1 - pull) * normal)


@compiled
def gain_of_mean(k: int, now: float, asked: float, law: Law) -> float:
    """Return the log ratio at which ``asked_mean`` is accepted."""
    _, prior, highest, _ = law
    if asked > highest[k]:
        return -np.inf
    near = prior[k, 6] / 2 * ((asked - prior[k, 5]) ** 2 - (now - prior[k, 5]) ** 2)
    return float(log_mean(asked, prior[k]) - log_mean(now, prior[k]) + near)


@compiled
def draw_covariance(away: Array, sd: Array, law: Law, rng: np.random.Generator) -> None:
    """Draw, in place, standard deviations and inverse correlations given people's distances.

    Inverse-Wishart given a scale of each parameter (Huang & Wand 2013).
    """
    inverse, _, _, which = law
    size = len(which)
    scatter = np.zeros((size, size))
    for a in range(size):
        k = which[a]
        rate = CORRELATED * inverse[k, k] / sd[k] ** 2 + 1 / SPREAD**2
        mixing = rate / rng.standard_gamma((CORRELATED + size) / 2)
        scatter[a, a] = 2 * CORRELATED / mixing
        for b in range(size):
            scatter[a, b] += (away[:, k] * away[:, which[b]]).sum()
    # The precision is Wishart: Bartlett's decomposition, with any root of the inverse scatter.
    root = np.zeros((size, size))
    for a in range(size):
        freedom = CORRELATED + size - 1 + len(away) - a
        root[a, a] = np.sqrt(2 * rng.standard_gamma(freedom / 2))
        for b in range(a):
            root[a, b] = rng.normal()
    lower = np.linalg.cholesky(scatter)
    variance = (np.linalg.solve(root, lower.T) ** 2).sum(axis=0)
    half = np.linalg.solve(lower.T, root)
    for a in range(size):
        sd[which[a]] = np.sqrt(variance[a])
        half[a] *= sd[which[a]]
    for a in range(size):
        for b in range(size):
            inverse[which[a], which[b]] = (half[a] * half[b]).sum()


def group_of(means: Array, variances: Array | None = None, shared: Truths | bool = False) -> Group:
    """Return mean and variance of people's estimates (people, parameters), with their errors."""
    spread = means.var(axis=0)
    if variances is not None:
        spread = spread + variances.mean(axis=0)
    people = len(means)
    pulled = (people * spread + FREEDOM * SPREAD**2 / 20) / (people + FREEDOM)
    variance = np.where(shared, ALMOST**2, pulled)
    return Group(means.mean(axis=0), variance, shared=shared)
