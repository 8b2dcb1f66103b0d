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
    """A circuit and a clock in the kernel's format; made by ``plan.plan``."""

    clock: Any  # (1,) times in ticks, and the read-out
    units: Any  # a row per postsynaptic sum: law, filter, and positions of its inputs
    blocks: Any  # a row per block: the same
    sources: Any  # blocks, with weights, that reach a unit
    inputs: Any  # units that reach a block
    driven: Any  # blocks that receive a column of the drive
    readout: Any  # (channels,) blocks of the read-out
    laws: Any  # (laws, points) float32, without dedicated loops: values at even steps
    tables: Any  # (tables, states * COEFFICIENTS) float32, state by state
    # (rows, 1 + ticks) float32, of ``circuits.dynamics.ticks``, after one tick of rest; ``course``
    # is the row of a unit. None without courses, to avoid compiling unused code.
    factors: Any
    nats: Any  # the same for blocks


class State(NamedTuple):
    """States of trials between two windows, float32; a trial begins in one of the entries."""

    ring: Any  # (entries, blocks, ticks) rates of the last ticks, Hz, the latest first
    blocks: Any  # (entries, blocks, rows) filters, as in ``Work``
    units: Any  # (entries, units, rows) the same
    low_pass: Any  # (entries, channels) low-passed rates of the read-out, Hz


class Work(NamedTuple):
    """Working memory of a group of trials; made by ``plan.workspace``.

    A row has one number per lane; the rows of a unit or a block are contiguous.
    """

    ring: Any  # (blocks, places * LANES) rates of the last ticks, Hz
    units: Any  # (units, rows * LANES) filters
    states: Any  # (blocks, rows * LANES)
    coefficients: Any  # (blocks, rows * LANES) of their filters
    passed: Any  # (units, WINDOW * LANES) activity transmitted in each tick of a window, nats
    # (units, WINDOW * LANES) change of a unit's previous output due to that of its factor
    jumps: Any
    shifts: Any  # (WINDOW * LANES,) change of a block's previous input due to courses; None without
    totals: Any  # (blocks padded to a multiple of LANES, LANES) sums of rates over a sample
    square: Any  # (LANES * LANES,) those of some blocks in the order of lanes
    values: Any  # (WINDOW * LANES,) input or activity of one block at a time, nats
    noise: Any  # (WINDOW * LANES,) the noise of its cells
    drive: Any  # (blocks, LANES) by the current reading, nats
    low_pass: Any  # (channels, LANES) low-passed rates of the read-out, Hz
    out: Any  # (channels, LANES), nats
    lowest: Any  # (LANES,) lowest OUT, nats
    streams: Any  # (blocks, LANES) uint64: keys of the noise of each trial
    keys: Any  # (blocks, 2 LANES) uint32: keys of the present ticks, in halves
    trial: Any  # (LANES,) the trial of each lane
    begun: Any  # (LANES,) first tick of the trial
    samples: Any  # (LANES,) number of samples so far
    reading: Any  # (LANES,) number of readings so far
    due: Any  # (LANES,) tick of the next reading
    places: Any  # (LANES,) column of the next tick in the tables of courses
    rows: Any  # (LANES,) row of coefficients
    soonest: Any  # (1,) tick of the next reading of any lane
    kept: bool  # whether rates are recorded
