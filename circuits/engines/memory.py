"""Sizes of a circuit, from which engines estimate the memory of a run, and memory for results."""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np

from circuits.declaration.table import CircuitTable

CACHE_LINE = 16
"""Single-precision numbers in a cache line of 64 bytes."""


def on_cache_lines(shape: tuple[int, ...]) -> Any:
    """Return an empty array of single precision that begins at a cache line."""
    size = prod(shape)
    raw = np.empty(size + CACHE_LINE, np.float32)
    start = -raw.ctypes.data // raw.itemsize % CACHE_LINE
    return raw[start : start + size].reshape(shape)


def blocks(circuit: CircuitTable) -> int:
    """Return the number of populations, counted in each channel that they have."""
    return sum(circuit.channels_of(row.name) for row in circuit.populations)


def cells(circuit: CircuitTable) -> float:
    """Return the number of spiking cells of a circuit."""
    rows = (row for row in circuit.populations if row.spiking)
    return float(sum(row.neurons * circuit.channels_of(row.name) for row in rows))


def connection_bytes(circuit: CircuitTable) -> float:
    """Return the memory of sparse connections: an index of 8 bytes each, and a mark per pair."""
    total = 0.0
    for p in circuit.projections:
        if circuit.is_sparse(p):
            ends = [circuit.population(name) for name in (p.source, p.target)]
            size = [float(row.neurons) * circuit.channels_of(row.name) for row in ends]
            total += size[0] * size[1] * (8 * p.probability + 1)
    return total
