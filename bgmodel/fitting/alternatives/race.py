"""A race of independent accumulators between N alternatives, computed exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bgmodel.fitting.exact.algorithms import BOUND, SENSITIVITY
from bgmodel.fitting.exact.responses import Grid
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.support.arrays import Array

INPUT = Parameter(
    "input", 0.0, 12.0, 1.0, "drift of every accumulator without evidence for it, 1/sqrt(s)"
)
FINE = 5
"""Parts of a bin, in each of which the survivors of the other accumulators are averaged."""


@dataclass(frozen=True)
class RaceModel:
    """Independent accumulators of evidence; the first to reach the bound decides.

    Each has noise of variance 1/2 per second, so that differences have unit variance, as in the
    test. First-passage times are inverse Gaussian (Wald 1947), and the density of a response is
    that of its accumulator times the survivors of the others.
    """

    alternatives: int
    any_width: ClassVar = True

    @property
    def threshold_name(self) -> str:
        """``bound``."""
        return BOUND.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, common input, bound, and parameters of responses."""
        return (SENSITIVITY, INPUT, BOUND, *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        ends_s = np.arange(FINE * grid.bins + 1) * grid.width_s / FINE
        bound, common = values[BOUND.name][:, None], values[INPUT.name][:, None]
        right = arrived(ends_s, common + (values[SENSITIVITY.name] * strength)[:, None], bound)
        wrong = arrived(ends_s, common, bound)
        others = self.alternatives - 1
        # By parts, the loss of a product of survivors is divided between its factors.
        correct = np.diff(right) * _middle((1 - wrong) ** others)
        errors = others * np.diff(wrong) * _middle((1 - right) * (1 - wrong) ** (others - 1))
        fine = np.stack([errors, correct], axis=1)
        return np.asarray(fine.reshape(len(strength), 2, grid.bins, FINE).sum(axis=3))

    def halves(self) -> tuple[RaceModel, RaceModel]:
        """Return itself twice, since it is exact."""
        return self, self

    def left_out(self) -> tuple[RaceModel, ...]:
        """Return an empty tuple, since no trial is simulated."""
        return ()

    def identity(self) -> dict[str, object]:
        """Return its name and the number of alternatives."""
        return {"model": "race", "alternatives": self.alternatives}


def _middle(survivors: Array) -> Array:
    """Return survivors averaged between the ends of each part, (cells, parts)."""
    return np.asarray((survivors[:, 1:] + survivors[:, :-1]) / 2)


def arrived(time_s: Array, drift: Array, bound: Array) -> Array:
    """Return the probability that an accumulator has reached its bound, (cells, times).

    The first time is 0, s; drift, 0 or more, and bound are (cells, 1), 1/sqrt(s) and sqrt(s).
    """
    from scipy.special import log_ndtr, ndtr

    sd = np.sqrt(np.maximum(time_s, 1e-12) / 2)
    late = log_ndtr(-(bound + drift * time_s) / sd) + 4 * drift * bound
    return np.asarray(ndtr((drift * time_s - bound) / sd) + np.exp(late))
