"""The Brian2 engine: networks generated from the table.

One network simulates all trials of a batch. Its parts are those of ``circuits.dynamics.ticks``: a
*delay line* of the blocks' rates, *units* that filter them, *blocks* that sum units, and *cells*,
one group per population. If all cells of a block project to all of another with one weight, a unit
serves the whole block (a shared input) in place of N^2 synapses; if connections are sparse, or
``explicit``, every cell has a separate unit (an own input) that receives spikes through Brian2's
synapses and delays.

Cells fire as in the spikes engine: both use the same precision and sum over populations in the same
order. Only the exponentials of two libraries may round differently, in the last bit of double
precision, which practically never moves a spike.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

import numpy.typing as npt

from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.arrays import Array
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Scheme, timed
from circuits.engines.brian2.layout import Layout
from circuits.engines.brian2.network import BrianNetwork, assembled
from circuits.engines.brian2.noise import load_brian
from circuits.engines.shipped import Brian2


def run(
    circuit: CircuitTable, drive: Array, engine: Brian2, step_ms: float, seed: int, first: int
) -> Activity:
    """Run a circuit in Brian2; the arguments are those of ``Engine.run``."""
    network = network_of(circuit, drive, step_ms, seed, first, engine)
    with in_numpy() as brian:
        objects = assembled(brian, network.parts)
        # One tick more than the clock's, because blocks count their spikes a tick later.
        objects.run((network.clock.ticks + 1) * network.clock.dt_ms * brian.ms, namespace={})
        return network.activity(objects, seed, first)


def network_of(
    circuit: CircuitTable,
    drive: npt.ArrayLike,
    step_ms: float,
    seed: int,
    first_trial: int,
    engine: Brian2 | None,
) -> BrianNetwork:
    """Return the network of a run; without an engine, the spikes of all cells are recorded."""
    if engine is None:
        cells = circuit.spiking()
        engine = Brian2(spikes=cells)
    drive = checked_drive(circuit, drive)
    noise.stream_key(seed, first_trial, "")  # says at once if they are out of range
    trials, steps, _ = drive.shape
    wiring = wired(circuit)
    clock = engine.clock(wiring, steps, step_ms)
    warn_beyond_range(circuit, drive)
    scheme = Scheme(wiring, clock.dt_ms)
    courses = timed(scheme.wiring, clock)
    layout = Layout(scheme, trials, engine.explicit, None if courses.still else courses)
    return BrianNetwork(layout, clock, drive, layout.start(seed, first_trial), engine.spikes)


@contextmanager
def in_numpy() -> Iterator[ModuleType]:
    """Yield Brian2, which runs its code in NumPy meanwhile, whatever the user's preferences are."""
    brian = load_brian()
    before = brian.prefs.codegen.target
    brian.prefs.codegen.target = "numpy"
    try:
        yield brian
    finally:
        brian.prefs.codegen.target = before
