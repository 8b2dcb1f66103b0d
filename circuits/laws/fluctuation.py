"""What a finite number of cells does to rates: the linear noise of the whole circuit.

Each population's spikes are its cells' own renewal noise, shared by all that hear them. It goes
round the circuit as small modulations do: a pathway that bends passes them on by its slope at the
fixed point, a silent unit passes nothing. Where cells or pathways bend, what arrives moves means.
To first order in 1/n (Brunel & Hakim 1999 for loops, Lindner, Doiron & Longtin 2005 for spectra;
van Kampen 2007, chapter X, for the expansion; cells by ``circuits.cells.response``). Neglected: a
Lif cell's own spikes that reach it again before its next spike, and that noise may cross a kink
nearby; at a kink there is no slope, and a refusal.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.cells.cell import Line
from circuits.dynamics.wiring import Wiring
from circuits.laws.mean_field import own_rates
from circuits.laws.mixture import mean_response

FREQUENCIES_HZ = np.concatenate([[1e-3], np.geomspace(0.02, 1000, 120)])
"""Where power is summed. Below, cells' answers would cancel to nothing; above, synapses filter."""
MOST_TURN, MOST_HALVINGS = 0.5, 12
"""Steps of frequency are halved where ``ln det`` of the loops moves by more: near a resonance."""
KINK_NATS, KINK = 1e-8, 0.01
"""A slope that changes by such a part of itself, or of 1, within twice so little, has a kink."""


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
    det : complex array (trials, F)
        ``det(1 - L)``, L what goes once round the loops.
    """

    into: Complex
    out: Complex
    bend: Array
    own: Array
    det: Complex


class Extra(NamedTuple):
    """What fluctuations add to means, to first order in 1/n.

    Parameters
    ----------
    rates_hz : array (trials, blocks), Hz
        Added to the rates, where cells bend.
    inputs_nats : array (trials, blocks), nats
        Added to the inputs, where pathways bend.
    """

    rates_hz: Array
    inputs_nats: Array


def linear(
    wiring: Wiring, x: Array, frequency_hz: npt.ArrayLike, extra_hz: Array | float = 0.0
) -> Linear:
    """Return the small fluctuations about states, stable or not.

    Parameters
    ----------
    wiring : Wiring
        The circuit.
    x : array (trials, blocks), nats
        The states.
    frequency_hz : array (F,)
        From 1e-3 Hz on.
    extra_hz : array (trials, blocks) or float
        What comes on top of the rates of the states, Hz.

    Raises
    ------
    ValueError
        If the cells' type has no ``response``, or connections are sparse: then it is not known.
    """
    _check(wiring)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    gain, bend, own = _cells(wiring, x, frequency)
    turn = 2j * np.pi * frequency[:, None] / 1000
    block = 1 / (1 + turn * wiring.column("tau_ms"))
    slope = wiring.units_slope(_activity(wiring, x, extra_hz))[:, None, None]
    passed = block[:, :, None] * (wiring.weight * slope)
    heard = passed @ (wiring.synapse(frequency)[:, :, None] * wiring.deliver)
    one = np.eye(wiring.blocks)
    loops = one - heard * gain[:, :, None, :]
    into: Complex = np.linalg.solve(loops, heard).astype(np.complex128)
    out: Complex = one + gain[..., None] * into
    return Linear(into, out, bend, own, np.linalg.det(loops).astype(np.complex128))


def swept(wiring: Wiring, x: Array, extra_hz: Array | float = 0.0) -> tuple[Array, Linear]:
    """Return frequencies (F,), Hz, dense near a resonance, and the fluctuations there.

    Parameters are those of ``linear``.

    Raises
    ------
    ValueError
        As ``linear``, and if a state is unstable.
    """
    frequency, found = FREQUENCIES_HZ, linear(wiring, x, FREQUENCIES_HZ, extra_hz)
    for _ in range(MOST_HALVINGS):
        moved = np.abs(np.log(found.det[:, 1:] / found.det[:, :-1])).max(axis=0) > MOST_TURN
        # Channels that are alike turn together, by a whole turn between two frequencies maybe.
        moved[1:-1] |= moved[:-2] | moved[2:]
        if not moved.any():
            break
        between = np.sqrt(frequency[1:] * frequency[:-1])[moved]
        more = linear(wiring, x, between, extra_hz)
        frequency = np.append(frequency, between)
        order = np.argsort(frequency)
        frequency = frequency[order]
        both = (np.concatenate(pair, axis=1)[:, order] for pair in zip(found, more, strict=True))
        found = Linear(*both)
    _check_stable(wiring, found.det)
    return frequency, found


def extra(wiring: Wiring, x: Array) -> Extra:
    """Return what fluctuations add to means at states x (trials, blocks), nats.

    Raises
    ------
    ValueError
        As ``swept``, and if noise arrives at a kink: a line that ends, or a pathway that begins,
        right at the state.
    """
    frequency, found = swept(wiring, x)
    power = np.einsum("tfbc,tfc->tfb", np.abs(found.into) ** 2, found.own)
    activity = _activity(wiring, x)
    bent = np.array([p.transfer != "linear" for p in wiring.projections], bool)
    reach = wiring.synapse(frequency)[:, bent, None] * wiring.deliver[bent]
    arriving = np.einsum("tfuc,tfc->tfu", np.abs(reach @ found.out) ** 2, found.own)
    # Two-sided: as much lies at negative frequencies.
    blocks, units = (2 * np.trapezoid(part, frequency, axis=1) for part in (power, arriving))
    _check_kinks(wiring, x, activity, np.sqrt(blocks), bent, np.sqrt(units))
    rates = 2 * np.trapezoid(found.bend * power, frequency, axis=1)
    lifted = wiring.units_curvature(activity)[:, bent] / 2 * units
    return Extra(np.asarray(rates), np.asarray(lifted @ wiring.weight[:, bent].T))


def _activity(wiring: Wiring, x: Array, extra_hz: Array | float = 0.0) -> Array:
    """Return the mean activity (trials, units) that units receive at states, before they bend."""
    return np.asarray((own_rates(wiring, x) + extra_hz) @ wiring.deliver.T + wiring.constant)


def _cells(wiring: Wiring, x: Array, frequency_hz: Array) -> tuple[Complex, Array, Array]:
    """Return the blocks' gain (Hz/nat), bend and own noise, each (trials, F, blocks)."""
    shape = (len(x), len(frequency_hz), wiring.blocks)
    gain, bend, own = np.empty(shape, np.complex128), np.empty(shape), np.empty(shape)
    laws = [law(x) for law in (wiring.rates, wiring.rates_slope, wiring.rates_curvature)]
    for row in wiring.circuit.populations:
        blocks = wiring.blocks_of(row.name)
        line = Line(*(law[:, blocks].ravel() for law in laws))
        states = x[:, blocks].ravel()
        found = mean_response(row.cell, row.heterogeneity, states, line, frequency_hz)
        for kept, values in zip((gain, bend, own), found, strict=True):
            wide = np.broadcast_to(values, (len(x) * len(blocks), len(frequency_hz)))
            kept[..., blocks] = wide.reshape(len(x), len(blocks), -1).swapaxes(1, 2)
        # A lesion takes from what is delivered, not from the cells that are simulated.
        own[..., blocks] /= row.neurons
    return gain, bend, own


def _check_stable(wiring: Wiring, det: Complex) -> None:
    """Raise ValueError if det(1 - loops) winds about 0: Nyquist's criterion."""
    turned = np.unwrap(np.angle(det), axis=1)
    # Each unstable root turns it by half a turn; an integrator's pole at 0 by a quarter.
    if (np.abs(turned[:, -1] - turned[:, 0]) > 0.75 * np.pi).any():
        said = f"the fixed point of {wiring.circuit.name} as edited is unstable: it oscillates"
        raise ValueError(f"{said}, and the laws of a finite number of cells do not hold")


def _check_kinks(
    wiring: Wiring, x: Array, activity: Array, blocks: Array, bent: Array, units: Array
) -> None:
    """Raise ValueError if noise, of so many nats (sd) at blocks and bent units, meets a kink."""
    # A cell that hears nats follows a law of its own, not the line.
    by_line = [row.cell.hears == "hz" for row in wiring.rows]
    at = _jumps(lambda x: wiring.rates_slope(x) / wiring.gain_hz_per_nat, x) & by_line
    at &= blocks > KINK_NATS
    names = [wiring.row(b).name for b in np.flatnonzero(at.any(axis=0))]
    at = _jumps(wiring.units_slope, activity)[:, bent] & (units > KINK_NATS)
    names += [wiring.projection(u).name for u in np.flatnonzero(bent)[at.any(axis=0)]]
    if names:
        said = f"{names[0]} of {wiring.circuit.name} as edited is right at a kink"
        jumps = "where its slope jumps: the laws of a finite number of cells do not hold there"
        raise ValueError(f"{said}, {jumps}")


def _jumps(slope: Callable[[Array], Array], at: Array) -> npt.NDArray[np.bool_]:
    """Return where a slope, nats/nat, is another one just below and just above."""
    low, high = slope(at - KINK_NATS), slope(at + KINK_NATS)
    return np.asarray(np.abs(high - low) > KINK * np.maximum(1, np.abs(low + high) / 2))


def _check(wiring: Wiring) -> None:
    for p in wiring.circuit.projections:
        if wiring.circuit.is_sparse(p):
            said = "laws of a finite number of cells are known for cells connected all to all"
            raise ValueError(f"{said}: {p.name} connects {p.probability:.0%}")
