"""What choices and times can tell apart: the directions in which parameters move the likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.optimum import Likelihood
from bgmodel.fitting.responses import BIN_S
from bgmodel.support.arrays import Array

ALIKE = 0.95
"""Cosine of two directions from which on a fit warns that it moves both."""
STEP = 0.02
"""Step of the derivatives, as a share of where a parameter stands or of its range."""
SINGULAR = 1e-12
"""Least eigenvalue of the cosines below which nothing tells some parameters apart."""
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
        Fisher's, of all trials; 0 also where too few stored trials know it.
    idle : tuple of str
        Parameters that move no probability at all.
    """

    names: list[str]
    vector: Array
    information: Array
    idle: tuple[str, ...] = ()

    @property
    def cosines(self) -> Array:
        """Cosine of the score directions of each pair; 1 or -1 where nothing tells them apart."""
        length = np.sqrt(np.diag(self.information))
        safe = np.where(length > 0, length, np.inf)
        return np.asarray(np.clip(self.information / np.outer(safe, safe), -1.0, 1.0))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error of each with all others free; infinite where nothing fixes it."""
        length = np.sqrt(np.diag(self.information))
        found = np.full(len(length), np.inf)
        some = np.flatnonzero(length > 0)
        cosines = self.cosines[np.ix_(some, some)]
        # An estimate of what is nearly singular may have directions of less than no information.
        if len(some) and np.linalg.eigvalsh(cosines)[0] > SINGULAR:
            found[some] = np.sqrt(np.diag(np.linalg.inv(cosines))) / length[some]
        return found

    @property
    def alone(self) -> Array:
        """Standard error of each with all others known."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / np.sqrt(np.diag(self.information)))

    def cautions(self) -> list[str]:
        """Return a sentence for each pair of parameters that these data cannot tell apart.

        It has the cosine and the ridge, along which one makes up for the other. Parameters on which
        nothing depends get a sentence too. If neither explains an infinite standard error, one
        sentence says so.
        """
        cosines = self.cosines
        found = []
        for i, j in zip(*np.triu_indices(len(self.names), 1), strict=True):
            if abs(cosines[i, j]) < ALIKE:
                continue
            step = STEP * abs(self.vector[i]) or STEP
            ridge = -self.information[i, j] / self.information[j, j] * step
            found.append(
                f"choices and times of this design hardly tell {self.names[i]} from "
                f"{self.names[j]} (cosine {cosines[i, j]:.2f}): a change of {self.names[i]} by "
                f"{step:+.3g} is made up for by one of {self.names[j]} by {ridge:+.3g}. Hold one "
                "of them, or give it a condition that moves it alone"
            )
        found += [f"nothing in this design depends on {name}: fix it" for name in self.idle]
        lacking = [
            name
            for name, error in zip(self.names, self.standard_errors, strict=True)
            if np.isinf(error)
        ]
        if lacking and not found:
            found.append(
                f"no standard error can be given for {', '.join(lacking)}: the design, or too few "
                "simulated trials, do not tell them apart. Hold one of them, or simulate more "
                "trials (trials)"
            )
        return found


def directions(likelihood: Likelihood, vector: Array) -> Directions:
    """Return the score directions at a point, from the model's own densities.

    The expected information: no datum goes into it but the design and its numbers of trials. A
    circuit's densities have the error of its stored trials, which a square would count as
    information: each product is of the derivatives of one half of them with those of the other.

    Parameters
    ----------
    likelihood : Likelihood
        Model, design, and what is free.
    vector : array (parameters,)
        Where, in the numbers of the fit.
    """
    halves = likelihood.model.halves()
    whole = len({id(each) for each in halves}) == 1
    first = _changes(replace(likelihood, model=halves[0]), vector)
    second = first if whole else _changes(replace(likelihood, model=halves[1]), vector)
    weight = likelihood.design.trials[:, None] / np.maximum(_masses(likelihood, vector), 1e-12)
    information = np.einsum("icb,cb,jcb->ij", first, weight, second)
    found = (information + information.T) / 2
    # Less than nothing is an error as large as what it is of.
    unknown = np.diag(found) <= 0
    found[unknown], found[:, unknown] = 0.0, 0.0
    names = likelihood.freedom.names
    still = ~(first != 0).any(axis=(1, 2))
    return Directions(names, vector, found, tuple(np.array(names)[still].tolist()))


def _changes(likelihood: Likelihood, vector: Array) -> Array:
    """Return how each outcome's probability moves with each parameter, (parameters, ...)."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    changes = []
    for k in range(len(vector)):
        step = STEP * max(abs(vector[k]), 0.1 * (high[k] - low[k]))
        above, below = vector.copy(), vector.copy()
        above[k], below[k] = min(vector[k] + step, high[k]), max(vector[k] - step, low[k])
        apart = _masses(likelihood, above) - _masses(likelihood, below)
        apart[np.abs(apart) < ROUNDING] = 0.0
        changes.append(apart / (above[k] - below[k]))
    return np.array(changes)


def _masses(likelihood: Likelihood, vector: Array) -> Array:
    """Return the probability of each outcome, (cells, outcomes): bins of both, and none."""
    density = likelihood.density(vector)
    mass = density.reshape(len(density), -1) * BIN_S
    missing = np.maximum(1 - mass.sum(axis=1, keepdims=True), 1e-9)
    return np.concatenate([mass, missing], axis=1)
