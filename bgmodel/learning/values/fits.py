"""Fits of models of value learning to one person: estimates, intervals, left-out trials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from bgmodel.learning.values.diffusion import log_density
from bgmodel.learning.values.models import ValueModel, model_of
from bgmodel.learning.values.people import PairTrials
from bgmodel.support.arrays import Array, Truths
from bgmodel.support.checks import whole
from bgmodel.support.seeds import stream
from circuits.errors import InputError

STEP = 1e-4
"""Step of differences for gradients, on the scale of the fit."""
CURVED = 1e-2
"""Step of differences for the curvature at the maximum."""
FURTHEST = 5.0
"""Largest distance of a parameter from its prior median, in standard deviations of the prior."""
STARTS = (0.0, -1.0, 1.0)
"""Starting points of the special parameters, standard deviations from the prior median."""
BLOCK = 100
"""Sets of parameters evaluated at a time; more no longer fit into a processor's cache."""
FREEDOM = 5
"""Degrees of freedom of the distribution from which posterior draws are proposed."""


@dataclass(frozen=True, eq=False)
class ValueFit:
    """A model fitted to one person: the maximum of likelihood times prior.

    Parameters
    ----------
    model : ValueModel
    person : PairTrials
    at : array (parameters,)
        Estimates on the scale of the fit.
    kept : bool array (trials,)
        Trials whose likelihood was fitted; values follow from all trials.
    fixed : dict
        Parameters that are not fitted, by name.
    """

    model: ValueModel
    person: PairTrials
    at: Array
    kept: Truths
    fixed: dict[str, float]

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name."""
        return {name: float(x) for name, x in self.model.natural(self.at).items()}

    @property
    def free(self) -> Truths:
        """Which parameters are fitted, (parameters,)."""
        return np.asarray([name not in self.fixed for name in self.model.names])

    @cached_property
    def each(self) -> Array:
        """Logarithm of the density of every trial, (trials,)."""
        return np.asarray(log_likelihood(self.model, self.person, self.at[None])[0])

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of the trials that were fitted."""
        return float(self.each[self.kept].sum())

    @property
    def bic(self) -> float:
        """Bayesian information criterion, of a maximum that includes the weak priors."""
        trials = int(self.kept.sum())
        return float(-2 * self.log_likelihood + self.free.sum() * np.log(trials))

    def posterior(self, seed: int, draws: int = 1000) -> tuple[Array, Array]:
        """Return draws (draws, parameters) on the scale of the fit, and their weights.

        Importance sampling from a multivariate t distribution, at first at the maximum with its
        curvature, then twice with the mean and covariance of the weighted draws; a third as many
        draws are made in the first two stages.

        Parameters
        ----------
        seed : int
            Seed of the draws.
        draws : int
            Their number.
        """
        rng = stream(seed, "posterior", self.model.name)
        middle, spread = self.at[self.free], _covariance(self)
        draws = whole("draws", draws, 300)
        for number in (draws // 3, draws // 3, draws):
            found, log_q = _proposed(rng, middle, spread, number)
            weights = _weights(self._objective(found) - log_q)
            middle = weights @ found
            away = found - middle
            spread = (weights[:, None] * away).T @ away + 1e-6 * np.eye(len(middle))
        return self._complete(found), weights

    def intervals(self, seed: int, share: float = 0.9) -> dict[str, tuple[float, float]]:
        """Return the central posterior interval of each fitted parameter, by name."""
        found, weights = self.posterior(seed)
        ends = ((1 - share) / 2, (1 + share) / 2)
        known: dict[str, tuple[float, float]] = {}
        for k in np.flatnonzero(self.free):
            order = np.argsort(found[:, k])
            reached = np.cumsum(weights[order]) - weights[order] / 2
            low, high = np.interp(ends, reached, found[order, k])
            each = self.model.parameters[k]
            known[each.name] = (float(each.natural(low)), float(each.natural(high)))
        return known

    def _complete(self, free: Array) -> Array:
        """Return all parameters (sets, parameters) from those that are fitted."""
        found = np.repeat(self.at[None], len(free), axis=0)
        found[:, self.free] = free
        return found

    def _objective(self, free: Array) -> Array:
        """Return the log-likelihood plus log-prior, (sets,)."""
        every = self._complete(free)
        found = self.model.log_prior(every)
        for first in range(0, len(every), BLOCK):
            part = slice(first, first + BLOCK)
            each = log_likelihood(self.model, self.person, every[part])
            found[part] += each[:, self.kept].sum(axis=1)
        return found


def log_likelihood(model: ValueModel, person: PairTrials, fitted: Array) -> Array:
    """Return the logarithm of the density of every trial given all earlier ones.

    Parameters
    ----------
    model : ValueModel
    person : PairTrials
    fitted : array (sets, parameters)
        Parameters on the scale of the fit.

    Returns
    -------
    array (sets, trials)
    """
    values = model.natural(fitted)
    drift = model.drifts(values, person)
    bound, t0_s = values["bound"][:, None], values["non_decision_s"][:, None]
    start = values["stickiness"][:, None] * bound * person.last_choice
    return log_density(person.rt_s, person.response, drift, bound, start, t0_s)


def fit_person(
    model: ValueModel | str,
    person: PairTrials,
    *,
    kept: Truths | None = None,
    fixed: dict[str, float] | None = None,
    begin: Array | None = None,
) -> ValueFit:
    """Fit a model to one person.

    Parameters
    ----------
    model : ValueModel or str
        A record, or a name in ``MODELS``.
    person : PairTrials
        Trials, times and rewards.
    kept : bool array (trials,), optional
        Trials whose likelihood is fitted; by default all. Values follow from all trials.
    fixed : dict, optional
        Parameters that are not fitted, such as ``{"stickiness": 0.0}``.
    begin : array (parameters,), optional
        Starting point on the scale of the fit; by default three.

    Raises
    ------
    ValueError
        For an unknown model or parameter, or a baseline model with another number of pairs.
    """
    model, fixed = model_of(model), dict(fixed or {})
    for name in fixed:
        if name not in model.names:
            raise InputError.of("fixed", f"must be among {', '.join(model.names)}", name)
    _check_pairs(model, person)
    every = np.ones(person.trials, bool) if kept is None else kept
    starts = _starts(model, person) if begin is None else [begin]
    found = [_maximum(ValueFit(model, person, _fix(model, at, fixed), every, fixed))
             for at in starts]  # fmt: skip
    return max(found, key=lambda one: one[1])[0]


def left_out(model: ValueModel | str, person: PairTrials, folds: int = 5) -> Array:
    """Return the log density of every trial under the fit to the other folds, (trials,).

    Trial k of a pair belongs to fold k modulo the number of folds. Values follow from all earlier
    trials, those left out included, as they did for the person.
    """
    folds = whole("folds", folds, 2)
    begin = fit_person(model, person).at
    found = np.empty(person.trials)
    for fold in range(folds):
        out = person.within % folds == fold
        fit = fit_person(model, person, kept=~out, begin=begin)
        found[out] = fit.each[out]
    return found


def _check_pairs(model: ValueModel, person: PairTrials) -> None:
    """Refuse a baseline model with one drift per pair for another number of pairs."""
    if model.learner is None and len(model.special) != len(person.names):
        must = f"must have {len(model.special)} pairs for the model {model.name!r}"
        raise InputError.of("person", must, len(person.names))


def _starts(model: ValueModel, person: PairTrials) -> list[Array]:
    """Return starting points on the scale of the fit."""
    found = []
    for away in STARTS:
        at = [float(each.fitted(each.median)) for each in model.parameters]
        for k, each in enumerate(model.special):
            at[k] += away * each.sd
        at[model.names.index("non_decision_s")] = np.log(0.8 * np.quantile(person.rt_s, 0.05))
        found.append(np.array(at))
    return found


def _fix(model: ValueModel, at: Array, fixed: dict[str, float]) -> Array:
    at = at.copy()
    for name, value in fixed.items():
        k = model.names.index(name)
        at[k] = model.parameters[k].fitted(value)
    return at


def _maximum(begin: ValueFit) -> tuple[ValueFit, float]:
    """Return the fit at the maximum that is reached from a starting point, and its height."""
    free, model = begin.free, begin.model
    steps = np.eye(free.sum()) * STEP

    def falling(x: Array) -> tuple[float, Array]:
        sets = np.concatenate([x[None], x + steps, x - steps])
        height = begin._objective(sets)
        plus, minus = np.split(height[1:], 2)
        return -float(height[0]), -(plus - minus) / (2 * STEP)

    middle = np.array([float(each.fitted(each.median)) for each in model.parameters])[free]
    reach = FURTHEST * np.array([each.sd for each in model.parameters])[free]
    limits = list(zip(middle - reach, middle + reach, strict=True))
    found = minimize(falling, begin.at[free], jac=True, method="L-BFGS-B", bounds=limits)
    at = begin._complete(found.x[None])[0]
    return ValueFit(model, begin.person, at, begin.kept, begin.fixed), -float(found.fun)


def _covariance(fit: ValueFit) -> Array:
    """Return the inverse of the curvature at the maximum, made positive definite."""
    at = fit.at[fit.free]
    count = len(at)
    steps = np.eye(count) * CURVED
    corners = [at + s * steps[i] + t * steps[j] for i in range(count) for j in range(count)
               for s in (1, -1) for t in (1, -1)]  # fmt: skip
    height = fit._objective(np.array(corners)).reshape(count, count, 2, 2)
    mixed = height[..., 0, 0] - height[..., 0, 1] - height[..., 1, 0] + height[..., 1, 1]
    curvature = -mixed / (4 * CURVED**2)
    values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    # The prior alone gives a curvature of 1 / sd^2; less is a fault of differences.
    return np.asarray((vectors / np.maximum(values, 0.1)) @ vectors.T)


def _proposed(
    rng: np.random.Generator, middle: Array, spread: Array, draws: int
) -> tuple[Array, Array]:
    """Draw from a multivariate t distribution; return draws and their log density."""
    from scipy.stats import multivariate_t

    proposal = multivariate_t(middle, spread, df=FREEDOM, seed=rng)
    found = np.reshape(proposal.rvs(draws), (draws, len(middle)))
    return found, proposal.logpdf(found)


def _weights(log_ratio: Array) -> Array:
    """Return weights that sum to 1 from their logarithms."""
    weights = np.exp(log_ratio - log_ratio.max())
    return np.asarray(weights / weights.sum())
