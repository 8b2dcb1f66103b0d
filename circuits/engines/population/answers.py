"""What cells answer, in tables over their input: the law of their rate, and their two filters."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from circuits import transfer
from circuits.arrays import Array
from circuits.cells.cell import Cell, Line
from circuits.engines.population import filters
from circuits.engines.population.kernel import COEFFICIENTS, FOLLOWING

STATES, STEPS, POINTS = 28, 512, 4096
"""States at which filters are fitted; steps at which their coefficients and laws are kept."""
LEAST_HZ, MOST_HZ = 1e-3, 400.0
"""Rates between which a cell's answers go with its state; a law goes on straight beyond."""
SLOWEST_HZ = 0.1
"""Below, all cells answer as a Poisson process that hardly follows."""
FAR_NATS = 256.0
"""No input is further from 0."""
ROUGH, SEEN_HZ = 0.25, (1.0, 120.0)
"""A misfit of a filter that is worth a word, between these rates."""
BENT = 2e-3
"""Largest misfit of a law between two points, as a fraction of the highest value."""


@dataclass(frozen=True)
class Straight:
    """A population's line before its cells: the fields of its row that make it."""

    transfer: str
    baseline_hz: float
    gain_hz_per_nat: float

    def at(self, x: Array, lowest_hz: float) -> Line:
        """Return the line at inputs x (S,)."""
        law, gain = transfer.named(self.transfer), self.gain_hz_per_nat
        hz = np.maximum(self.baseline_hz + gain * law(x), lowest_hz)
        return Line(hz, gain * law.slope(x), gain * law.curvature(x))


@dataclass(frozen=True)
class Answers:
    """What a population's cells answer between two inputs, nats.

    Parameters
    ----------
    lowest, highest : float
        The inputs.
    hz : array (POINTS,)
        Rate at even steps between them.
    rows : array (COEFFICIENTS, STEPS)
        Coefficients of how rates follow, and of the two sections of the noise.
    lags : bool
        Whether rates follow their input with a lag of their own.
    """

    lowest: float
    highest: float
    hz: Array
    rows: Array
    lags: bool


@lru_cache(maxsize=256)
def answers(cell: Cell, line: Straight, dt_ms: float) -> Answers:
    """Return what the cells of a population answer; raises ValueError if they lack an answer."""

    def rate(x: Array) -> Array:
        return np.asarray(cell.rate_hz(x, line.at(x, cell.lowest_hz).hz), dtype=np.float64)

    low, high = _ends(rate)
    steps, grid = np.linspace(low, high, STEPS), np.linspace(low, high, POINTS)
    pace = _pace(rate(steps))
    paces = np.linspace(pace[0], pace[-1], STATES)
    x = np.interp(paces, pace, steps)
    found = cell.response(x, line.at(x, cell.lowest_hz), filters.FREQUENCIES_HZ)
    rows, lags = np.zeros((COEFFICIENTS, STEPS)), bool(np.iscomplexobj(found.gain))

    def kept(fit: filters.Fitted, what: str) -> Array:
        _say_if_rough(cell, what, rate(x), fit.misfit)
        return np.array([np.interp(pace, paces, column) for column in fit.coefficients.T]).T

    if lags:
        fit = kept(filters.following(found.gain), "how its rate follows an input")
        rows[:FOLLOWING] = filters.propagated(fit, dt_ms)
    silent = found.spectrum[:, -1].max() == 0
    if not silent:
        colour = filters.colour(found.spectrum / rate(x)[:, None], rate(x))
        # Between states they go as powers of the rate, as a pacemaker's do.
        fit = np.exp(kept(colour._replace(coefficients=np.log(colour.coefficients)), "its noise"))
        rows[FOLLOWING:] = np.concatenate([filters.sampled(fit[:, :4], dt_ms),
                                           filters.sampled(fit[:, 4:], dt_ms)])  # fmt: skip
    return Answers(low, high, rate(grid), rows, lags)


@lru_cache(maxsize=64)
def looked_up(name: str) -> tuple[float, float, Array]:
    """Return a transfer without a loop of its own between two inputs, (POINTS,).

    Raises
    ------
    ValueError
        If it bends too much to be looked up.
    """
    law, ends = transfer.named(name), (-FAR_NATS / 4, FAR_NATS / 4)
    grid = np.linspace(*ends, POINTS)
    values, middles = law(grid), law((grid[1:] + grid[:-1]) / 2)
    off = np.abs((values[1:] + values[:-1]) / 2 - middles).max()
    if not off <= BENT * np.abs(values).max():
        raise ValueError(
            f"the population engine looks {name!r} up between points, and it bends too much there"
        )
    return *ends, values


def _ends(rate: Callable[[Array], Array]) -> tuple[float, float]:
    """Return the inputs between which the rate goes from LEAST_HZ to MOST_HZ, or the furthest."""
    from scipy.optimize import brentq

    ends = []
    for wanted, furthest in ((LEAST_HZ, -FAR_NATS), (MOST_HZ, FAR_NATS)):

        def beyond(x: float, wanted: float = wanted) -> float:
            return float(rate(np.array([x]))[0]) - wanted

        reached = beyond(-FAR_NATS) * beyond(FAR_NATS) < 0
        ends.append(brentq(beyond, -FAR_NATS, FAR_NATS, xtol=1e-6) if reached else furthest)
    return ends[0], ends[1]


def _pace(hz: Array) -> Array:
    """Return the logarithm of the rate, where it rises, from the least that cells differ at."""
    rising = np.log(np.maximum.accumulate(np.maximum(hz, SLOWEST_HZ)))
    return np.asarray(rising + 1e-9 * np.arange(len(hz)))


def _say_if_rough(cell: Cell, what: str, hz: Array, misfit: npt.NDArray[np.floating]) -> None:
    rough = (misfit > ROUGH) & (hz >= SEEN_HZ[0]) & (hz <= SEEN_HZ[1])
    if rough.any():
        worst = int(np.argmax(np.where(rough, misfit, 0)))
        warnings.warn(
            f"{cell}: the population engine meets {what} at {hz[worst]:.0f} Hz only within "
            f"{misfit[worst]:.0%}: hold what follows to spikes",
            stacklevel=2,
        )
