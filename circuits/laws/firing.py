"""Exact firing rates of the cell types, and the current that gives a wanted f-I line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from circuits.cells import Lif

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(120)


def lif_rate_hz(cell: Lif, mean_mv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the stationary rate of a leaky integrate-and-fire cell with white noise, Hz.

    Parameters
    ----------
    cell : Lif
        Its constants.
    mean_mv : array
        Mean potential without a threshold, mV.

    Notes
    -----
    The mean first-passage time of Siegert 1951, as in Ricciardi & Sacerdote 1979:
    ``1/r = refractory + tau sqrt(pi) int exp(u^2)(1 + erf u) du`` from ``(reset - mean)`` to
    ``(threshold - mean)``, both over ``sqrt 2 noise_mv``.
    """
    from scipy.special import erfcx

    mean = np.asarray(mean_mv, dtype=np.float64)
    width = np.sqrt(2) * cell.noise_mv
    low, high = (cell.reset_mv - mean) / width, (cell.threshold_mv - mean) / width
    half = (high - low) / 2
    u = (high + low)[..., None] / 2 + half[..., None] * _NODES
    # exp(u^2)(1 + erf u), capped where the cell is silent for longer than any run.
    inside = erfcx(np.maximum(-u, -26.0))
    time_ms = cell.refractory_ms + cell.tau_ms * np.sqrt(np.pi) * half * (inside @ _WEIGHTS)
    rate_hz: npt.NDArray[np.float64] = 1000.0 / time_ms
    return rate_hz


def lif_mean_mv(cell: Lif, rate_hz: float) -> float:
    """Return the mean potential at which the cell fires at a rate, mV."""
    from scipy.optimize import brentq

    if not (rate_hz > 0 and rate_hz * cell.refractory_ms < 1000):
        raise ValueError(f"rate_hz must lie in 0..1000/refractory_ms, got {rate_hz}")
    low, high = cell.threshold_mv - 12 * cell.noise_mv, cell.threshold_mv + 2000.0
    return float(brentq(lambda mv: float(lif_rate_hz(cell, mv)) - rate_hz, low, high))


def fit_current(
    cell: Lif, baseline_hz: float, gain_hz_per_nat: float, range_hz: tuple[float, float]
) -> tuple[float, float]:
    """Return the (rest_mv, mv_per_nat) that make the cell's f-I follow a line best.

    Parameters
    ----------
    cell : Lif
        Its own rest_mv and mv_per_nat play no part.
    baseline_hz, gain_hz_per_nat : float
        The wanted line ``baseline_hz + gain_hz_per_nat * x``.
    range_hz : (low, high)
        Rates over which it is fitted, by least squares of the mean potential.
    """
    rates = np.linspace(*range_hz, 41)
    means = [lif_mean_mv(cell, rate) for rate in rates]
    slope, rest = np.polyfit((rates - baseline_hz) / gain_hz_per_nat, means, 1)
    return float(rest), float(slope)
