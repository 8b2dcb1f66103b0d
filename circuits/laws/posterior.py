"""Deviation of OUT from -ln P at the fixed point, over the table's readable range."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.checks import check_range
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import solve, wired

STEPS = 21
"""Number of values of OUT at which it is evaluated, over the readable range."""
BEHIND_NATS = 30.0
"""Deficit of a competitor whose contribution is negligible, nats."""


def off_nats(circuit: CircuitTable, competitors: int | None = None) -> tuple[float, float]:
    """Return the lowest and highest OUT - (-ln P), nats, of the leader at the fixed point.

    The drive is centred and limited as the table says. ``competitors`` have equal drive, the others
    are far behind; by default all compete.
    """
    circuit.check_nats("OUT as -ln P")
    count = circuit.channels - 1 if competitors is None else competitors
    check_range(1, circuit.channels - 1, competitors=count)
    low, high = circuit.readable_nats
    want = np.linspace(low, min(high, np.log(count + 1)), STEPS + 1)[1:]
    drive = np.full((STEPS, circuit.channels), -BEHIND_NATS)
    drive[:, 0] = 0.0
    drive[:, 1 : count + 1] = (np.log(np.expm1(want)) - np.log(count))[:, None]
    off = _out(circuit, _entering(circuit, drive))[:, 0] - want
    return float(off.min()), float(off.max())


def _entering(circuit: CircuitTable, drive: Array) -> Array:
    """Return a drive as it enters: limited to the circuit's reach, and centred if required."""
    if not circuit.centred:
        return drive
    cut = np.maximum(drive, drive.max(axis=1, keepdims=True) - circuit.max_deficit_nats)
    return np.asarray(cut - cut.mean(axis=1, keepdims=True))


def _out(circuit: CircuitTable, drive: Array) -> npt.NDArray[np.float64]:
    """Return OUT (drives, channels) at the fixed point, nats."""
    wiring, name = wired(circuit), circuit.readout
    return wiring.activity(wiring.rates(solve(wiring, drive))[:, wiring.blocks_of(name)], name)
