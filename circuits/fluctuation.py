"""What a finite number of cells does to rates: the linear noise of the whole circuit.

Each population's spikes are its cells' own renewal noise, shared by all that hear them. It goes
round the circuit as small modulations do; where cells bend, what arrives moves the mean rate.
Exact to first order in 1/n: Brunel & Hakim 1999 for loops, Lindner, Doiron & Longtin 2005 for
spectra; cells by ``circuits.response``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.cells import Escape, Lif, Phase
from circuits.response import Complex, escape_spectrum, lif_response, phase_spectrum
from circuits.wiring import Array, Index, Wiring

FREQUENCIES_HZ = np.concatenate([[1e-3], np.geomspace(0.02, 1000, 120)])
"""Where power is summed: from below the slowest loop to above the fastest synapse."""
STEP_NATS = 1e-4


class Linear(NamedTuple):
    """A circuit's small fluctuations about its states; x is behind the blocks' filters.

    Parameters
    ----------
    into, out : complex arrays (trials, F, blocks, blocks)
        How a block's own noise, Hz, reaches each input, nats/Hz, and each rate, Hz/Hz.
    bend : array (trials, F, blocks), Hz/nat^2
        What a variance of the input adds to the mean rate.
    own : array (trials, F, blocks), Hz^2/Hz
        Two-sided power of the blocks' own noise.
    """

    into: Complex
    out: Complex
    bend: Array
    own: Array


def linear(wiring: Wiring, x: Array, frequency_hz: npt.ArrayLike) -> Linear:
    """Return the small fluctuations about states x (trials, blocks), nats; frequencies above 0.

    Raises
    ------
    ValueError
        If cells differ or connections are sparse, or a pathway bends: then it is not known.
    """
    _check(wiring)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    gain, bend, own = _cells(wiring, x, frequency)
    turn = 2j * np.pi * frequency[:, None] / 1000
    paths = [wiring.projection(u) for u in range(wiring.units)]
    delay, tau = (np.array([getattr(p, k) for p in paths]) for k in ("delay_ms", "tau_ms"))
    synapse = np.exp(-turn * delay) / (1 + turn * tau)
    leak = np.where(wiring.leakless, 0.0, 1.0)
    block = 1 / (leak + turn * wiring.column("tau_ms"))
    heard = (block[:, :, None] * wiring.weight) @ (synapse[:, :, None] * wiring.deliver)
    one = np.eye(wiring.blocks)
    into = np.linalg.solve(one - heard * gain[:, :, None, :], heard)
    return Linear(into, one + gain[..., None] * into, bend, own)


def extra_rates(wiring: Wiring, x: Array) -> Array:
    """Return what fluctuations add to the mean rates (trials, blocks), Hz, at states x (nats).

    Raises
    ------
    ValueError
        As ``linear``.
    """
    found = linear(wiring, x, FREQUENCIES_HZ)
    power = np.einsum("tfbc,tfc->tfb", np.abs(found.into) ** 2, found.own)
    # Two-sided: as much lies at negative frequencies.
    return np.asarray(2 * np.trapezoid(found.bend * power, FREQUENCIES_HZ, axis=1))


def _cells(wiring: Wiring, x: Array, frequency_hz: Array) -> tuple[Complex, Array, Array]:
    """Return the blocks' gain (Hz/nat), bend and own noise, each (trials, F, blocks)."""
    slope = wiring.rates_slope(x)
    bent = wiring.rates_slope(x + STEP_NATS) - wiring.rates_slope(x - STEP_NATS)
    shape = (len(x), len(frequency_hz), wiring.blocks)
    gain = np.broadcast_to(slope[:, None], shape).astype(np.complex128)
    bend = np.broadcast_to(bent[:, None] / (4 * STEP_NATS), shape).copy()
    own = np.zeros(shape)
    hz = wiring.rates(x)
    for row in wiring.circuit.populations:
        blocks, cell = wiring.blocks_of(row.name), row.cell
        flat = x[:, blocks].ravel()

        def put(kept: Any, values: Any, blocks: Index = blocks) -> None:
            kept[..., blocks] = values.reshape(len(x), len(blocks), -1).swapaxes(1, 2)

        if isinstance(cell, Lif):
            found = lif_response(cell, cell.rest_mv + cell.mv_per_nat * flat, frequency_hz)
            put(gain, cell.mv_per_nat * found.gain)
            put(bend, cell.mv_per_nat**2 * found.bend)
            put(own, found.spectrum)
        elif isinstance(cell, Phase):
            put(own, phase_spectrum(cell, hz[:, blocks].ravel(), frequency_hz))
        elif isinstance(cell, Escape):
            put(own, escape_spectrum(cell, hz[:, blocks].ravel(), frequency_hz))
        if row.spiking and row.intact:
            own[..., blocks] /= row.neurons * row.intact
    return gain, bend, own


def _check(wiring: Wiring) -> None:
    if not any(row.spiking for row in wiring.circuit.populations):
        return
    for row in wiring.circuit.populations:
        if row.spiking and row.spread:
            raise ValueError(
                f"laws of a finite number of cells are known for cells that are alike; those of "
                f"{row.name} differ by {row.spread:.0%}"
            )
    for p in wiring.circuit.projections:
        if p.probability < 1 or p.transfer != "linear":
            what = f"is {p.transfer}" if p.probability == 1 else f"connects {p.probability:.0%}"
            raise ValueError(
                f"laws of a finite number of cells are known for linear pathways from all cells to "
                f"all; {p.name} {what}"
            )
