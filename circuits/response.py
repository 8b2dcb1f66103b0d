"""How cells answer an input that fluctuates, and how irregular their spikes are.

All to second order in the fluctuation and exact in the noise of the cells: the stationary density
of the membrane, its answer to a modulated mean and the answer to that answer, by threshold
integration (Richardson 2007, Phys Rev E 76, 021919).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.cells import Escape, Lif, Phase

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

NODES = 100
"""Steps from threshold to reset: right to .3 % up to 1 kHz."""
DEPTH = 4.0
"""How many sd below mean or reset the membrane is followed."""
DEEPEST = 9.0
"""How many sd below threshold a mean counts at most: from there on a cell is silent."""


class Response(NamedTuple):
    """What a cell does about a small fluctuation of its mean potential, (..., frequencies).

    Parameters
    ----------
    gain : complex array, Hz/mV
        Modulation of the rate a mV of modulation.
    bend : array, Hz/mV^2
        What a variance at this frequency adds to the mean rate.
    spectrum : array, Hz
        Two-sided power of the spike train without any fluctuation.
    """

    gain: Complex
    bend: Array
    spectrum: Array


def lif_response(cell: Lif, mean_mv: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Response:
    """Return how a leaky integrate-and-fire cell answers about mean potentials.

    Parameters
    ----------
    cell : Lif
        Its constants.
    mean_mv : array (S,)
        Mean potentials without a threshold, mV.
    frequency_hz : array (F,)
        Above 0.

    Notes
    -----
    With the flux J and the density P from threshold down, ``-dP/dV = (tau J + (V - mean) P)/sd^2``
    less its sources, ``-dJ/dV = i omega P`` and a step at the reset. A modulated mean has the
    source P0, and at second order, frequency 0, that first-order density.
    """
    tau_s, held_s = cell.tau_ms / 1000, cell.refractory_ms / 1000
    mean = np.maximum(mean_mv, cell.threshold_mv - DEEPEST * cell.noise_mv)[:, None]
    omega = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    lowest = np.minimum(mean, cell.reset_mv) - DEPTH * cell.noise_mv
    # The reset is a node.
    step = (cell.threshold_mv - cell.reset_mv) / NODES
    count = int(np.ceil((cell.threshold_mv - lowest.min(initial=cell.reset_mv)) / step))
    middle = cell.threshold_mv - step * (np.arange(count) + 0.5)
    power = step * (middle - mean) / cell.noise_mv**2
    # Far below, where nothing is, parts that cancel would grow without end.
    inside = middle > lowest
    keep = (np.exp(power) * inside).T[..., None]
    near = np.abs(power) < 1e-9
    inflow = np.where(near, 1.0, np.expm1(power) / np.where(near, 1.0, power)) * inside
    inflow = inflow.T[..., None] * step / cell.noise_mv**2

    def down(flux: complex, inject: float, sources: Array | None = None) -> tuple[Complex, Complex]:
        """Return densities (nodes, S, F) and the flux at the bottom, sources lying at nodes."""
        p = np.zeros((count + 1, len(mean), len(omega)), dtype=np.complex128)
        j = np.full(p.shape[1:], flux)
        for k in range(count):
            drive = tau_s * (j + step * omega * p[k] / 2)
            if sources is not None:
                drive = drive - (sources[k] + sources[k + 1]) / 2
            p[k + 1] = keep[k] * p[k] + inflow[k] * drive
            j = j + step * omega * (p[k] + p[k + 1]) / 2
            if k + 1 == NODES:
                j = j - inject
        return p, j

    still = np.zeros((count + 1, len(mean), 1))
    for k in range(count):
        flux = tau_s if k < NODES else 0.0
        still[k + 1] = keep[k] * still[k] + inflow[k] * flux
    rate = 1 / (_area(still, step) + held_s)
    still = rate * still
    out, out_flux = down(1.0, 0.0)
    back, back_flux = down(0.0, 1.0)
    moved, moved_flux = down(0.0, 0.0, still)
    late = np.exp(-omega * held_s)
    gain = -moved_flux / (out_flux + late * back_flux)
    first = gain * (out + late * back) + moved
    # exp(i omega t) and its conjugate, variance 2, act on the density that each of them made.
    second = np.zeros(out.shape[1:])
    area = np.zeros(out.shape[1:])
    for k in range(count):
        below = keep[k] * second - inflow[k] * (first[k] + first[k + 1]).real
        area += step * (second + below) / 2
        second = below
    interval = -back_flux / out_flux * late
    return Response(gain, -rate * area / 2, _renewal(rate, interval))


def phase_spectrum(cell: Phase, rate_hz: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Array:
    """Return the two-sided power of a Phase cell's spikes, (S, F) Hz; 0 for a regular one.

    Its intervals are inverse Gaussian, with the characteristic function
    ``exp((1 - sqrt(1 - 2 i omega cv^2/r))/cv^2)``.
    """
    rate = np.asarray(rate_hz, dtype=np.float64)[:, None]
    if cell.cv == 0:
        return np.zeros((len(rate), np.size(frequency_hz)))
    turn = 2j * np.pi * np.asarray(frequency_hz) / np.maximum(rate, 1e-9)
    interval = np.exp((1 - np.sqrt(1 - 2 * turn * cell.cv**2)) / cell.cv**2)
    return _renewal(rate, interval)


def escape_spectrum(cell: Escape, hazard_hz: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Array:
    """Return the two-sided power of an Escape cell's spikes, (S, F) Hz; its rate if Poisson."""
    hazard = np.asarray(hazard_hz, dtype=np.float64)[:, None]
    held_s = cell.refractory_ms / 1000
    omega = 2j * np.pi * np.asarray(frequency_hz)
    interval = np.exp(-omega * held_s) * hazard / (hazard + omega)
    return _renewal(hazard / (1 + hazard * held_s), interval)


def _renewal(rate: Array, interval: Complex) -> Array:
    """Return the power of a renewal process from the transform of its intervals (Cox 1962)."""
    return np.asarray(rate * (1 - np.abs(interval) ** 2) / np.abs(1 - interval) ** 2)


def _area(density: Array, step: float) -> Array:
    """Return the integral over the potential of what vanishes at both ends or nearly so."""
    return np.asarray(step * (density[1:] + density[:-1]).sum(axis=0) / 2)
