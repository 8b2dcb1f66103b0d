"""The Brian2 engine: networks generated from the table.

One network simulates all trials of a batch. Its parts are those of ``circuits.dynamics.ticks``: a
*delay line* of the blocks' rates, *units* that filter them, *blocks* that sum units, and *cells*,
one group per population. If all cells of a block project to all of another with one weight, a unit
serves the whole block (a shared input) in place of N^2 synapses; if connections are sparse, or
``explicit``, every cell has a separate unit (an own input) that receives spikes through Brian2's
synapses and delays.

``text`` has the code that runs every tick, ``layout`` the array layout and initial values,
``network`` builds the network, and ``noise`` draws the noise.

The spikes are those of the ensemble engine: cells are single precision in both, and sums over
populations are taken in the same order. Only the exponentials of two libraries may round
differently; the resulting rates are rounded to single precision, nearly always to the same number.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy.typing as npt

from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock, Scheme
from circuits.dynamics.timed import timed
from circuits.engines.brian2.layout import Layout
from circuits.engines.brian2.network import Network
from circuits.engines.brian2.noise import load_brian

if TYPE_CHECKING:
    from circuits.engines.shipped import Brian2


def run(
    circuit: CircuitTable,
    drive: npt.ArrayLike,
    engine: Brian2,
    *,
    step_ms: float,
    seed: int,
    first_trial: int = 0,
) -> Activity:
    """Run a circuit in Brian2; the arguments are those of ``Engine.run``.

    Raises
    ------
    ValueError
        If the drive, a time or a name does not fit the circuit.
    """
    drive = checked_drive(circuit, drive)
    noise.stream_key(seed, first_trial, "")  # says at once if they are out of range
    trials, steps, _ = drive.shape
    clock = Clock(steps, step_ms, engine.dt_ms, engine.sample_ms, engine.settle_ms)
    warn_beyond_range(circuit, drive)
    scheme = Scheme(wired(circuit), engine.dt_ms)
    courses = timed(scheme.wiring, clock)
    layout = Layout(scheme, trials, engine.explicit, None if courses.still else courses)
    with _in_numpy():
        network = Network(layout, clock, engine.spikes)
        network.reading.values[:] = network.readings(drive)
        network.set(layout.start(seed, first_trial))
        network.run()
        return network.activity(seed, first_trial)


@contextmanager
def _in_numpy() -> Iterator[None]:
    """Have Brian2 run its code in NumPy, whatever the user's preferences are."""
    prefs = load_brian().prefs
    before = prefs.codegen.target
    prefs.codegen.target = "numpy"
    try:
        yield
    finally:
        prefs.codegen.target = before
