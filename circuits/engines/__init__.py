"""One call for all engines: the same table, exactly, as rates, or as spikes.

An engine is a record: ``Population(dt_ms=0.5)`` names its options, says what it can do, and runs a
circuit. Its name is shorthand for the record with its defaults. ``ENGINES`` lists all of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy.typing as npt

from circuits.circuit import Circuit
from circuits.engines.engine import CompiledEngine, Engine, SpikingEngine, TimedEngine
from circuits.engines.registry import ENGINES, EngineOrName, engine_of, register
from circuits.engines.shipped import Algebra, Brian2, Ensemble, Plain, Population, Rate
from circuits.errors import require

if TYPE_CHECKING:
    from circuits.activity import Activity

__all__ = [
    "ENGINES",
    "Algebra",
    "Brian2",
    "CompiledEngine",
    "Engine",
    "EngineOrName",
    "Ensemble",
    "Plain",
    "Population",
    "Rate",
    "SpikingEngine",
    "TimedEngine",
    "engine_of",
    "register",
    "run",
]


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    *,
    engine: Engine | str,
    step_ms: float,
    seed: int | None = None,
    first_trial: int = 0,
    **options: object,
) -> Activity:
    """Run a circuit on one of the engines.

    Parameters
    ----------
    circuit : Circuit
        The table.
    drive : array (trials, steps, channels), nats
        Accumulated evidence; 0 is rest. Each reading is held until the next.
    engine : Engine or str
        A record, or the name of one with its defaults.
    step_ms : float
        Time from one reading to the next, ms.
    seed : int, optional
        Key of the noise; required by the engines that have noise. Trial t has the noise of
        (seed, first_trial + t), whatever runs with it.
    first_trial : int
        Number of the first trial.
    **options
        Options of the engine to change: its fields.

    Raises
    ------
    ValueError
        For an unknown engine, one with noise and no seed, or an option that it does not take.
    """
    must = "must be a Circuit, as from circuits.anatomy.load_circuit"
    require(isinstance(circuit, Circuit), "circuit", must, circuit)
    chosen = engine_of(engine, **options)
    return chosen.run(circuit, drive, step_ms=step_ms, seed=seed, first_trial=first_trial)
