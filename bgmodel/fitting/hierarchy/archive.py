"""Proposals from earlier draws: they reach every mode that the warm-up has found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.support.arrays import Array

RIDGE = 1e-6
"""Added to the variances of draws, so that none is 0."""


@dataclass(frozen=True)
class Archive:
    """A kernel estimate of each person's posterior.

    Parameters
    ----------
    draws : array (people, draws, parameters)
        Earlier draws on the scale, from several chains.
    """

    draws: Array

    @cached_property
    def roots(self) -> Array:
        """Lower Cholesky factors of the kernels' covariances, (people, ...).

        The covariance of the draws, times the squared bandwidth of Scott (1992).
        """
        _, count, size = self.draws.shape
        bandwidth = count ** (-1 / (size + 4))
        away = self.draws - self.draws.mean(axis=1, keepdims=True)
        covariance = np.einsum("pni,pnj->pij", away, away) / count
        return np.asarray(np.linalg.cholesky(bandwidth**2 * (covariance + RIDGE * np.eye(size))))

    @cached_property
    def _whitened(self) -> Array:
        """The draws in units of the kernels, (people, parameters, draws)."""
        return np.asarray(np.linalg.solve(self.roots, np.swapaxes(self.draws, 1, 2)))

    def draw(self, rng: np.random.Generator) -> Array:
        """Return a draw for each person, (people, parameters)."""
        people, count, size = self.draws.shape
        centre = self.draws[np.arange(people), rng.integers(count, size=people)]
        return np.asarray(
            centre + np.einsum("pij,pj->pi", self.roots, rng.normal(size=(people, size)))
        )

    def log_density(self, scaled: Array) -> Array:
        """Return the log density at everyone's parameters (people, parameters), (people,)."""
        _, count, size = self.draws.shape
        place = np.linalg.solve(self.roots, scaled[..., None])
        squares = ((self._whitened - place) ** 2).sum(axis=1)
        volume = np.log(np.diagonal(self.roots, axis1=1, axis2=2)).sum(axis=1)
        kernels = np.logaddexp.reduce(-squares / 2, axis=1) - np.log(count)
        return np.asarray(kernels - volume - size / 2 * np.log(2 * np.pi))
