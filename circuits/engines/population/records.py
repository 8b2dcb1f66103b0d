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
        One row a postsynaptic sum, one a block: law, filter, and where its inputs lie.
    sources, inputs : record arrays
        Which block reaches a unit with which weight; which unit reaches a block.
    driven : array (driven blocks,)
        Blocks that receive a column of the drive.
    readout : array (channels,)
        Blocks of the read-out.
    laws : array (laws, points) float32
        Laws that are looked up: values at even steps of the input.
    tables : array (tables, states * COEFFICIENTS) float32
        Coefficients of the blocks' filters, state by state.
    factors, nats : arrays (rows, 1 + ticks) float32, or None
        Tables of ``circuits.dynamics.timed``, behind a tick of rest: ``course`` is the row that a
        unit or a block has. None if there are no courses, which avoids compiling unused code.
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

    A row holds one number for each lane; the rows of a unit or a block lie one after the other.

    Parameters
    ----------
    ring : array (blocks, places * LANES)
        Rates of the last ticks, Hz.
    units, states, coefficients : arrays (units or blocks, rows * LANES)
        Filters of units; state of blocks; the coefficients of their filters.
    passed : array (units, WINDOW * LANES)
        Activity that each unit passes on, nats.
    jumps : array (units, (WINDOW + 1) * LANES)
        What it would have passed on more in the tick before at the factor of each tick, and behind
        that its activity in the last tick before the factor.
    totals : array (blocks, LANES)
        Sums of rates over a sample.
    values : array (rows * LANES,)
        What one block works on.
    drive : array (blocks, LANES)
        Drive that is held, nats.
    low_pass : array (channels, LANES)
        The read-out, Hz.
    streams, keys : arrays (blocks, LANES), (LANES,)
        Keys of the noise.
    indices, trial, begun, samples : arrays (LANES,)
        Places in a table; each lane's trial, its first tick, and samples so far.
    places : array (LANES,)
        Place of each lane's next tick in the tables of courses.
    kept : bool
        Whether rates are kept.
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
