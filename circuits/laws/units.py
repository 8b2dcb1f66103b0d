"""What an input in nats amounts to: Hz and per cent of a nucleus, picoamperes, nanosiemens."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from circuits.cells.membrane import Membrane, lif_mean_mv
from circuits.checks import check_finite
from circuits.declaration.rows import Population
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import rest, wired

if TYPE_CHECKING:
    import pandas as pd

CELL = Membrane(tau_ms=20.0, noise_mv=4.0, threshold_mv=20.0, reset_mv=15.0, refractory_ms=2.0)
LEAK_NS, POTENTIAL_MV, REVERSAL_MV = 25.0, -50.0, {1: 0.0, -1: -70.0}
"""Cell for nuclei whose cells have no membrane, its leak, its potential (the threshold), and the
reversal potentials of excitation and inhibition: STN of the CBGT network (github.com/CoAxLab/CBGT,
params/STN.py); refractory period and noise are assumed."""


def effect_of_nats(circuit: CircuitTable, nats: float = 1.0) -> pd.DataFrame:
    """Return what a constant input to all channels of one nucleus does at rest, in other units.

    There is one row per nucleus: ``rest_hz``; ``hz`` and ``percent``, the change of its rate before
    the circuit responds; slopes at rest before (``hz_per_nat``) and after all loops have settled
    (``settled_hz_per_nat``); and the input to each cell with the effect of ``hz``: ``current_pa``,
    ``conductance_ns``. NaN where that is not defined, as at a rate of 0.

    With the slopes R of rates and U of units, a small input b settles at the state ``x = (1 - W U D
    R)^-1 b``. A current I moves the mean potential by ``I / g``, g the leak: ``mv_per_nat`` per nat
    in cells with a membrane, otherwise what takes ``CELL`` from one rate to the other. The
    conductance is ``I / (reversal - potential)``.
    """
    import pandas as pd

    check_finite(nats=nats)
    wiring = wired(circuit)
    x = rest(wiring)
    hz, moved, slope = wiring.rates(x), wiring.rates(x + nats), wiring.rates_slope(x)
    units = wiring.units_slope(wiring.deliver @ hz + wiring.constant)
    loops = wiring.weight * units @ wiring.deliver * slope
    settled = slope[:, None] * np.linalg.inv(np.eye(wiring.blocks) - loops)
    rows, per = circuit.populations, f"hz_per_{circuit.unit.removesuffix('s')}"
    places = [wiring.blocks_of(row.name) for row in rows]
    table = pd.DataFrame({"nucleus": [row.name for row in rows]})
    table["rest_hz"], after_hz = ([rates[b].mean() for b in places] for rates in (hz, moved))
    table["hz"] = after_hz - table["rest_hz"]
    table["percent"] = 100 * (table["hz"] / table["rest_hz"].where(table["rest_hz"] != 0))
    table[per] = [slope[b].mean() for b in places]
    table[f"settled_{per}"] = [settled[np.ix_(b, b)].sum(axis=1).mean() for b in places]
    ends = zip(rows, table["rest_hz"], after_hz, strict=True)
    table["current_pa"] = [LEAK_NS * _shift_mv(row, nats, *rates) for row, *rates in ends]
    driving_mv = REVERSAL_MV[1 if nats > 0 else -1] - POTENTIAL_MV
    return table.assign(conductance_ns=table["current_pa"] / driving_mv)


def _shift_mv(row: Population, nats: float, from_hz: float, to_hz: float) -> float:
    """Return by how much an input shifts the mean potential of a nucleus's cells, mV."""
    if (slope := getattr(row.cell, "mv_per_nat", None)) is not None:
        return float(slope * nats)
    fires = all(0 < hz < 1000 / CELL.refractory_ms for hz in (from_hz, to_hz))
    return lif_mean_mv(CELL, to_hz) - lif_mean_mv(CELL, from_hz) if fires else np.nan
