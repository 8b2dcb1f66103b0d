"""Evidence from interspike intervals, lognormal as in monkey MT cells."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.evidence import Evidence

if TYPE_CHECKING:
    from bgmodel.support.arrays import Array


@dataclass(frozen=True)
class Intervals:
    """Lognormal interspike intervals of one type of cell.

    Parameters
    ----------
    mean_ms, sd_ms : float, ms
        Mean and SD of the intervals themselves.
    """

    mean_ms: float
    sd_ms: float

    @property
    def log_mean(self) -> float:
        """Mean of their logarithm."""
        return log(self.mean_ms) - self.log_sd**2 / 2

    @property
    def log_sd(self) -> float:
        """Standard deviation of their logarithm."""
        return sqrt(log(1 + (self.sd_ms / self.mean_ms) ** 2))

    def log_density(self, log_ms: Array) -> Array:
        """Return the log density of logarithms of intervals, nats."""
        apart = (log_ms - self.log_mean) / self.log_sd
        return np.asarray(-(apart**2) / 2 - log(self.log_sd * sqrt(2 * np.pi)))


PREFERRED = {
    0.032: Intervals(54.11, 33.13),
    0.064: Intervals(51.96, 32.18),
    0.128: Intervals(46.11, 30.49),
    0.256: Intervals(37.74, 28.01),
    0.512: Intervals(29.86, 25.98),
}
"""Cells whose direction the dots move in, by coherence (Caballero, Humphries & Gurney 2018, their
code)."""
NULL = {
    0.032: Intervals(59.37, 34.54),
    0.064: Intervals(62.90, 35.32),
    0.128: Intervals(65.53, 36.14),
    0.256: Intervals(70.15, 37.15),
    0.512: Intervals(83.45, 40.63),
}
"""Cells of the other directions."""


def interval_evidence(
    trials: int, steps: int, coherence: float, *, rng: np.random.Generator, hypotheses: int = 2
) -> Evidence:
    """Draw intervals of one cell per direction, and the log likelihoods of the directions.

    A reading is one interval of every cell, from ``PREFERRED`` for the true direction and from
    ``NULL`` for the others. ``log p(reading | H_i)`` is, up to a common constant, the log ratio of
    both densities at the interval of cell i. Time is counted in readings: ``step_ms`` is 1.

    Parameters
    ----------
    trials, steps, hypotheses : int
        Shape of the result. Truth is balanced: trial k belongs to hypothesis k mod N.
    coherence : float
        Motion coherence: one of ``PREFERRED``.
    rng : numpy.random.Generator
        The source of every random number.

    Raises
    ------
    ValueError
        If there are no recordings at this coherence.
    """
    if coherence not in PREFERRED:
        there = ", ".join(f"{each:g}" for each in PREFERRED)
        raise ValueError(f"coherence must be one of {there}, got {coherence:g}")
    preferred, null = PREFERRED[coherence], NULL[coherence]
    truth = np.arange(trials) % hypotheses
    noise = rng.standard_normal((trials, steps, hypotheses))
    log_ms = null.log_mean + null.log_sd * noise
    own = (np.arange(trials), slice(None), truth)
    log_ms[own] = preferred.log_mean + preferred.log_sd * noise[own]
    ratio = preferred.log_density(log_ms) - null.log_density(log_ms)
    return Evidence(ratio, truth, step_ms=1.0, baseline=0.0)
