"""The ensemble engine: thousands of spiking trials, compiled from the same table.

The scheme is that of ``circuits.dynamics.ticks``, the noise that of ``circuits.dynamics.noise``,
and the spikes are
those of the plain and the Brian2 engine, but for sparse connections: there inputs are rounded in
another order, so that now and then a spike comes a tick early or late; from that spike on the two
runs differ.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from tqdm import tqdm

from circuits.activity import Activity, checked_drive, spike_table, warn_beyond_range
from circuits.checks import is_whole
from circuits.circuit import Circuit
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import Wiring
from circuits.engines.ensemble import kernel
from circuits.engines.ensemble.plan import plan, workspace
from circuits.engines.ensemble.records import Plan

TRIALS_A_TASK = 8
FIRST_CAPACITY = 4096


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    *,
    step_ms: float,
    seed: int,
    dt_ms: float = 0.1,
    sample_ms: float = 1.0,
    settle_ms: float = 300.0,
    first_trial: int = 0,
    spikes: Iterable[str] = (),
    rates: bool = True,
    drop_below: float | None = None,
    workers: int = 1,
    progress: bool = False,
) -> Activity:
    """Run a circuit of spiking cells on many trials.

    Parameters
    ----------
    circuit : Circuit
        The table.
    drive : array (trials, steps, channels), nats
        Accumulated evidence; 0 is rest.
    step_ms : float
        Time from one reading to the next, ms.
    seed : int
        Key of all noise; trial t has the noise of (seed, first_trial + t), whatever runs beside it.
    dt_ms, sample_ms, settle_ms : float
        As in ``Clock``.
    first_trial : int
        Number of the first trial.
    spikes : names
        Populations whose spikes are written down.
    rates : bool
        Whether to keep the rates: 4 bytes per trial, sample and channel of each population.
    drop_below : float, optional
        OUT, nats, below which a trial is over: what follows is NaN.
    workers : int
        Threads; they change no byte.
    progress : bool
        Whether to show how far it is.

    Raises
    ------
    ValueError
        If the drive, a time or a name does not fit the circuit.
    """
    drive = checked_drive(circuit, drive)
    warn_beyond_range(circuit, drive)
    trials, steps, _ = drive.shape
    clock = Clock(steps, step_ms, dt_ms, sample_ms, settle_ms)
    if not is_whole(workers) or workers < 1:
        raise ValueError(f"workers must be a whole number >= 1, got {workers!r}")
    wiring = wired(circuit)
    names = circuit.spiking(spikes)
    written = np.array([wiring.row(b).name in names for b in range(wiring.blocks)])
    level = -np.inf if drop_below is None else float(drop_below)
    streams = noise.stream_keys(seed, first_trial + np.arange(trials), wiring.names)
    out = np.empty((trials, clock.samples, circuit.channels))
    shape = (trials, clock.samples, wiring.blocks) if rates else (trials, clock.samples, 0)
    kept = np.empty(shape, dtype=np.float32)
    p = plan(wiring, clock, kept=written)
    found = _trials(p, (drive, streams, out, kept), level, workers, progress)
    about = {"seed": int(seed), "first_trial": first_trial, "dt_ms": dt_ms, "settle_ms": settle_ms}
    return Activity(
        circuit=circuit,
        time_ms=clock.time_ms,
        rates_hz={
            row.name: kept[..., wiring.blocks_of(row.name)] for row in circuit.populations if rates
        },
        output_nats=out,
        engine="ensemble",
        spikes=_spike_tables(wiring, names, found, clock) if names else None,
        about=about,
    )


def _trials(
    p: Plan, arrays: tuple[Any, ...], level: float, workers: int, progress: bool
) -> list[npt.NDArray[np.int32]]:
    """Run all trials, a few per task; return the spikes of each.

    Parameters
    ----------
    p : Plan
        The circuit.
    arrays : tuple
        Drive, keys of noise, OUT and rates, a row per trial; the last two are written.
    level : float
        OUT below which a trial is over.
    workers, progress :
        As for ``run``.
    """
    trials = len(arrays[0])
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
        ThreadPoolExecutor(max_workers=workers) as pool,
        tqdm(total=trials, unit="trial", disable=not progress) as bar,
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
