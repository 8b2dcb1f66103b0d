"""Power of rates and the noise of OUT in closed form, for cells that are alike.

Linear noise about the fixed point of a finite number of cells (``circuits.laws.fluctuation``): what
``Activity.spectrum`` and the scatter of OUT from trial to trial measure.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.fixed_point import solve, wired
from circuits.laws.fluctuation import FREQUENCIES_HZ, extra_rates, linear
from circuits.laws.mean_field import settled
from circuits.spec import Circuit
from circuits.wiring import Wiring


def rate_spectrum(
    circuit: Circuit, name: str, frequency_hz: npt.ArrayLike, drive: npt.ArrayLike | None = None
) -> Array:
    """Return the one-sided power (F,), Hz^2/Hz, of a population's rate, its channels averaged.

    Parameters
    ----------
    circuit : Circuit
        The table.
    name : str
        The population.
    frequency_hz : array (F,)
        From 1e-3 on.
    drive : array (channels,), nats, optional
        Held evidence; rest if left out.

    Raises
    ------
    ValueError
        If the circuit has no fixed point or it is unstable, or if noise is not known: see
        ``fluctuation.linear``.
    """
    wiring = wired(circuit)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    out, own = _noise(wiring, drive, frequency)
    mean = out[:, wiring.blocks_of(name)].mean(axis=1)
    return np.asarray(2 * (np.abs(mean) ** 2 * own).sum(axis=1))


def out_variance(
    circuit: Circuit, drive: npt.ArrayLike | None = None, *, mean_ms: float = 0.0
) -> dict[str, Array]:
    """Return whose noise makes OUT scatter: its variance (channels,), nats^2, by population.

    Parameters
    ----------
    circuit : Circuit
        The table.
    drive : array (channels,), nats, optional
        Held evidence; rest if left out.
    mean_ms : float
        A time that OUT is averaged for, after the read-out's filter.

    Raises
    ------
    ValueError
        As ``rate_spectrum``.
    """
    wiring, frequency = wired(circuit), FREQUENCIES_HZ
    out, own = _noise(wiring, drive, frequency)
    read = wiring.blocks_of(circuit.readout)
    power = np.abs(out[:, read]) ** 2 * own[:, None] / wiring.gain_hz_per_nat[read][:, None] ** 2
    turn = 2 * np.pi * frequency * circuit.readout_tau_ms / 1000
    seen = np.sinc(frequency * mean_ms / 1000) ** 2 / (1 + turn**2)
    # Two-sided: as much lies at negative frequencies.
    variance = 2 * np.trapezoid(power * seen[:, None, None], frequency, axis=0)
    return {
        row.name: variance[:, wiring.blocks_of(row.name)].sum(axis=1)
        for row in circuit.populations
        if row.spiking
    }


def _noise(wiring: Wiring, drive: npt.ArrayLike | None, frequency: Array) -> tuple[Complex, Array]:
    """Return how own noise reaches rates, (F, blocks, blocks), and its power, (F, blocks)."""
    channels = wiring.circuit.channels
    held = np.zeros(channels) if drive is None else np.asarray(drive, dtype=np.float64)
    if held.shape != (channels,) or not np.isfinite(held).all():
        raise ValueError(f"drive must be {channels} finite numbers, got {drive!r}")
    lowest = FREQUENCIES_HZ[0]
    if not (frequency >= lowest).all():
        raise ValueError(f"frequency_hz must be {lowest:g} or more, got {frequency.min()}")
    start = settled(wiring, held[None], solve(wiring, held[None]))
    x = settled(wiring, held[None], start, extra_rates(wiring, start))
    found = linear(wiring, x, frequency)
    return found.out[0], found.own[0]
