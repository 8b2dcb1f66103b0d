"""Data structures of the compiled engine: each row of the table is a record."""

from __future__ import annotations

from typing import Any, NamedTuple

from circuits.engines.compiling import record

CLOCK = record(
    i8="ticks settle step sample ring window listing",
    f8="dt_s readout_decay readout_baseline readout_gain",
)
BLOCK = record(
    i8="kind variables nats law drive input inputs own_input own_inputs start cells filled "
    "variation kept advance place course",
    f8="spike_hz baseline gain floor decay filter_gain bias drive_gain rest_x rest_hz",
    f4="membrane_decay rest slope noise_step threshold jitter refractory begin begin_span",
)
OF_TYPE = (
    "membrane_decay", "rest", "slope", "noise_step", "threshold", "jitter", "refractory",
    "begin", "begin_span", "advance", "place",
)  # fmt: skip
"""Fields of a block that its cell type sets; see ``cells.Entry``."""
UNIT = record(i8="law delay source sources course", f8="decay constant rest")
EDGE = record(i8="index", f8="weight")
OWN_INPUT = record(
    i8="target start delay own_source own_sources course", f4="decay jump weight rest"
)
OWN_SOURCE = record(i8="source connections")


class Plan(NamedTuple):
    """A circuit and a clock in the kernel's format; made by ``plan.plan``.

    Parameters
    ----------
    clock : record array (1,)
        Times in ticks, the read-out, and whether spikes are listed cell by cell.
    blocks : record array (blocks,)
        One row per block: its kind, the positions of its cells and inputs, its constants.
    units : record array (units,)
        One row per postsynaptic sum, with the positions of its sources.
    sources, inputs : record arrays
        Blocks, with weights, that reach a unit; units that reach a block.
    own_inputs : record array
        Connections cell by cell: one row per target block of a sparse projection.
    own_sources : record array
        Blocks that feed an own input, and the positions of their rows in ``connections``.
    connections : array uint64
        For every source cell, one row of bits: the target cells that it reaches.
    readout : array (channels,)
        Blocks of the read-out.
    ticks : tuple
        A tuple whose length is the number of ticks by which cells advance at once.
    constants : array (5, cells) float32, or None
        Constants of each cell if cells differ; None avoids compiling unused code. For a Lif:
        decay, rest (corrected for the mean of the noise), slope, noise step, unit of
        potential; for the others the last is a factor on the rate, and the noise step is that of a
        Phase, cv times the root of half of it.
    tick_constants : array (most constants, cells) float32
        Constants of the ticks of types without dedicated loops.
    factors, nats : arrays (rows, ticks)
        Tables of ``circuits.dynamics.timed``; ``course`` is the row of a unit or a block, 0 for
        none.
    """

    clock: Any
    blocks: Any
    units: Any
    sources: Any
    inputs: Any
    own_inputs: Any
    own_sources: Any
    connections: Any
    readout: Any
    ticks: Any
    constants: Any
    tick_constants: Any
    factors: Any
    nats: Any


class Work(NamedTuple):
    """Working memory of a trial; made by ``plan.workspace``.

    Parameters
    ----------
    v, counts, cell_x : arrays (cells,)
        State, noise of four ticks (for types without dedicated loops), and filtered input of each
        cell.
    x : array (4, most cells of a block)
        Inputs of the cells of one block in four ticks.
    ring : array (blocks, ring)
        Rates of the last ticks, Hz.
    state, total : arrays (blocks,)
        Filtered inputs, nats; sums of rates over a sample.
    common, mean_step, noise_step : arrays (window,)
        Common input of the cells of one block, nats; its effect on a cell's state, and the noise
        per bit. If cells are heterogeneous, mean_step is that input (Lif) or the mean advance, and
        noise_step its root.
    states : array (most variables, cells)
        Variables of cells without dedicated loops.
    heard, marks : arrays (4, most cells of a block), (most cells of a block,)
        Inputs of those cells, and a bit for each of four ticks in which one fired.
    fired : array (4, most cells of a block / 64) uint64
        A bit for each cell of a block that fired, in four ticks.
    unit, passed : arrays (units,), (units, window)
        Filtered activity before and after the transfer.
    own_input, scale : arrays (own_input cells,), (own_inputs,)
        Filtered activity cell by cell, divided by a scale common to all cells of an own input.
    sums : array (most cells of a block,)
        Arrivals in a tick.
    found, found_n : arrays (ring * blocks * most,), (ring * blocks,)
        Cells that fired in the last ticks, and their number.
    low_pass : array (channels,)
        Low-passed rates of the read-out, Hz.
    """

    v: Any
    counts: Any
    x: Any
    cell_x: Any
    ring: Any
    state: Any
    total: Any
    common: Any
    mean_step: Any
    noise_step: Any
    states: Any
    heard: Any
    marks: Any
    fired: Any
    unit: Any
    passed: Any
    own_input: Any
    scale: Any
    sums: Any
    found: Any
    found_n: Any
    low_pass: Any
