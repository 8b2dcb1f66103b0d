"""The algebra engine: the fixed point of the table, solved to rounding error."""

from __future__ import annotations

import numpy as np

from circuits.activity import Activity, warn_beyond_range
from circuits.arrays import Array
from circuits.checks import check_positive
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import solve, wired
from circuits.dynamics.wiring import Wiring
from circuits.engines.shipped import Algebra
from circuits.laws.fluctuation import extra
from circuits.laws.mean_field import own_rates, settled

TRIALS_AT_ONCE = 512


def run(
    circuit: CircuitTable, drive: Array, engine: Algebra, step_ms: float, seed: object, first: int
) -> Activity:
    """Return the fixed point for every reading; seed and first have no effect."""
    check_positive(step_ms=step_ms)
    circuit.check_steady("the algebra engine")
    warn_beyond_range(circuit, drive)
    wiring = wired(circuit)
    flat = drive.reshape(-1, drive.shape[-1])
    some = [flat[i : i + TRIALS_AT_ONCE] for i in range(0, len(flat), TRIALS_AT_ONCE)]
    hz = np.concatenate([_rates(wiring, part, engine.laws) for part in some])
    rates = hz.reshape(*drive.shape[:2], wiring.blocks)
    time = step_ms * np.arange(drive.shape[1], dtype=np.float64)
    return Activity.from_blocks(wiring, rates, time, engine=engine.id)


def _rates(wiring: Wiring, drive: Array, laws: str) -> Array:
    x = solve(wiring, drive)
    if laws == "table":
        return wiring.rates(x)
    x = settled(wiring, drive, x)
    if laws == "cells":
        return own_rates(wiring, x)
    noisy = extra(wiring, x)
    return own_rates(wiring, settled(wiring, drive, x, *noisy)) + noisy.rates_hz
