"""How a leaky membrane responds to a fluctuating input, and how irregular its spikes are.

Second order in the fluctuation and exact in the noise of the cells: the stationary density of the
membrane potential, and its first- and second-order responses to a modulated mean (Fokker-Planck
equation as in Richardson 2007, Phys Rev E 76, 021919).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.cells.cell import Response
from circuits.cells.membrane import Membrane

NODES = 100
"""Steps from threshold to reset: accurate to 0.5 % up to 4 kHz, 0.2 % up to 300 Hz."""
DEPTH = 5.0
"""Lower end of the density, in SD below the mean or the reset."""
DEEPEST = 9.0
"""Lowest mean considered, in SD below threshold; below it a cell is silent."""


def lif_response(cell: Membrane, mean_mv: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Response:
    """Return the response (S, F), per mV, of a leaky integrate-and-fire cell about means (S,), mV.

    The density is discretised on nodes (Scharfetter & Gummel 1969); the flux through the threshold
    re-enters at the reset one refractory period later. A modulated mean acts on the stationary
    density and, at second order and frequency 0, on the first-order density. Frequencies (F,) are
    at least 1e-3 Hz; below, the spectrum is lost to cancellation.
    """
    mean = np.maximum(mean_mv, cell.threshold_mv - DEEPEST * cell.noise_mv)[:, None]
    density = _Density(cell, mean)
    held_s = cell.refractory_ms / 1000
    (passed,) = density.solve(np.zeros(1), density.injected)
    rate = 1 / (density.area(passed) + held_s)
    omega = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    push, at_once = density.pushed(rate * passed)
    passing, moved = density.solve(omega, density.injected, push)
    # The transform of intervals, and the flux pushed out together with all its later returns.
    interval = density.outflow(passing) * np.exp(-omega * held_s)
    gain = (density.outflow(moved) + at_once) / (1 - interval)
    first = moved + gain * np.exp(-omega * held_s) * passing
    # exp(i omega t) and its conjugate, variance 2, each act on the density that it produced.
    push, _ = density.pushed(2 * first.real)
    (second,) = density.solve(np.zeros(1), push)
    bend = -rate * density.area(second) / 2
    return Response(gain, bend, renewal_spectrum(rate, interval))


class _Density:
    """Density of the potential on nodes up to one step below threshold, (nodes, S, F)."""

    def __init__(self, cell: Membrane, mean: Array) -> None:
        tau_s = cell.tau_ms / 1000
        lowest = min(float(mean.min(initial=cell.reset_mv)), cell.reset_mv) - DEPTH * cell.noise_mv
        self.step = (cell.threshold_mv - cell.reset_mv) / NODES
        count = int(np.ceil((cell.threshold_mv - lowest) / self.step))
        above = cell.threshold_mv - self.step * (np.arange(count)[::-1] + 0.5)
        # Drift over diffusion from node to node; rates of hops up and down, 1/s.
        power = self.step * (mean - above).T[..., None] / cell.noise_mv**2
        hop = cell.noise_mv**2 / tau_s / self.step**2
        near = np.abs(power) < 1e-9
        down = np.where(near, 1.0, power / np.where(near, 1.0, np.expm1(power)))
        self.up, self.down = hop * (down + power), hop * down
        self.tau_s = tau_s
        self.injected = np.zeros((count, len(mean), 1))
        self.injected[count - NODES] = 1 / self.step

    def solve(self, omega: npt.NDArray[Any], *sources: npt.NDArray[Any]) -> list[Any]:
        """Return the densities, modulated at omega, sustained by sources per mV and second."""
        count = len(self.up)
        leave = self.up.copy()
        leave[1:] += self.down[:-1]
        shares = np.empty(np.broadcast_shapes(leave.shape, omega.shape), omega.dtype)
        densities = [
            np.empty(
                np.broadcast_shapes(shares.shape, source.shape), np.result_type(shares, source)
            )
            for source in sources
        ]
        # Thomas' elimination from the bottom up, then back down.
        for k in range(count):
            left = omega + leave[k] - (self.up[k - 1] * shares[k - 1] if k else 0)
            shares[k] = self.down[k] / left
            for density, source in zip(densities, sources, strict=True):
                density[k] = (source[k] + (self.up[k - 1] * density[k - 1] if k else 0)) / left
        for k in range(count - 2, -1, -1):
            for density in densities:
                density[k] += shares[k] * density[k + 1]
        return densities

    def pushed(self, density: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return the source due to 1 mV more of mean, and the flux that it drives out, 1/s."""
        flux = density.copy()
        flux[:-1] += density[1:]
        flux /= 2 * self.tau_s
        source = -flux / self.step
        source[1:] += flux[:-1] / self.step
        return source, flux[-1]

    def outflow(self, density: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the flux through threshold, 1/s."""
        return np.asarray(self.step * self.up[-1] * density[-1])

    def area(self, density: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.asarray(self.step * density.sum(axis=0))


def renewal_spectrum(rate: Array, interval: Complex) -> Array:
    """Return the power spectrum of a renewal process from its interval transform (Cox 1962)."""
    return np.asarray(rate * (1 - np.abs(interval) ** 2) / np.abs(1 - interval) ** 2)
