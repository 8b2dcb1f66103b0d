"""Mean responses of heterogeneous populations.

Three factors on the cells' constants vary with a standard deviation ``heterogeneity``. Averaging
over six points, each factor up or down by sqrt(3) standard deviations, is exact to third order.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import Cell, Line, Response
from circuits.dynamics.ticks import LEAST_FACTOR


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
