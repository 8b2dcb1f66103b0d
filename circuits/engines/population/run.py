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

import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.arrays import Array
from circuits.checks import check_positive, is_whole
from circuits.circuit import Circuit
from circuits.dynamics import noise as noises
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock, Scheme
from circuits.engines.population import kernel
from circuits.engines.population.plan import plan, tick_ms, workspace
from circuits.engines.stream import Onward, Stream
from circuits.errors import InputError, NoiseWarning, user_level
from circuits.laws.stability import ringing

if TYPE_CHECKING:
    from circuits.engines.shipped import PopulationsEngine

RINGING = 8.0
"""Amplification of fluctuations by feedback loops above which a warning is issued."""
_ringing = lru_cache(maxsize=64)(ringing)


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    engine: PopulationsEngine,
    *,
    step_ms: float,
    seed: int | None = None,
    first_trial: int = 0,
) -> Activity:
    """Run a circuit's populations on many trials; the arguments are those of ``Engine.run``.

    A warning is issued near an oscillation, for fewer than 30 cells, and if a filter deviates from
    theory.

    Returns
    -------
    Activity
        Rates are means between samples; OUT is low-pass filtered and read at each sample's end.

    Raises
    ------
    ValueError
        If the drive, a time or a law does not fit the circuit, the seed of the noise is missing, a
        cell type lacks a method, the circuit has no resting fixed point, or rates diverge.
    """
    drive = checked_drive(circuit, drive)
    if not is_whole(first_trial) or first_trial < 0:
        raise InputError.of("first_trial", "must be a whole number >= 0", first_trial)
    check_positive(step_ms=step_ms)
    noise, times = engine.noise, (step_ms, engine.sample_ms, engine.settle_ms)
    wiring = wired(circuit)
    dt = tick_ms(wiring, *times) if engine.dt_ms is None else engine.dt_ms
    clock = Clock(drive.shape[1], step_ms, dt, *times[1:])
    p = plan(Scheme(wiring, dt), clock, engine)
    warn_beyond_range(circuit, drive)
    if noise:
        _warn_of_ringing(circuit)
    names = wiring.names if noise else []
    streams = noises.stream_keys(seed or 0, first_trial + np.arange(len(drive)), names)
    out, kept = engine.outputs(len(drive), clock.samples, wiring)
    late = _trials(p, (drive, streams if noise else streams[:0], out, kept), engine)
    if late:
        when_ms = late * engine.sample_ms
        raise ValueError(f"rates of {circuit.name} run away, {when_ms:g} ms after onset")
    about: dict[str, Any] = {"dt_ms": dt, "settle_ms": engine.settle_ms}
    about |= {"laws": engine.laws, "noise": noise}
    return Activity.from_blocks(
        wiring,
        kept if engine.rates else None,
        clock.time_ms,
        engine=engine.id,
        output_nats=out,
        about=about | ({"seed": int(seed or 0), "first_trial": first_trial} if noise else {}),
    )


def stream(
    circuit: Circuit,
    engine: PopulationsEngine,
    *,
    step_ms: float,
    steps: int,
    seed: int | None = None,
    trial: int = 0,
) -> Stream:
    """Begin a trial of populations; the arguments are those of ``Engine.stream``."""
    times = (step_ms, engine.sample_ms, engine.settle_ms)
    wiring = wired(circuit)
    dt = tick_ms(wiring, *times) if engine.dt_ms is None else engine.dt_ms
    clock = Clock(steps, step_ms, dt, *times[1:])
    p = plan(Scheme(wiring, dt), clock, engine)
    names = wiring.names if engine.noise else []
    keys = noises.stream_keys(seed or 0, np.array([trial]), names)
    work = workspace(p, kept=False)
    rates = np.empty((1, clock.samples, 0), dtype=np.float32)

    def begin(drive: Array, out: Array) -> Onward:
        kernel.begin(p, work, keys if engine.noise else keys[:0])

        def onward(first: int, last: int) -> None:
            if late := kernel.go_on(p, work, drive[None], out[None], rates, first, last):
                when_ms = late * engine.sample_ms
                raise ValueError(f"rates of {circuit.name} run away, {when_ms:g} ms after onset")

        return onward

    return Stream(circuit, clock, begin)


def _trials(p: Any, arrays: tuple[Any, ...], engine: PopulationsEngine) -> int:
    """Run all trials; return 0, or 1 plus the first sample at which rates diverged.

    Parameters
    ----------
    p : Plan
        The circuit.
    arrays : tuple
        Drive, keys of noise, OUT and rates, one row per trial; the last two are written.
    engine : PopulationsEngine
        Number of threads, and the OUT below which a trial ends.
    """
    workers = int(engine.workers)
    edges = np.linspace(0, len(arrays[0]), workers + 1).astype(int)

    def task(k: int) -> int:
        drive, streams, out, kept = (array[edges[k] : edges[k + 1]] for array in arrays)
        work = workspace(p, kept=bool(kept.shape[2]))
        return int(kernel.trials(p, work, drive, streams, engine.level_nats, out, kept))

    with ThreadPoolExecutor(max_workers=workers) as pool:
        ended = [sample for sample in pool.map(task, range(workers)) if sample]
    return min(ended, default=0)


def _warn_of_ringing(circuit: Circuit) -> None:
    """Warn near an oscillation, where cells synchronise and their noise is not independent."""
    amplified, hz = _ringing(circuit.steady)
    if amplified > RINGING:
        warnings.warn(
            f"{circuit.name} is near an oscillation at {hz:.0f} Hz, or beyond its onset: cells "
            "synchronise there, but the population engine assumes that their noise is independent",
            NoiseWarning,
            stacklevel=user_level(),
        )
