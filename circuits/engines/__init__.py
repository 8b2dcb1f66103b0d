"""One interface to all engines, which run the same table as a fixed point, rates or spikes.

An engine is a record such as ``Populations(dt_ms=0.5)`` that contains its options, describes its
capabilities, and runs a circuit. Its name is shorthand for the record with default options.
``ENGINES`` lists all engines.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from circuits.activity import Activity
from circuits.declaration.courses import warn_of_late
from circuits.declaration.table import CircuitTable
from circuits.engines.engine import (
    ENGINES,
    CompiledEngine,
    Engine,
    EngineOrName,
    SpikingEngine,
    TimedEngine,
    engine_of,
    register,
)
from circuits.engines.shipped import Algebra, Brian2, Plain, Populations, Rates, Spikes
from circuits.errors import require

__all__ = [
    "ENGINES", "Algebra", "Brian2", "CompiledEngine", "Engine", "EngineOrName", "Plain",
    "Populations", "Rates", "Spikes", "SpikingEngine", "TimedEngine", "engine_of", "register",
    "run",
]  # fmt: skip


def run(
    circuit: CircuitTable,
    drive: npt.ArrayLike,
    *,
    engine: Engine | str,
    step_ms: float,
    seed: int | None = None,
    first_trial: int = 0,
    **options: object,
) -> Activity:
    """Run a circuit on an engine, given as a record or by name; arguments as for ``Engine.run``.

    ``options`` are fields of the engine to change. Warns if a course begins after the end of the
    run.
    """
    must = "must be a Circuit, as from circuits.anatomy.load_circuit"
    require(isinstance(circuit, CircuitTable), "circuit", must, circuit)
    chosen = engine_of(engine, **options)
    activity = chosen.run(circuit, drive, step_ms=step_ms, seed=seed, first_trial=first_trial)
    warn_of_late(circuit.courses, np.shape(drive)[1] * step_ms)
    return activity
