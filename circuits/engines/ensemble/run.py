"""The ensemble engine: thousands of spiking trials, compiled from the same table.

The scheme is that of ``circuits.dynamics.ticks``, the noise that of ``circuits.dynamics.noise``,
and the spikes are
those of the plain and the Brian2 engine, but for sparse connections: there inputs are rounded in
another order, so that now and then a spike comes a tick early or late; from that spike on the two
runs differ.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from tqdm import tqdm

from circuits.activity import Activity, checked_drive, spike_table, warn_beyond_range
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import Wiring
from circuits.engines.ensemble import kernel
from circuits.engines.ensemble.plan import plan, workspace
from circuits.engines.ensemble.records import Plan
from circuits.engines.stream import Onward, Stream
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.engines.shipped import Ensemble

TRIALS_A_TASK = 8
FIRST_CAPACITY = 4096


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    engine: Ensemble,
    *,
    step_ms: float,
    seed: int,
    first_trial: int = 0,
) -> Activity:
    """Run a circuit of spiking cells on many trials; the arguments are those of ``Engine.run``.

    Raises
    ------
    ValueError
        If the drive, a time or a name does not fit the circuit.
    """
    drive = checked_drive(circuit, drive)
    warn_beyond_range(circuit, drive)
    trials, steps, _ = drive.shape
    clock = Clock(steps, step_ms, engine.dt_ms, engine.sample_ms, engine.settle_ms)
    wiring = wired(circuit)
    names = circuit.spiking(engine.spikes)
    written = np.array([wiring.row(b).name in names for b in range(wiring.blocks)])
    streams = noise.stream_keys(seed, first_trial + np.arange(trials), wiring.names)
    out = np.empty((trials, clock.samples, circuit.channels))
    shape = (trials, clock.samples, wiring.blocks) if engine.rates else (trials, clock.samples, 0)
    kept = np.empty(shape, dtype=np.float32)
    p = plan(wiring, clock, kept=written)
    found = _trials(p, (drive, streams, out, kept), engine)
    about = {"seed": int(seed), "first_trial": first_trial}
    return Activity(
        circuit=circuit,
        time_ms=clock.time_ms,
        rates_hz={
            row.name: kept[..., wiring.blocks_of(row.name)]
            for row in circuit.populations
            if engine.rates
        },
        output_nats=out,
        engine=engine.id,
        spikes=_spike_tables(wiring, names, found, clock) if names else None,
        about=about | {"dt_ms": engine.dt_ms, "settle_ms": engine.settle_ms},
    )


def stream(
    circuit: Circuit, engine: Ensemble, *, step_ms: float, steps: int, seed: int, trial: int
) -> Stream:
    """Begin a trial of spiking cells; the arguments are those of ``Engine.stream``.

    Raises
    ------
    ValueError
        If a step is no multiple of the ticks that share their noise, or another time does not fit.
    """
    clock = Clock(steps, step_ms, engine.dt_ms, engine.sample_ms, engine.settle_ms)
    for name in ("step", "settle"):
        if getattr(clock, f"{name}_ticks") % noise.TICKS_A_WORD:
            word_ms = noise.TICKS_A_WORD * engine.dt_ms
            given = getattr(clock, f"{name}_ms")
            raise InputError.of(f"{name}_ms", f"must be a multiple of {word_ms:g} ms", given)
    wiring = wired(circuit)
    keys = noise.stream_keys(seed, np.array([trial]), wiring.names)[0]
    p = plan(wiring, clock, kept=np.zeros(wiring.blocks, dtype=bool))
    work, none = workspace(p), np.empty((0, 3), np.int32)
    rates = np.empty((clock.samples, 0), np.float32)

    def begin(drive: Array, out: Array) -> Onward:
        kernel.begin(p, work, keys)
        return lambda first, last: kernel.go_on(
            p, work, drive, keys, -np.inf, out, rates, none, first, last
        )

    return Stream(circuit, clock, begin)


def _trials(p: Plan, arrays: tuple[Any, ...], engine: Ensemble) -> list[npt.NDArray[np.int32]]:
    """Run all trials, a few per task; return the spikes of each.

    Parameters
    ----------
    p : Plan
        The circuit.
    arrays : tuple
        Drive, keys of noise, OUT and rates, a row per trial; the last two are written.
    engine : Ensemble
        Threads, and the OUT below which a trial is over.
    """
    trials = len(arrays[0])
    level = -np.inf if engine.drop_below is None else float(engine.drop_below)
    found = [np.empty((0, 3), np.int32)] * trials

    def task(first: int) -> int:
        room, work = np.empty((_capacity(p), 3), np.int32), workspace(p)
        last = min(first + TRIALS_A_TASK, trials)
        for t in range(first, last):
            drive, stream, out, kept = (array[t] for array in arrays)
            given = (p, work, drive, stream, level, out, kept)
            while (count := kernel.trial(*given, room)) > len(room):
                room = np.empty((2 * count, 3), np.int32)
            found[t] = room[:count].copy()
        return last - first

    with (
        ThreadPoolExecutor(max_workers=engine.workers) as pool,
        tqdm(total=trials, unit="trial", disable=not engine.progress) as bar,
    ):
        for done in pool.map(task, range(0, trials, TRIALS_A_TASK)):
            bar.update(done)
    return found


def _capacity(p: Plan) -> int:
    """Return for how many spikes there is room at first."""
    return FIRST_CAPACITY if p.blocks["kept"].any() else 0


def _spike_tables(
    wiring: Wiring, names: tuple[str, ...], found: list[Any], clock: Clock
) -> dict[str, pd.DataFrame]:
    trial = np.repeat(np.arange(len(found)), [len(rows) for rows in found])
    block, neuron, tick = np.concatenate(found).T if found else np.zeros((3, 0), np.int32)
    tables = {}
    for name in names:
        here = np.isin(block, wiring.blocks_of(name))
        tables[name] = spike_table(
            trial[here], wiring.channel[block[here]], neuron[here], tick[here], clock.dt_ms
        )
    return tables
