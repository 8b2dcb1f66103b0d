"""A leaky membrane with a threshold: its exact firing rate, and currents fitted to a line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.errors import InputError


@dataclass(frozen=True)
class Membrane:
    """A leaky membrane with white noise, a threshold and a reset, in mV above a reference."""

    tau_ms: float
    noise_mv: float  #: Standard deviation of the membrane without a threshold.
    threshold_mv: float
    reset_mv: float
    refractory_ms: float


@cache
def _legendre() -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(120)
    return nodes, weights


def lif_rate_hz(cell: Membrane, mean_mv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the stationary rate, Hz, of a leaky integrate-and-fire cell with white noise.

    ``mean_mv`` is the mean potential without a threshold. The mean first-passage time of Siegert
    1951, as in Ricciardi & Sacerdote 1979: ``1/r = refractory + tau sqrt(pi) int exp(u^2)(1 + erf
    u) du`` from ``(reset - mean)`` to ``(threshold - mean)``, both over ``sqrt 2 noise_mv``.
    """
    from scipy.special import erfcx

    mean = np.asarray(mean_mv, dtype=np.float64)
    width = np.sqrt(2) * cell.noise_mv
    low, high = (cell.reset_mv - mean) / width, (cell.threshold_mv - mean) / width
    half = (high - low) / 2
    nodes, weights = _legendre()
    u = (high + low)[..., None] / 2 + half[..., None] * nodes
    # exp(u^2)(1 + erf u), capped where the cell stays silent for longer than any run.
    inside = erfcx(np.maximum(-u, -26.0))
    time_ms = cell.refractory_ms + cell.tau_ms * np.sqrt(np.pi) * half * (inside @ weights)
    rate_hz: npt.NDArray[np.float64] = 1000.0 / time_ms
    return rate_hz


def lif_mean_mv(cell: Membrane, rate_hz: float) -> float:
    """Return the mean potential at which the cell fires at a rate, mV."""
    from scipy.optimize import brentq

    if not (rate_hz > 0 and rate_hz * cell.refractory_ms < 1000):
        raise InputError.of("rate_hz", "must be within 0..1000/refractory_ms", rate_hz)
    low, high = cell.threshold_mv - 12 * cell.noise_mv, cell.threshold_mv + 2000.0
    return float(brentq(lambda mv: float(lif_rate_hz(cell, mv)) - rate_hz, low, high))


def fit_current(
    cell: Membrane, baseline_hz: float, gain_hz_per_nat: float, range_hz: tuple[float, float]
) -> tuple[float, float]:
    """Return the (rest_mv, mv_per_nat) with which the cell's f-I curve best follows a line.

    The line is ``baseline_hz + gain_hz_per_nat * x``; the fit is by least squares of the mean
    potential over a range of rates. The rest_mv and mv_per_nat of a Lif cell are not used.
    """
    rates = np.linspace(*range_hz, 41)
    means = [lif_mean_mv(cell, rate) for rate in rates]
    slope, rest = np.polyfit((rates - baseline_hz) / gain_hz_per_nat, means, 1)
    return float(rest), float(slope)
