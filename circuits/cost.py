"""Memory that a run takes, estimated from the table before it starts."""

from __future__ import annotations

from circuits.circuit import Circuit
from circuits.engines import ENGINES, SPIKING

CELL_BYTES = {"ensemble": 40.0, "brian2": 100.0, "plain": 100.0}
"""Memory of a cell: in each thread of the compiled engine, in each trial of Brian2; measured."""


def cells(circuit: Circuit) -> float:
    """Return the number of spiking cells of a circuit."""
    rows = (row for row in circuit.populations if row.spiking)
    return float(sum(row.neurons * circuit.channels_of(row.name) for row in rows))


def memory_bytes(
    circuit: Circuit, engine: str, trials: int, samples: int, *, rates: bool, workers: int
) -> float:
    """Return about how much memory a run takes.

    Parameters
    ----------
    circuit : Circuit
        The table.
    engine : str
        A name in ``ENGINES``.
    trials, samples : int
        Trials at a time, and samples of OUT in each.
    rates : bool
        Whether rates are kept.
    workers : int
        Threads.

    Raises
    ------
    ValueError
        For an unknown engine.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    blocks = sum(circuit.channels_of(row.name) for row in circuit.populations)
    outputs = 8.0 * trials * samples * circuit.channels
    if engine == "algebra":
        # Rates of all populations are in double precision on the way, kept or not.
        return outputs + 12.0 * trials * samples * blocks
    kept = 4.0 * trials * samples * blocks if rates else 0.0
    if engine not in SPIKING:
        return outputs + kept
    copies = trials if engine == "brian2" else workers
    return (
        outputs + kept + _connections_bytes(circuit) + CELL_BYTES[engine] * cells(circuit) * copies
    )


def _connections_bytes(circuit: Circuit) -> float:
    """Return the memory of sparse connections: an index of 8 bytes each, and a mark per pair."""
    total = 0.0
    for p in circuit.projections:
        ends = [circuit.population(name) for name in (p.source, p.target)]
        if p.probability < 1 and all(row.spiking for row in ends):
            size = [float(row.neurons) * circuit.channels_of(row.name) for row in ends]
            total += size[0] * size[1] * (8 * p.probability + 1)
    return total
