"""What a finite number of cells does to rates: the linear noise of the whole circuit.

Each population's spikes are its cells' own renewal noise, shared by all that hear them. It goes
round the circuit as small modulations do; where cells bend, what arrives moves the mean rate.
To first order in 1/n (Brunel & Hakim 1999 for loops, Lindner, Doiron & Longtin 2005 for spectra;
cells by ``circuits.laws.response``). Neglected: a Lif cell's own spikes that reach it again before
its next spike, and a rectified unit near its kink.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.cells.cell import Line
from circuits.wiring import Wiring

FREQUENCIES_HZ = np.concatenate([[1e-3], np.geomspace(0.02, 1000, 120)])
"""Where power is summed. Below, cells' answers would cancel to nothing; above, synapses filter."""


class Linear(NamedTuple):
    """A circuit's small fluctuations about its states.

    An input is what comes out of the block's own filter; a membrane is part of a cell's answer.

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
    """Return the small fluctuations about states x (trials, blocks), nats; from 1e-3 Hz on.

    Raises
    ------
    ValueError
        If cells differ or their type has no ``response``, connections are sparse or a pathway
        bends: then it is not known.
    """
    _check(wiring)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    gain, bend, own = _cells(wiring, x, frequency)
    turn = 2j * np.pi * frequency[:, None] / 1000
    synapse = wiring.synapse(frequency)
    block = 1 / (1 + turn * wiring.column("tau_ms"))
    heard = (block[:, :, None] * wiring.weight) @ (synapse[:, :, None] * wiring.deliver)
    one = np.eye(wiring.blocks)
    loops = one - heard * gain[:, :, None, :]
    _check_stable(wiring, loops)
    into: Complex = np.linalg.solve(loops, heard).astype(np.complex128)
    out: Complex = one + gain[..., None] * into
    return Linear(into, out, bend, own)


def extra_rates(wiring: Wiring, x: Array) -> Array:
    """Return what fluctuations add to the mean rates (trials, blocks), Hz, at states x (nats).

    Raises
    ------
    ValueError
        As ``linear``, and if the fixed point is unstable.
    """
    found = linear(wiring, x, FREQUENCIES_HZ)
    power = np.einsum("tfbc,tfc->tfb", np.abs(found.into) ** 2, found.own)
    # Two-sided: as much lies at negative frequencies.
    return np.asarray(2 * np.trapezoid(found.bend * power, FREQUENCIES_HZ, axis=1))


def _cells(wiring: Wiring, x: Array, frequency_hz: Array) -> tuple[Complex, Array, Array]:
    """Return the blocks' gain (Hz/nat), bend and own noise, each (trials, F, blocks)."""
    shape = (len(x), len(frequency_hz), wiring.blocks)
    gain, bend, own = np.empty(shape, np.complex128), np.empty(shape), np.empty(shape)
    laws = [law(x) for law in (wiring.rates, wiring.rates_slope, wiring.rates_curvature)]
    for row in wiring.circuit.populations:
        blocks = wiring.blocks_of(row.name)
        line = Line(*(law[:, blocks].ravel() for law in laws))
        found = row.cell.response(x[:, blocks].ravel(), line, frequency_hz)
        for kept, values in zip((gain, bend, own), found, strict=True):
            wide = np.broadcast_to(values, (len(x) * len(blocks), len(frequency_hz)))
            kept[..., blocks] = wide.reshape(len(x), len(blocks), -1).swapaxes(1, 2)
        # A lesion takes from what is delivered, not from the cells that are simulated.
        own[..., blocks] /= row.neurons
    return gain, bend, own


def _check_stable(wiring: Wiring, loops: Complex) -> None:
    """Raise ValueError if det(1 - loops) winds about 0: Nyquist's criterion."""
    turned = np.unwrap(np.angle(np.linalg.det(loops)), axis=1)
    # Each unstable root turns it by half a turn; an integrator's pole at 0 by a quarter.
    if (np.abs(turned[:, -1] - turned[:, 0]) > 0.75 * np.pi).any():
        raise ValueError(
            f"the fixed point of {wiring.circuit.name} as edited is unstable: it oscillates, and "
            "the laws of a finite number of cells do not hold"
        )


def _check(wiring: Wiring) -> None:
    reasons, spiking = [], [row for row in wiring.circuit.populations if row.spiking]
    names = {row.name for row in spiking}
    for row in spiking:
        if row.spread:
            reasons.append(f"those of {row.name} differ by {row.spread:.0%}")
    for p in wiring.circuit.projections:
        if p.source in names and p.transfer != "linear":
            reasons.append(f"{p.name} is {p.transfer}")
        if {p.source, p.target} <= names and p.probability < 1:
            reasons.append(f"{p.name} connects {p.probability:.0%}")
    if reasons:
        raise ValueError(
            "laws of a finite number of cells are known for cells that are alike, with linear "
            f"pathways from all to all: {reasons[0]}"
        )
