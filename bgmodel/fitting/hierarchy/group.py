"""The distribution of a group: a mean and a standard deviation of each parameter on the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.hierarchy.scale import log_uniform
from bgmodel.support.arrays import Array

SPREAD, FREEDOM = 2.0, 3.0
"""Scale and degrees of freedom of the half-t prior of standard deviations between people: on the
scale, where the default value of a parameter is 4 above its lower bound."""


@dataclass(frozen=True)
class Group:
    """People's parameters are Gaussian on the scale, independent of each other.

    Parameters
    ----------
    mean, variance : array (parameters,)
        Mean and variance between people, on the scale.
    highest : array (parameters,) or float
        Upper end of the range of each mean, on the scale.
    """

    mean: Array
    variance: Array
    highest: Array | float = np.inf

    def log_prior(self, scaled: Array) -> Array:
        """Return the log density of people's parameters (people, parameters), up to a constant."""
        return np.asarray(-0.5 * ((scaled - self.mean) ** 2 / self.variance).sum(axis=-1))

    def drawn(self, scaled: Array, rng: np.random.Generator) -> Group:
        """Return a draw from the conditional posterior given people's parameters.

        Parameters
        ----------
        scaled : array (people, parameters)
            People's parameters on the scale.
        rng : Generator
            Random numbers.

        Notes
        -----
        The prior of each mean is uniform over the range of the parameter; that of each standard
        deviation is half-t with ``FREEDOM`` degrees of freedom and scale ``SPREAD`` (Gelman 2006),
        a mixture of inverse gammas (Wand et al. 2011). The prior of the mean, which is not uniform
        on the scale, accepts or rejects a draw under one that is.
        """
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
        return Group(mean, variance, self.highest)

    def log_own_prior(self) -> float:
        """Return the log prior density of means and standard deviations, up to a constant."""
        if (self.mean > self.highest).any():
            return -np.inf
        tails = (FREEDOM + 1) / 2 * np.log1p(self.variance / (FREEDOM * SPREAD**2))
        return float((log_uniform(self.mean) - tails).sum())


def group_of(means: Array, variances: Array | None = None) -> Group:
    """Return the mean and variance of people's estimates on the scale, as a start.

    Parameters
    ----------
    means : array (people, parameters)
        Estimates.
    variances : array (people, parameters), optional
        Their error variances, added as in the EM algorithm.
    """
    spread = means.var(axis=0)
    if variances is not None:
        spread = spread + variances.mean(axis=0)
    people = len(means)
    pulled = (people * spread + FREEDOM * SPREAD**2 / 20) / (people + FREEDOM)
    return Group(means.mean(axis=0), np.asarray(pulled))
