"""Power of rates and the noise of OUT in closed form.

Linear noise about the fixed point of a finite number of cells, at rest or at a held drive, also
where pathways bend (``circuits.laws.fluctuation``): what ``Activity.spectrum`` and the scatter of
OUT from trial to trial measure.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import held_drive, solve, wired
from circuits.dynamics.wiring import Wiring
from circuits.errors import require
from circuits.laws.fluctuation import FREQUENCIES_HZ, extra, linear, swept
from circuits.laws.mean_field import settled


def rate_spectrum(
    circuit: CircuitTable,
    name: str,
    frequency_hz: npt.ArrayLike,
    drive: npt.ArrayLike | None = None,
) -> Array:
    """Return the one-sided power (F,), Hz^2/Hz, of a population's rate, its channels averaged.

    Parameters
    ----------
    circuit : CircuitTable
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
        If the circuit has courses, it has no fixed point or that is unstable, or if noise is not
        known: see ``fluctuation.extra``.
    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    lowest = FREQUENCIES_HZ[0]
    least = f"must be {lowest:g} or more"
    require((frequency >= lowest).all(), "frequency_hz", least, frequency.min())
    wiring = wired(circuit)
    x, extra_hz = _state(wiring, drive)
    swept(wiring, x, extra_hz)  # raises where there is no spectrum
    found = linear(wiring, x, frequency, extra_hz)
    out, own = found.out[0], found.own[0]
    mean = out[:, wiring.blocks_of(name)].mean(axis=1)
    return np.asarray(2 * (np.abs(mean) ** 2 * own).sum(axis=1))


def out_variance(
    circuit: CircuitTable, drive: npt.ArrayLike | None = None, *, mean_ms: float = 0.0
) -> dict[str, Array]:
    """Return the variance of OUT (channels,), nats^2, contributed by each population's noise.

    Parameters
    ----------
    circuit : CircuitTable
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
    wiring = wired(circuit)
    frequency, found = swept(wiring, *_state(wiring, drive))
    out, own = found.out[0], found.own[0]
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


def _state(wiring: Wiring, drive: npt.ArrayLike | None) -> tuple[Array, Array]:
    """Return the state (1, blocks), nats, of a finite number of cells, and its extra rates, Hz."""
    wiring.circuit.check_steady("its noise in closed form")
    held = held_drive(wiring, drive)
    start = settled(wiring, held, solve(wiring, held))
    added = extra(wiring, start)
    return settled(wiring, held, start, *added), added.rates_hz
