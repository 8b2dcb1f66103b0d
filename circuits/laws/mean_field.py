"""The fixed point of a circuit with the cells' f-I curves in place of the table's lines.

In the table every population follows a line. Integrate-and-fire cells deviate from it, most of all
near silence, which shifts the fixed point.

In a heterogeneous population, three factors on the cells' constants vary with a standard deviation
``heterogeneity``. Averaging over six points, each factor up or down by sqrt(3) standard deviations,
is exact to third order.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import Cell, Line, Response
from circuits.dynamics.ticks import LEAST_FACTOR
from circuits.dynamics.wiring import Wiring

TOLERANCE = 1e-10
STEP_NATS = 1e-7
"""Step of the finite differences in the Jacobian."""


@lru_cache(maxsize=256)
def differing(cell: Cell, heterogeneity: float) -> tuple[tuple[Cell, float], ...]:
    """Return representative cells, each with a factor on the rate of its line."""
    if not heterogeneity:
        return ((cell, 1.0),)
    ways = np.concatenate([np.eye(3), -np.eye(3)]) * np.sqrt(3) * heterogeneity
    return tuple(cell.varied(np.maximum(1 + way, LEAST_FACTOR)) for way in ways)


def mean_rate_hz(cell: Cell, heterogeneity: float, x: Array, hz: Array) -> Array:
    """Return the mean rate at inputs x (S,), where the line has the rates ``hz`` (S,), Hz."""
    alike = cell.rate_hz(x, hz)  # raises for a type without an f-I curve
    if not heterogeneity:
        return alike
    every = [each.rate_hz(x, factor * hz) for each, factor in differing(cell, heterogeneity)]
    return np.asarray(np.mean(every, axis=0))


def mean_response(
    cell: Cell, heterogeneity: float, x: Array, line: Line, frequency_hz: Array
) -> Response:
    """Return the mean response at inputs x (S,) on a line, at frequencies (F,)."""
    responses = [
        each.response(x, Line(*(factor * part for part in line)), frequency_hz)
        for each, factor in differing(cell, heterogeneity)
    ]
    return Response(*(np.mean(part, axis=0) for part in zip(*responses, strict=True)))


def own_rates(wiring: Wiring, x: Array) -> Array:
    """Return the rates (trials, blocks), Hz, at steady inputs, nats, from the cells' f-I curves."""
    hz = wiring.rates(x)
    for b in range(wiring.blocks):
        row = wiring.rows[b]
        hz[:, b] = mean_rate_hz(row.cell, row.heterogeneity, x[:, b], hz[:, b])
    return hz


def settled(
    wiring: Wiring,
    drive: Array,
    start: Array,
    extra_hz: Array | float = 0.0,
    extra_nats: Array | float = 0.0,
) -> Array:
    """Return the state (trials, blocks) at the fixed point with ``own_rates``, nats.

    ``start`` is the initial guess, the fixed point of the lines; ``extra_hz`` and ``extra_nats``
    are added to rates and inputs.
    """
    outside, extra = wiring.drive(drive) + extra_nats, np.broadcast_to(extra_hz, start.shape)
    trials = zip(outside, extra, start, strict=True)
    return np.array([_settled(wiring, *each) for each in trials]).reshape(start.shape)


def _settled(wiring: Wiring, outside: Array, extra_hz: Array, start: Array) -> Array:
    from scipy.optimize import root

    def residual(x: Array) -> Array:
        hz = own_rates(wiring, np.atleast_2d(x)) + extra_hz
        units = hz @ wiring.deliver.T + wiring.constant
        return np.asarray((outside + wiring.inputs(units)).reshape(x.shape) - x)

    def jacobian(x: Array) -> Array:
        # One call for all perturbed states: the overhead of calls dominates.
        near = residual(np.vstack([x, x + STEP_NATS * np.eye(len(x))]))
        return np.asarray((near[1:] - near[0]).T / STEP_NATS)

    solution = root(residual, start, jac=jacobian, tol=TOLERANCE)
    if not solution.success:
        problem = "no fixed point was found with the cells' own f-I curves"
        raise ValueError(f"{wiring.circuit.name}: {problem}")
    return np.asarray(solution.x)
