"""The population engine: rates instead of cells, at a cost independent of the number of cells.

Every population transmits a rate. It follows the row's line after the membrane filter
(``laws="lines"``), or the cells' f-I curve with their lags (``laws="cells"``); with ``noise=True``
it has the noise of a finite number of cells, with the spectrum of their spikes and keyed like the
noise of cells. The scheme is that of ``circuits.dynamics.ticks``, except that filters interpolate
rates linearly between ticks.

Assumptions: cells of a population have the same input and fire independently (no synchrony beyond
that caused by the common input; heterogeneous cells contribute their mean response), and their
noise is Gaussian, so that a nearly silent population may briefly transmit a negative rate. Lags
depend on a running mean of the input (time constant 50 ms), so that a sudden large change arrives
up to 10 ms late. Literature: Brunel & Hakim 1999 (Neural Comput 11, 1621) for finite-size noise;
Ostojic & Brunel 2011 (PLoS Comput Biol 7, e1001056) for state-dependent lags; Schwalger, Deger &
Gerstner 2017 (PLoS Comput Biol 13, e1005507) for the exact treatment.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.activity import Activity, warn_beyond_range
from circuits.arrays import Array, Index
from circuits.checks import check_positive, is_whole
from circuits.declaration.table import CircuitTable
from circuits.dynamics import loops
from circuits.dynamics import noise as noises
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Scheme
from circuits.engines.population import kernel
from circuits.engines.population.plan import plan, window, workspace
from circuits.engines.population.records import State
from circuits.engines.population.settled import FIRST, settled
from circuits.engines.shipped import PopulationsEngine
from circuits.engines.stream import Onward, Stream
from circuits.errors import InputError, NoiseWarning
from circuits.laws.stability import ringing

RINGING = 8.0
"""Amplification of fluctuations by feedback loops above which a warning is issued."""
NOT_SAVED = State(*(np.zeros((0,) * axes, np.float32) for axes in (3, 3, 3, 2)))
"""Room for the final states of trials, which are not kept."""
_ringing = lru_cache(maxsize=64)(ringing)


def run(
    circuit: CircuitTable,
    drive: Array,
    engine: PopulationsEngine,
    step_ms: float,
    seed: int | None,
    first_trial: int,
) -> Activity:
    """Run a circuit's populations on many trials; the arguments are those of ``Engine.run``.

    Rates are means between samples; OUT is low-pass filtered and read at each sample's end. A
    warning is issued near an oscillation, for fewer than 30 cells, and if a filter deviates from
    theory; rates that diverge raise ValueError.
    """
    _check_trials(len(drive), first_trial=first_trial)
    check_positive(step_ms=step_ms)
    prepared = _Prepared(circuit, engine, drive.shape[1], step_ms)
    warn_beyond_range(circuit, drive)
    if engine.noise:
        _warn_of_ringing(circuit)
    clock, wiring, seed = prepared.clock, prepared.scheme.wiring, int(seed or 0)
    out, kept = engine.outputs(len(drive), clock.samples, wiring)
    arrays = drive, *prepared.begin(seed, first_trial + np.arange(len(drive))), out, kept
    late = _trials(prepared, arrays, engine)
    if late:
        what = f"rates of {circuit.name} run away, {late * engine.sample_ms:g} ms after onset"
        raise loops.runaway(wiring, drive.max(axis=(0, 1)), what)
    about: dict[str, Any] = {"dt_ms": clock.dt_ms, "settle_ms": engine.settle_ms}
    about |= {"laws": engine.laws, "noise": engine.noise}
    return Activity.from_blocks(
        wiring,
        kept if engine.rates else None,
        clock.time_ms,
        engine=engine.id,
        output_nats=out,
        about=about | ({"seed": seed, "first_trial": first_trial} if engine.noise else {}),
    )


def stream(
    circuit: CircuitTable,
    engine: PopulationsEngine,
    *,
    step_ms: float,
    steps: int,
    seed: int | None = None,
    trial: int = 0,
) -> Stream:
    """Begin a trial of populations; the arguments are those of ``Engine.stream``."""
    _check_trials(1, trial=trial)
    prepared = _Prepared(circuit, engine, steps, step_ms)
    p, clock, ticks = prepared.plan, prepared.clock, prepared.ticks
    streams, state, entries = prepared.begin(int(seed or 0), np.array([trial]))
    work, rates = workspace(p, kept=False), np.empty((1, clock.samples, 0), dtype=np.float32)
    settle = clock.settle_ticks

    def begin(drive: Array, out: Array) -> Onward:
        kernel.begin(p, work, state, entries[0], streams)

        def onward(first: int, last: int) -> None:
            arguments = (p, work, drive[None], out[None], rates, NOT_SAVED)
            if late := kernel.go_on(*arguments, max(first - settle, 0), last - settle, ticks):
                when = f"{late * engine.sample_ms:g} ms after onset"
                what = f"rates of {circuit.name} run away, {when}"
                raise loops.runaway(prepared.scheme.wiring, drive.max(axis=0), what)

        return onward

    return Stream(circuit, clock, begin)


def _check_trials(count: int, **first: int) -> None:
    """Raise ValueError unless the numbers of all trials are below those of settled states."""
    for name, number in first.items():
        if not is_whole(number) or not 0 <= number <= FIRST - count:
            must = "must be a whole number >= 0, with all trials below 2**63"
            raise InputError.of(name, must, number)


class _Prepared:
    """A circuit with an engine and times, in the kernel's format."""

    def __init__(
        self, circuit: CircuitTable, engine: PopulationsEngine, steps: int, step_ms: float
    ) -> None:
        wiring = wired(circuit)
        self.engine, self.clock = engine, engine.clock(wiring, steps, step_ms)
        self.scheme = Scheme(wiring, self.clock.dt_ms)
        self.plan = plan(self.scheme, self.clock, engine)
        self.ticks = window(self.plan)

    def begin(self, seed: int, trials: Index) -> tuple[npt.NDArray[np.uint64], State, Index]:
        """Return the keys of the trials' noise, initial states, and the number of that of each."""
        names = self.scheme.wiring.names if self.engine.noise else []
        streams = noises.stream_keys(seed, trials, names)
        start = settled(self.plan, self.scheme, self.clock, self.engine, trials, seed)
        return streams if names else streams[:0], *start


def _trials(prepared: _Prepared, arrays: tuple[Any, ...], engine: PopulationsEngine) -> int:
    """Run all trials; return 0, or 1 plus the first sample at which rates had diverged.

    ``arrays`` are drive, keys of noise, initial states and their numbers, OUT and rates; all but
    the states have one row per trial, and the last two are written.
    """
    drive, streams, state, entries, out, kept = arrays
    arguments = state, entries, drive, streams, engine.level_nats, out, kept, NOT_SAVED
    # Decisions take different times: each thread takes the next trial as soon as it has room.
    next_trial = np.zeros(1, np.int64)
    threads = min(int(engine.workers), -(-len(drive) // kernel.LANES))

    def work(_: int) -> int:
        space = workspace(prepared.plan, kept=bool(kept.shape[2]))
        return int(kernel.trials(prepared.plan, space, *arguments, prepared.ticks, next_trial))

    with ThreadPoolExecutor(max_workers=threads) as pool:
        ended = [sample for sample in pool.map(work, range(threads)) if sample]
    return min(ended, default=0)


def _warn_of_ringing(circuit: CircuitTable) -> None:
    """Warn near an oscillation, where cells synchronise and their noise is not independent."""
    amplified, hz = _ringing(circuit.steady)
    if amplified > RINGING:
        NoiseWarning.warn(
            f"{circuit.name} is near an oscillation at {hz:.0f} Hz, or beyond its onset: cells "
            "synchronise there, but the population engine assumes that their noise is independent"
        )
