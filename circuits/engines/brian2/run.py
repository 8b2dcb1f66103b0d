"""The Brian2 engine: the readable reference of the spiking ones, generated from the table.

One network holds all trials of a batch. Its parts are those of ``circuits.ticks``: a *delay line*
of the blocks' rates, *units* that filter them, *blocks* that sum units, and *cells*, a group for
each population. Where all cells of a block reach all of another with one weight, a unit serves the
whole block (a relay) in place of N^2 synapses; where connections are sparse, or ``explicit``, every
cell has a unit of its own (a socket) that hears spikes through Brian2's synapses and delays.

``brian_text`` holds what runs every tick, as text: a cell type of your own is one more entry of its
``CELL_TEXT``, a nucleus or a pathway is a row of the table. ``brian_layout`` says where everything
lies and what it starts from, ``brian_network`` builds it, ``brian_noise`` is the noise,
``brian_standalone`` the program in C++.

Its spikes are those of the ensemble engine: cells are single precision in both, and sums over
populations are taken in one order. What may differ by a rounding is the exponential of two
libraries; a rate that it changes is rounded to single precision, nearly always to the same number.

``run`` builds and runs once; ``Standalone`` builds one C++ program and runs it many times.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy.typing as npt

from circuits import noise
from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.engines.brian2.layout import Layout
from circuits.engines.brian2.network import Network
from circuits.engines.brian2.noise import load_brian
from circuits.engines.brian2.standalone import Standalone, exact_sums, need_compiler
from circuits.fixed_point import wired
from circuits.spec import Circuit
from circuits.ticks import Clock, Scheme

__all__ = ["Standalone", "run"]

TARGETS = ("auto", "standalone", "cython", "numpy")
COMPILE_S = 15.0
NUMPY_TICK_S = 1e-3
NUMPY_CELL_S = 2e-8
"""Measured: a build in C++, and in NumPy a tick of a network and of each cell in it."""


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
    target: str = "auto",
    explicit: bool = False,
) -> Activity:
    """Run a circuit in Brian2.

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
    target : str
        "numpy" starts at once; "standalone" builds a C++ program first, a quarter of a minute;
        "cython" compiles for minutes, once for each kind of circuit, and keeps that; "auto" takes
        what should be done first, NumPy or the program.
    explicit : bool
        Whether connections of probability 1 become synapses too, N^2 of them: to check the relays.

    Raises
    ------
    ValueError
        If the drive, a time or a name does not fit the circuit.
    OSError
        If a target needs a compiler and there is none.
    """
    drive = checked_drive(circuit, drive)
    noise.stream_key(seed, first_trial, "")  # says at once if they are out of range
    trials, steps, _ = drive.shape
    clock = Clock(steps, step_ms, dt_ms, sample_ms, settle_ms)
    if _target(target, circuit, trials, clock) == "standalone":
        with Standalone(
            circuit,
            trials,
            steps=steps,
            step_ms=step_ms,
            dt_ms=dt_ms,
            sample_ms=sample_ms,
            settle_ms=settle_ms,
            spikes=spikes,
            explicit=explicit,
        ) as program:
            return program.run(drive, seed=seed, first_trial=first_trial)
    warn_beyond_range(circuit, drive)
    layout = Layout(Scheme(wired(circuit), dt_ms), trials, explicit)
    with _code_in("cython" if target == "cython" else "numpy"):
        network = Network(layout, clock, spikes)
        network.reading.values[:] = network.readings(drive)
        network.set(layout.start(seed, first_trial))
        network.run()
        return network.activity(seed, first_trial)


def _target(target: str, circuit: Circuit, trials: int, clock: Clock) -> str:
    """Return the target to take, once it is known that it can be had."""
    if target not in TARGETS:
        raise ValueError(f"target must be one of {', '.join(TARGETS)}, got {target!r}")
    if target in ("standalone", "cython"):
        need_compiler(target)
    if target != "auto":
        return target
    names = [row.name for row in circuit.populations if row.spiking]
    cells = sum(circuit.population(n).neurons * circuit.channels_of(n) for n in names)
    if clock.ticks * (NUMPY_TICK_S + NUMPY_CELL_S * cells * trials) < COMPILE_S:
        return "numpy"
    try:
        need_compiler("standalone")
    except OSError as error:
        warnings.warn(f"{error}; NumPy it is, which is slow", stacklevel=3)
        return "numpy"
    return "standalone"


@contextmanager
def _code_in(target: str) -> Iterator[None]:
    prefs = load_brian().prefs
    before = prefs.codegen.target
    prefs.codegen.target = target
    try:
        with exact_sums():
            yield
    finally:
        prefs.codegen.target = before
