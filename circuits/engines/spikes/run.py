"""The spikes engine: thousands of spiking trials, compiled from the same table.

The scheme is that of ``circuits.dynamics.ticks``, the noise that of ``circuits.dynamics.noise``.
The spikes are those of the plain and the Brian2 engine, except with sparse connections: inputs are
then summed in another order, so that a spike occasionally comes one tick earlier or later, and the
runs differ from then on.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.activity import Activity, spike_tables, warn_beyond_range
from circuits.arrays import Array
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.engines.shipped import Spikes
from circuits.engines.spikes import kernel
from circuits.engines.spikes.plan import plan, workspace
from circuits.engines.spikes.records import Plan
from circuits.engines.stream import Onward, Stream
from circuits.errors import InputError

TRIALS_A_TASK = 8
FIRST_CAPACITY = 4096
"""Initial capacity for the spikes of a trial."""


def run(
    circuit: CircuitTable, drive: Array, engine: Spikes, step_ms: float, seed: int, first: int
) -> Activity:
    """Run a circuit of spiking cells on many trials; the arguments are those of ``Engine.run``."""
    warn_beyond_range(circuit, drive)
    trials, steps, _ = drive.shape
    wiring = wired(circuit)
    clock = engine.clock(wiring, steps, step_ms)
    names = circuit.spiking(engine.spikes)
    written = np.array([row.name in names for row in wiring.rows])
    streams = noise.stream_keys(seed, first + np.arange(trials), wiring.names)
    out, kept = engine.outputs(trials, clock.samples, wiring)
    p = plan(wiring, clock, kept=written)
    spikes = _trials(p, (drive, streams, out, kept), engine)
    return Activity.from_blocks(
        wiring,
        kept if engine.rates else None,
        clock.time_ms,
        engine=engine.id,
        output_nats=out,
        spikes=spike_tables(wiring, names, spikes, clock.dt_ms),
        about=clock.about(seed, first),
    )


def stream(
    circuit: CircuitTable, engine: Spikes, *, step_ms: float, steps: int, seed: int, trial: int
) -> Stream:
    """Begin a trial of spiking cells; the arguments are those of ``Engine.stream``.

    A step must be a multiple of the ticks that share a noise word.
    """
    wiring = wired(circuit)
    clock = engine.clock(wiring, steps, step_ms)
    for name in ("step", "settle"):
        if getattr(clock, f"{name}_ticks") % noise.TICKS_A_WORD:
            word_ms = noise.TICKS_A_WORD * clock.dt_ms
            time_ms = getattr(clock, f"{name}_ms")
            raise InputError.of(f"{name}_ms", f"must be a multiple of {word_ms:g} ms", time_ms)
    keys = noise.stream_keys(seed, np.array([trial]), wiring.names)[0]
    p = plan(wiring, clock, kept=np.zeros(wiring.blocks, dtype=bool))
    work, none = workspace(p), np.empty((0, 3), np.int32)
    rates = np.empty((clock.samples, 0), np.float32)

    def begin(drive: Array, out: Array) -> Onward:
        kernel.begin(p, work, keys)
        arguments = (p, work, drive, keys, -np.inf, out, rates, none)
        return lambda first, last: kernel.go_on(*arguments, first, last)

    return Stream(circuit, clock, begin)


def _trials(p: Plan, arrays: tuple[Any, ...], engine: Spikes) -> list[npt.NDArray[np.int32]]:
    """Run all trials, a few per task; return the spikes of each.

    ``arrays`` are drive, keys of noise, OUT and rates, one row per trial; the last two are written.
    """
    trials = len(arrays[0])
    spikes = [np.empty((0, 3), np.int32)] * trials

    def task(first: int) -> None:
        capacity = FIRST_CAPACITY if p.blocks["kept"].any() else 0
        room, work = np.empty((capacity, 3), np.int32), workspace(p)
        last = min(first + TRIALS_A_TASK, trials)
        for t in range(first, last):
            drive, stream, out, kept = (array[t] for array in arrays)
            arguments = (p, work, drive, stream, engine.level_nats, out, kept)
            while (count := kernel.trial(*arguments, room)) > len(room):
                room = np.empty((2 * count, 3), np.int32)
            spikes[t] = room[:count].copy()

    with ThreadPoolExecutor(max_workers=engine.workers) as pool:
        list(pool.map(task, range(0, trials, TRIALS_A_TASK)))
    return spikes
