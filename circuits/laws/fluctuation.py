"""Finite-size effects on rates: the linear noise of the whole circuit.

The source of noise is the renewal noise of each population's spikes, common to all its targets. It
propagates through the circuit like any small modulation: nonlinear pathways transmit it with their
slope at the fixed point, silent units not at all. Where cells or pathways are nonlinear, the noise
they receive shifts their means. All to first order in 1/n (Brunel & Hakim 1999 for loops, Lindner,
Doiron & Longtin 2005 for spectra; van Kampen 2007, chapter X, for the expansion; cells by
``circuits.cells.response``). Neglected: a Lif cell's own spikes that return to it before its next
spike, and noise that crosses a nearby kink; right at a kink there is no slope, and an error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.cells.cell import Line
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import held_drive, solve, wired
from circuits.dynamics.wiring import Wiring
from circuits.errors import require
from circuits.laws.mean_field import mean_response, own_rates, settled

FREQUENCIES_HZ = np.concatenate([[1e-3], np.geomspace(0.02, 1000, 120)])
"""Range over which power is summed: below, responses are lost to cancellation; above, filtered."""
MOST_TURN, MOST_HALVINGS = 0.5, 12
"""Frequency steps are halved where ``ln det`` of the loops changes by more: near a resonance."""
KINK_NATS, KINK = 1e-8, 0.01
"""A kink is a change of slope by more than ``KINK`` (relative, if above 1) within +-KINK_NATS."""


class Linear(NamedTuple):
    """Small fluctuations of a circuit about its states.

    Inputs are measured after the block's filter; a membrane is part of the cell's response. The two
    transfers are (trials, F, blocks, blocks).
    """

    into: Complex  # transfer from a block's own noise, Hz, to each input, nats/Hz
    out: Complex  # transfer from a block's own noise, Hz, to each rate, Hz/Hz
    bend: Array  # (trials, F, blocks) Hz/nat^2: change of the mean rate per unit of input variance
    noise: Array  # (trials, F, blocks) Hz^2/Hz: two-sided power of the noise of each block
    det: Complex  # (trials, F): ``det(1 - L)``, L the loop gain


class Extra(NamedTuple):
    """Shifts of means due to fluctuations, to first order in 1/n, (trials, blocks) each."""

    rates_hz: Array  # added to the rates by nonlinear cells
    inputs_nats: Array  # added to the inputs by nonlinear pathways


def linear(
    wiring: Wiring, x: Array, frequency_hz: npt.ArrayLike, extra_hz: Array | float = 0.0
) -> Linear:
    """Return the small fluctuations about states x (trials, blocks), nats, whether stable or not.

    Frequencies (F,) are at least 1e-3 Hz; ``extra_hz`` is added to the rates of the states. There
    is no theory for sparse connections, nor for cell types without a ``response``.
    """
    for p in wiring.circuit.projections:
        if wiring.circuit.is_sparse(p):
            problem = "the finite-size theory needs all-to-all connections"
            raise ValueError(f"{problem}: {p.name} connects {p.probability:.0%}")
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    gain, bend, noise = _cells(wiring, x, frequency)
    turn = 2j * np.pi * frequency[:, None] / 1000
    block = 1 / (1 + turn * wiring.column("tau_ms"))
    slope = wiring.units_slope(_activity(wiring, x, extra_hz))[:, None, None]
    passed = block[:, :, None] * (wiring.weight * slope)
    heard = passed @ (wiring.synapse(frequency)[:, :, None] * wiring.deliver)
    one = np.eye(wiring.blocks)
    loops = one - heard * gain[:, :, None, :]
    into: Complex = np.linalg.solve(loops, heard).astype(np.complex128)
    out: Complex = one + gain[..., None] * into
    return Linear(into, out, bend, noise, np.linalg.det(loops).astype(np.complex128))


def swept(wiring: Wiring, x: Array, extra_hz: Array | float = 0.0) -> tuple[Array, Linear]:
    """Return frequencies (F,), Hz, dense near a resonance, and the fluctuations there.

    The arguments are those of ``linear``; states must be stable.
    """
    frequency, transfers = FREQUENCIES_HZ, linear(wiring, x, FREQUENCIES_HZ, extra_hz)
    for _ in range(MOST_HALVINGS):
        moved = np.abs(np.log(transfers.det[:, 1:] / transfers.det[:, :-1])).max(axis=0) > MOST_TURN
        # Identical channels turn together, perhaps by a whole turn between two frequencies.
        moved[1:-1] |= moved[:-2] | moved[2:]
        if not moved.any():
            break
        between = np.sqrt(frequency[1:] * frequency[:-1])[moved]
        more = linear(wiring, x, between, extra_hz)
        frequency = np.append(frequency, between)
        order = np.argsort(frequency)
        frequency = frequency[order]
        pairs = zip(transfers, more, strict=True)
        transfers = Linear(*(np.concatenate(pair, axis=1)[:, order] for pair in pairs))
    _check_stable(wiring, transfers.det)
    return frequency, transfers


def extra(wiring: Wiring, x: Array) -> Extra:
    """Return the shifts of means due to fluctuations at states x (trials, blocks), nats.

    Raises ValueError as ``swept``, and if noise meets a kink: a line that saturates, or a pathway
    with its threshold, right at the state.
    """
    frequency, transfers = swept(wiring, x)
    power = np.einsum("tfbc,tfc->tfb", np.abs(transfers.into) ** 2, transfers.noise)
    activity = _activity(wiring, x)
    bent = np.array([p.transfer != "linear" for p in wiring.projections], bool)
    reach = wiring.synapse(frequency)[:, bent, None] * wiring.deliver[bent]
    arriving = np.einsum("tfuc,tfc->tfu", np.abs(reach @ transfers.out) ** 2, transfers.noise)
    # Two-sided: negative frequencies contribute as much.
    blocks, units = (2 * np.trapezoid(part, frequency, axis=1) for part in (power, arriving))
    _check_kinks(wiring, x, activity, np.sqrt(blocks), bent, np.sqrt(units))
    rates = 2 * np.trapezoid(transfers.bend * power, frequency, axis=1)
    lifted = wiring.units_curvature(activity)[:, bent] / 2 * units
    return Extra(np.asarray(rates), np.asarray(lifted @ wiring.weight[:, bent].T))


def _activity(wiring: Wiring, x: Array, extra_hz: Array | float = 0.0) -> Array:
    """Return the mean activity (trials, units) of units at states, before their transfer."""
    return np.asarray((own_rates(wiring, x) + extra_hz) @ wiring.deliver.T + wiring.constant)


def _cells(wiring: Wiring, x: Array, frequency_hz: Array) -> tuple[Complex, Array, Array]:
    """Return the blocks' gain (Hz/nat), bend and own noise, each (trials, F, blocks)."""
    shape = (len(x), len(frequency_hz), wiring.blocks)
    gain, bend, noise = np.empty(shape, np.complex128), np.empty(shape), np.empty(shape)
    laws = [law(x) for law in (wiring.rates, wiring.rates_slope, wiring.rates_curvature)]
    for row in wiring.circuit.populations:
        blocks = wiring.blocks_of(row.name)
        line = Line(*(law[:, blocks].ravel() for law in laws))
        states = x[:, blocks].ravel()
        response = mean_response(row.cell, row.heterogeneity, states, line, frequency_hz)
        for kept, values in zip((gain, bend, noise), response, strict=True):
            wide = np.broadcast_to(values, (len(x) * len(blocks), len(frequency_hz)))
            kept[..., blocks] = wide.reshape(len(x), len(blocks), -1).swapaxes(1, 2)
        # A lesion reduces the output delivered, not the cells that are simulated.
        noise[..., blocks] /= row.neurons
    return gain, bend, noise


def _check_stable(wiring: Wiring, det: Complex) -> None:
    """Raise ValueError if det(1 - loops) winds about 0: Nyquist's criterion."""
    turned = np.unwrap(np.angle(det), axis=1)
    # Each unstable root turns it by half a turn; an integrator's pole at 0 by a quarter.
    if (np.abs(turned[:, -1] - turned[:, 0]) > 0.75 * np.pi).any():
        problem = f"the fixed point of {wiring.circuit.name} is unstable: the circuit oscillates"
        raise ValueError(f"{problem}, and the finite-size theory does not apply")


def _check_kinks(
    wiring: Wiring, x: Array, activity: Array, blocks: Array, bent: Array, units: Array
) -> None:
    """Raise ValueError if noise, given as SDs at blocks and nonlinear units, meets a kink."""
    # A cell that hears nats follows its own f-I curve, not the line.
    by_line = [row.cell.hears == "hz" for row in wiring.rows]
    at = _jumps(lambda x: wiring.rates_slope(x) / wiring.gain_hz_per_nat, x) & by_line
    at &= blocks > KINK_NATS
    names = [wiring.rows[b].name for b in np.flatnonzero(at.any(axis=0))]
    at = _jumps(wiring.units_slope, activity)[:, bent] & (units > KINK_NATS)
    names += [wiring.projections[u].name for u in np.flatnonzero(bent)[at.any(axis=0)]]
    if names:
        problem = f"{names[0]} of {wiring.circuit.name} is right at a kink"
        jumps = "where its slope jumps: the finite-size theory does not apply there"
        raise ValueError(f"{problem}, {jumps}")


def _jumps(slope: Callable[[Array], Array], at: Array) -> npt.NDArray[np.bool_]:
    """Return where a slope, nats/nat, differs between just below and just above."""
    low, high = slope(at - KINK_NATS), slope(at + KINK_NATS)
    return np.asarray(np.abs(high - low) > KINK * np.maximum(1, np.abs(low + high) / 2))


def rate_spectrum(circuit: CircuitTable, name: str, frequency_hz: npt.ArrayLike) -> Array:
    """Return the one-sided power (F,), Hz^2/Hz, of a population's rate averaged over channels.

    Power is that at rest; frequencies are at least 1e-3 Hz.
    Raises ValueError for a circuit with courses or an unstable fixed point, and where there is no
    theory of its noise: see ``fluctuation.extra``.
    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    lowest = FREQUENCIES_HZ[0]
    least = f"must be {lowest:g} or more"
    require((frequency >= lowest).all(), "frequency_hz", least, frequency.min())
    wiring = wired(circuit)
    x, extra_hz = _state(wiring)
    swept(wiring, x, extra_hz)  # raises if there is no spectrum
    fluctuations = linear(wiring, x, frequency, extra_hz)
    out, noise = fluctuations.out[0], fluctuations.noise[0]
    mean = out[:, wiring.blocks_of(name)].mean(axis=1)
    return np.asarray(2 * (np.abs(mean) ** 2 * noise).sum(axis=1))


def out_variance(
    circuit: CircuitTable, drive: npt.ArrayLike | None = None, *, mean_ms: float = 0.0
) -> dict[str, Array]:
    """Return the variance of OUT (channels,), nats^2, contributed by each population's noise.

    OUT is averaged over ``mean_ms`` after the read-out filter; the drive (channels,), nats, is
    constant, by default rest.
    """
    wiring = wired(circuit)
    frequency, fluctuations = swept(wiring, *_state(wiring, drive))
    out, noise = fluctuations.out[0], fluctuations.noise[0]
    read = wiring.blocks_of(circuit.readout)
    power = np.abs(out[:, read]) ** 2 * noise[:, None] / wiring.gain_hz_per_nat[read][:, None] ** 2
    turn = 2 * np.pi * frequency * circuit.readout_tau_ms / 1000
    seen = np.sinc(frequency * mean_ms / 1000) ** 2 / (1 + turn**2)
    # Two-sided: negative frequencies contribute as much.
    variance = 2 * np.trapezoid(power * seen[:, None, None], frequency, axis=0)
    return {
        row.name: variance[:, wiring.blocks_of(row.name)].sum(axis=1)
        for row in circuit.populations
        if row.spiking
    }


def count_ratio(circuit: CircuitTable, name: str) -> float:
    """Return the variance of one cell's spike counts over their mean, at rest, in long windows.

    For intervals that are independent this is the square of their coefficient of variation (Cox
    1962). Variability that cells share by the circuit's feedback is not in it.
    """
    wiring = wired(circuit)
    blocks = wiring.blocks_of(name)
    x = solve(wiring, held_drive(wiring, None))
    noise = linear(wiring, x, FREQUENCIES_HZ[:1]).noise[0, 0, blocks].mean()
    rate = wiring.rates(x)[0, blocks].mean()
    return float(noise * circuit.population(name).neurons / rate)


def _state(wiring: Wiring, drive: npt.ArrayLike | None = None) -> tuple[Array, Array]:
    """Return the state (1, blocks), nats, with finite-size shifts, and the shifts of rates, Hz."""
    wiring.circuit.check_steady("its noise in closed form")
    held = held_drive(wiring, drive)
    start = settled(wiring, held, solve(wiring, held))
    added = extra(wiring, start)
    return settled(wiring, held, start, *added), added.rates_hz
