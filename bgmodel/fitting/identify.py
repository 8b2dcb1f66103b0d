"""What choices and times can tell apart: the directions in which parameters move the likelihood."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.arrays import Array
from bgmodel.fitting.optimum import Likelihood
from bgmodel.fitting.responses import BIN_S

ALIKE = 0.95
"""Cosine of two directions from which on a fit refuses to move both."""
STEP = 0.02
"""Step of the derivatives, as a share of where a parameter stands or of its range."""
ROUNDING = 1e-12
"""Change of a probability that is taken for none."""


@dataclass(frozen=True)
class Directions:
    """How parameters move the likelihood at a point, for a design and its numbers of trials.

    Parameters
    ----------
    names : list of str
        The parameters.
    vector : array (parameters,)
        Where.
    information : array (parameters, parameters)
        Fisher's, of all trials.
    """

    names: list[str]
    vector: Array
    information: Array

    @property
    def cosines(self) -> Array:
        """Cosine of the score directions of each pair; 1 or -1 where nothing tells them apart."""
        length = np.sqrt(np.diag(self.information))
        safe = np.where(length > 0, length, np.inf)
        return np.asarray(self.information / np.outer(safe, safe))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error of each with all others free; infinite where nothing fixes it."""
        length = np.sqrt(np.diag(self.information))
        found = np.full(len(length), np.inf)
        some = np.flatnonzero(length > 0)
        cosines = self.cosines[np.ix_(some, some)]
        if len(some) and np.linalg.cond(cosines) <= 1e12:
            inverse = np.linalg.inv(cosines)
            found[some] = np.sqrt(np.maximum(np.diag(inverse), 0)) / length[some]
        return found

    @property
    def alone(self) -> Array:
        """Standard error of each with all others known."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / np.sqrt(np.diag(self.information)))

    def check(self) -> None:
        """Refuse parameters that these data cannot tell apart.

        Raises
        ------
        ValueError
            With the pair, its cosine, and what to do.
        """
        cosines = self.cosines
        for i, j in zip(*np.triu_indices(len(self.names), 1), strict=True):
            if abs(cosines[i, j]) >= ALIKE:
                raise ValueError(
                    f"choices and times of this design cannot tell {self.names[i]} from "
                    f"{self.names[j]}: their directions have a cosine of {cosines[i, j]:.2f}. Hold "
                    "one of them, or give it a condition that moves it alone"
                )
        for name, length in zip(self.names, np.diag(self.information), strict=True):
            if not length > 0:
                raise ValueError(f"nothing in this design depends on {name}: hold it")


def directions(likelihood: Likelihood, vector: Array) -> Directions:
    """Return the score directions at a point, from the model's own densities.

    The expected information: no datum goes into it but the design and its numbers of trials.

    Parameters
    ----------
    likelihood : Likelihood
        Model, design, and what is free.
    vector : array (parameters,)
        Where, in the numbers of the fit.
    """
    low, high = likelihood.freedom.low, likelihood.freedom.high
    middle = _masses(likelihood, vector)
    changes = []
    for k in range(len(vector)):
        step = STEP * max(abs(vector[k]), 0.1 * (high[k] - low[k]))
        above, below = vector.copy(), vector.copy()
        above[k], below[k] = min(vector[k] + step, high[k]), max(vector[k] - step, low[k])
        apart = _masses(likelihood, above) - _masses(likelihood, below)
        apart[np.abs(apart) < ROUNDING] = 0.0
        changes.append(apart / (above[k] - below[k]))
    weight = likelihood.design.trials[:, None] / np.maximum(middle, 1e-12)
    information = np.einsum("icb,cb,jcb->ij", changes, weight, changes)
    return Directions(likelihood.freedom.names, vector, np.asarray(information))


def _masses(likelihood: Likelihood, vector: Array) -> Array:
    """Return the probability of each outcome, (cells, outcomes): bins of both, and none."""
    density = likelihood.density(vector)
    mass = density.reshape(len(density), -1) * BIN_S
    missing = np.maximum(1 - mass.sum(axis=1, keepdims=True), 1e-9)
    return np.concatenate([mass, missing], axis=1)
