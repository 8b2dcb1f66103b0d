"""Simulation error: how far a fit would move with other simulated trials.

By the jackknife (Efron & Tibshirani 1993, chapter 11) over independent parts of a circuit's stored
trials; the fit without a part follows from one Newton step from the optimum.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from bgmodel.fitting.likelihood import STEP, Likelihood
from bgmodel.fitting.posterior import Directions
from bgmodel.support.arrays import Array, Truths

HALVED = 8
"""Number of times a step that leads downhill is halved before it is skipped."""


@dataclass(frozen=True)
class Simulation:
    """Standard errors due to the simulated trials alone, 0 without simulation."""

    log_likelihood: float  # error of the largest log likelihood, nats
    parameters: Array  # (parameters,); NaN at a bound, where a Newton step is not informative


def jackknifed(values: npt.ArrayLike) -> Array:
    """Return the standard error of an estimate from its values without each part, (parts, ...)."""
    estimates = np.asarray(values, float)
    parts = len(estimates)
    if not parts:
        return np.zeros(estimates.shape[1:])
    return np.asarray(
        np.sqrt((parts - 1) / parts * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0))
    )


def simulation_error(
    likelihood: Likelihood,
    there: Directions,
    left: Sequence[tuple[Likelihood, Array]] | None = None,
) -> Simulation:
    """Return the standard errors due to simulated trials; ``left`` is as from ``without_parts``."""
    left = without_parts(likelihood, there) if left is None else left
    vectors = np.array([vector for _, vector in left]).reshape(len(left), len(there.vector))
    values = np.array([each(there.vector) for each, _ in left])
    errors = jackknifed(vectors)
    if left:
        errors[likelihood.freedom.at_bound(there.vector)] = np.nan
    return Simulation(float(jackknifed(values)), errors)


def without_parts(likelihood: Likelihood, there: Directions) -> list[tuple[Likelihood, Array]]:
    """Return the likelihood without each part of simulated trials, and its optimum."""
    left = likelihood.without_parts()
    if not left:
        return []
    inside = ~likelihood.freedom.at_bound(there.vector)
    slopes = np.array([_slopes(each, there.vector, inside) for each in left])
    common = slopes.mean(axis=0)
    steps = np.zeros(slopes.shape)
    curvature = _curvature(likelihood, there.vector, inside)
    steps[:, inside] = (slopes - common)[:, inside] @ np.linalg.pinv(curvature)
    return [
        (each, _uphill(each, there.vector, step, common))
        for each, step in zip(left, steps, strict=True)
    ]


def _uphill(likelihood: Likelihood, vector: Array, step: Array, common: Array) -> Array:
    """Return the end of a step, halved until it leads uphill; ``common`` is all parts' slope."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    start = likelihood(vector)
    for halved in range(HALVED):
        at: Array = np.clip(vector + step / 2**halved, low, high)
        if likelihood(at) - common @ (at - vector) >= start:
            return at
    return vector


def _slopes(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    slopes = np.zeros(len(vector))
    for k, step in zip(np.flatnonzero(inside), _steps(likelihood, vector, inside), strict=True):
        above, below = _beside(vector, k, step)
        slopes[k] = (likelihood(above) - likelihood(below)) / (2 * step)
    return slopes


def _beside(vector: Array, k: int, step: float) -> tuple[Array, Array]:
    above, below = vector.copy(), vector.copy()
    above[k], below[k] = vector[k] + step, vector[k] - step
    return above, below


def _curvature(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    """Return minus the second derivatives for the data, by the numbers inside."""
    steps = _steps(likelihood, vector, inside)
    slopes = []
    for k, step in zip(np.flatnonzero(inside), steps, strict=True):
        above, below = _beside(vector, k, step)
        change = _slopes(likelihood, above, inside) - _slopes(likelihood, below, inside)
        slopes.append(change[inside] / (2 * step))
    curvature = -np.array(slopes).reshape(inside.sum(), inside.sum())
    return np.asarray((curvature + curvature.T) / 2)


def _steps(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    """Return step sizes of derivatives; two steps stay within the range."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    steps = STEP * np.maximum(np.abs(vector), 0.1 * (high - low))
    room = np.minimum(vector - low, high - vector) / 2
    return np.asarray(np.minimum(steps, room)[inside])


PARTS = 16
"""Parts of the simulated trials; trial k belongs to part ``k % PARTS``."""


class InParts(ABC):
    """A model of which some parts of the simulated trials can be used alone."""

    @abstractmethod
    def _part(self, parts: Truths) -> Self:
        """Return the model with the parts that are true, (PARTS,)."""

    def halves(self) -> tuple[Self, Self]:
        """Return the model with one half of its simulated trials, and with the other half."""
        even = np.arange(PARTS) % 2 == 0
        return self._part(even), self._part(~even)

    def left_out(self) -> tuple[Self, ...]:
        """Return the model without each part of its simulated trials in turn."""
        return tuple(self._part(~left) for left in np.eye(PARTS, dtype=np.bool_))
