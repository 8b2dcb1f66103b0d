"""What a run takes of memory and time, estimated from the table before it starts."""

from __future__ import annotations

from circuits.engines import ENGINES, SPIKING
from circuits.spec import Circuit

CELL_BYTES = {"ensemble": 40.0, "brian2": 100.0, "plain": 100.0}
"""Memory of a cell: in each thread of the compiled engine, in each trial of Brian2; measured."""
CELL_S = {"ensemble": 2e-6, "brian2": 8e-4, "plain": 6e-4}
"""CPU time of a cell and a simulated second at a tick of .1 ms, s; measured. Of plain between half
(15 000 cells and more) and twice as much (3 600)."""
BLOCK_S = {"population": 1e-5, "rate": 1e-5, "algebra": 3e-5}
"""CPU time of a population's channel and a simulated second (20 readings, to the fixed point), s;
measured."""


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


def run_s(
    circuit: Circuit, engine: str, simulated_s: float, *, workers: int = 1, dt_ms: float = 0.1
) -> float:
    """Return about how long a run takes if no trial is dropped, s.

    Parameters
    ----------
    circuit : Circuit
        The table.
    engine : str
        A name in ``ENGINES``.
    simulated_s : float
        Simulated time of all trials together, s.
    workers : int
        Threads.
    dt_ms : float
        Tick of the engines that spike, ms.

    Raises
    ------
    ValueError
        For an unknown engine.
    """
    if engine in BLOCK_S:
        blocks = sum(circuit.channels_of(row.name) for row in circuit.populations)
        return BLOCK_S[engine] * blocks * simulated_s / workers
    if engine not in CELL_S:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    return CELL_S[engine] * cells(circuit) * simulated_s / workers * 0.1 / dt_ms


def about(seconds: float) -> str:
    """Return a duration as text with one significant figure: "about 20 seconds"."""
    # Up to one and a half of a unit the smaller one says more.
    sizes = {"hour": 3600.0, "minute": 60.0, "second": 1.0}
    unit = next((name for name, size in sizes.items() if seconds >= 1.5 * size), "second")
    count = float(f"{max(seconds / sizes[unit], 1.0):.0e}")
    return f"about {count:.0f} {unit}{'s' if count > 1 else ''}"


def _connections_bytes(circuit: Circuit) -> float:
    """Return the memory of sparse connections: an index of 8 bytes each, and a mark per pair."""
    total = 0.0
    for p in circuit.projections:
        ends = [circuit.population(name) for name in (p.source, p.target)]
        if p.probability < 1 and all(row.spiking for row in ends):
            size = [float(row.neurons) * circuit.channels_of(row.name) for row in ends]
            total += size[0] * size[1] * (8 * p.probability + 1)
    return total
