"""Sizes of a circuit, from which engines estimate the memory of a run."""

from __future__ import annotations

from circuits.declaration.table import CircuitTable


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
