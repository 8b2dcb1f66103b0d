"""A renewal source of a given irregularity: a pacemaker, or a cortical cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.cells.cell import Cell, Line, Response, register
from circuits.cells.response import renewal_spectrum
from circuits.checks import check_range, check_types

NODES, REACH = 20_001, 12.0
"""Points x at which the distribution is inverted: their number, and how far log x goes, in cv."""
REGULAR = 1e-6
"""Below this cv the power, cv^2 of the rate, is lost in rounding."""


@register
@dataclass(frozen=True)
class Phase(Cell):
    """A renewal cell with inverse Gaussian intervals of mean 1/r and coefficient of variation cv.

    These are the times between spikes of a phase that diffuses, ``dphi = r dt + cv sqrt(r) dW``, if
    it fires and returns to 0 on reaching 1. The rate r is exact, and cv is from 0 to 1: well below
    1 in pacemakers and about 0.5 in cortical cells; with cv = 1 counts are nearly Poisson over
    times longer than an interval.
    """

    cv: float
    longest_tick_ms: ClassVar[float] = 0.25

    def __post_init__(self) -> None:
        check_types(self, "a Phase cell")
        check_range(0, 1, cv=self.cv)

    def interval_quantiles(self, probability: Array) -> Array:
        """Return quantiles of the inverse Gaussian with mean 1 (Cox & Miller 1965)."""
        if self.cv == 0:
            return np.ones_like(probability)
        from scipy.special import erfcx, ndtr

        x = np.exp(np.linspace(-REACH * self.cv, REACH * self.cv, NODES))
        with np.errstate(over="ignore"):  # erfcx(inf) is 0, as it should be
            below, beyond = (x - 1) / self.cv / np.sqrt(x), (x + 1) / self.cv / np.sqrt(2 * x)
        # exp(2 / cv^2) times the normal distribution at -(1 + x) / (cv sqrt(x))
        returned = np.exp(-(below**2) / 2) * erfcx(beyond) / 2
        return np.asarray(np.interp(probability, ndtr(below) + returned, x))

    def varied(self, factors: Array) -> tuple[Cell, float]:
        """Return the same cell; the first factor acts on its rate."""
        return self, float(factors[0])

    def response(self, x: Array, line: Line, frequency_hz: Array) -> Response:
        """Return the slopes of its line, which it follows without lag, and its power spectrum."""
        spectrum = phase_spectrum(self, line.hz, frequency_hz)
        return Response(line.slope[:, None], line.curvature[:, None] / 2, spectrum)


def phase_spectrum(cell: Phase, rate_hz: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Array:
    """Return the two-sided power of a Phase cell's spikes, (S, F) Hz; 0 for a regular one.

    The intervals are inverse Gaussian, with the characteristic function
    ``exp((1 - sqrt(1 - 2 i omega cv^2/r))/cv^2)``.
    """
    rate = np.asarray(rate_hz, dtype=np.float64)[:, None]
    if cell.cv < REGULAR:
        return np.zeros((len(rate), np.size(frequency_hz)))
    turn = 2j * np.pi * np.asarray(frequency_hz) / np.maximum(rate, 1e-9)
    interval = np.exp((1 - np.sqrt(1 - 2 * turn * cell.cv**2)) / cell.cv**2)
    return renewal_spectrum(rate, interval)
