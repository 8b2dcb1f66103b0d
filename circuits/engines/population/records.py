"""Data structures of the population engine: each row of the table is a record."""

from __future__ import annotations

from typing import Any, NamedTuple

from circuits.engines.compiling import record

CLOCK = record(
    i8="window settle step sample refresh start",
    f4="follow_slowly readout_gain readout_before readout_baseline readout_hz_per_nat runaway_hz",
)
UNIT = record(
    i8="law column delay source sources course",
    f4="gain before constant rest passed lowest per",
)
BLOCK = record(
    i8="law column drive input inputs table lags course",
    f4="bias drive_gain gain before baseline hz_per_nat floor noise lowest per state_lowest "
    "state_per rest_x rest_hz",
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
        Activity that each unit transmits, nats.
    jumps : array (units, (WINDOW + 1) * LANES)
        For each tick, the change of a unit's previous output due to the change of its factor; in
        the last row, its activity in the last tick before multiplication by the factor.
    totals : array (blocks, LANES)
        Sums of rates over a sample.
    values : array (rows * LANES,)
        Working values of one block at a time.
    drive : array (blocks, LANES)
        Drive by the current reading, nats.
    low_pass : array (channels, LANES)
        Low-passed rates of the read-out, Hz.
    streams, keys : arrays (blocks, LANES), (LANES,)
        Keys of the noise.
    indices, trial, begun, samples : arrays (LANES,)
        Positions in a table; each lane's trial, its first tick, and its number of samples so far.
    places : array (LANES,)
        Column of each lane's next tick in the tables of courses.
    kept : bool
        Whether rates are recorded.
    """

    ring: Any
    units: Any
    states: Any
    coefficients: Any
    passed: Any
    jumps: Any
    totals: Any
    values: Any
    drive: Any
    low_pass: Any
    streams: Any
    keys: Any
    indices: Any
    trial: Any
    begun: Any
    samples: Any
    places: Any
    kept: bool
