"""Data structures of the population engine: each row of the table is a record."""

from __future__ import annotations

from typing import Any, NamedTuple

from circuits.engines.compiling import record

CLOCK = record(
    i8="step sample refresh start",
    f4="follow_slowly readout_gain readout_before readout_baseline readout_nats_per_hz runaway_hz",
)
UNIT = record(
    i8="law column delay source sources course",
    f4="gain before constant lowest per",
)
BLOCK = record(
    i8="law column drive input inputs table lags course",
    f4="bias drive_gain gain before baseline hz_per_nat floor noise lowest per state_lowest "
    "state_per",
)
EDGE = record(i8="index", f4="weight")


class Plan(NamedTuple):
    """A circuit and a clock in the kernel's format; made by ``plan.plan``.

    Parameters
    ----------
    clock : record array (1,)
        Times in ticks, and the read-out.
    units, blocks : record arrays
        One row per postsynaptic sum, and one per block: law, filter, and positions of its inputs.
    sources, inputs : record arrays
        Blocks, with weights, that reach a unit; units that reach a block.
    driven : array (driven blocks,)
        Blocks that receive a column of the drive.
    readout : array (channels,)
        Blocks of the read-out.
    laws : array (laws, points) float32
        Laws without dedicated loops: values at even steps of the input.
    tables : array (tables, states * COEFFICIENTS) float32
        Coefficients of the blocks' filters, state by state.
    factors, nats : arrays (rows, 1 + ticks) float32, or None
        Tables of ``circuits.dynamics.timed``, after one tick of rest; ``course`` is the row of a
        unit or a block. None if there are no courses, which avoids compiling unused code.
    """

    clock: Any
    units: Any
    blocks: Any
    sources: Any
    inputs: Any
    driven: Any
    readout: Any
    laws: Any
    tables: Any
    factors: Any
    nats: Any


class State(NamedTuple):
    """States of trials between two windows, one entry each; a trial begins in one of them.

    Parameters
    ----------
    ring : array (entries, blocks, ticks) float32
        Rates of the last ticks, Hz, the latest first.
    blocks, units : arrays (entries, blocks or units, rows) float32
        Filters, as in ``Work``.
    low_pass : array (entries, channels) float32
        Low-passed rates of the read-out, Hz.
    """

    ring: Any
    blocks: Any
    units: Any
    low_pass: Any


class Work(NamedTuple):
    """Working memory of a group of trials; made by ``plan.workspace``.

    A row has one number per lane; the rows of a unit or a block are contiguous.

    Parameters
    ----------
    ring : array (blocks, places * LANES)
        Rates of the last ticks, Hz.
    units, states, coefficients : arrays (units or blocks, rows * LANES)
        Filters of units; state of blocks; the coefficients of their filters.
    passed : array (units, WINDOW * LANES)
        Activity that each unit transmits in each tick of a window, nats.
    jumps : array (units, WINDOW * LANES)
        For each tick, the change of a unit's previous output due to the change of its factor.
    shifts : array (WINDOW * LANES,), or None without courses
        For each tick, the change of a block's previous input due to courses.
    totals, square : arrays (blocks padded to a multiple of LANES, LANES), (LANES * LANES,)
        Sums of rates over a sample; those of some blocks in the order of lanes.
    values, noise : arrays (WINDOW * LANES,)
        Input or activity of one block at a time, nats; the noise of its cells.
    drive : array (blocks, LANES)
        Drive by the current reading, nats.
    low_pass, out, lowest : arrays (channels, LANES) and (LANES,)
        Low-passed rates of the read-out, Hz; OUT, and its lowest value, nats.
    streams, keys : arrays (blocks, LANES) uint64, (blocks, 2 LANES) uint32
        Keys of the noise: of each trial, and, in halves, of the present ticks.
    trial, begun, samples, reading, due : arrays (LANES,)
        Each lane's trial, its first tick, its numbers of samples and readings so far, and the tick
        of the next reading.
    places, rows : arrays (LANES,)
        Column of each lane's next tick in the tables of courses; its row of coefficients.
    soonest : array (1,)
        Tick of the next reading of any lane.
    kept : bool
        Whether rates are recorded.
    """

    ring: Any
    units: Any
    states: Any
    coefficients: Any
    passed: Any
    jumps: Any
    shifts: Any
    totals: Any
    square: Any
    values: Any
    noise: Any
    drive: Any
    low_pass: Any
    out: Any
    lowest: Any
    streams: Any
    keys: Any
    trial: Any
    begun: Any
    samples: Any
    reading: Any
    due: Any
    places: Any
    rows: Any
    soonest: Any
    kept: bool
