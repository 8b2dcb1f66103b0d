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
    """A circuit and a clock in the kernel's format; made by ``plan.plan``."""

    clock: Any  # (1,) times in ticks, the read-out, and whether spikes are listed cell by cell
    blocks: Any  # a row per block: its kind, the positions of its cells and inputs, its constants
    units: Any  # a row per postsynaptic sum, with the positions of its sources
    sources: Any  # blocks, with weights, that reach a unit
    inputs: Any  # units that reach a block
    own_inputs: Any  # connections cell by cell: a row per target block of a sparse projection
    # blocks that feed an own input, and the positions of their rows in ``connections``
    own_sources: Any
    connections: Any  # uint64: for every source cell, a row of bits: the target cells it reaches
    readout: Any  # (channels,) blocks of the read-out
    ticks: Any  # a tuple whose length is the number of ticks by which cells advance at once
    # (5, cells) float32, or None if cells are identical, to avoid compiling unused code. For a Lif:
    # decay, rest (corrected for the mean of the noise), slope, noise step, unit of potential; for
    # the others the last is a factor on the rate, and the noise step is that of a Phase, cv times
    # the root of half of it.
    constants: Any
    tick_constants: Any  # (most constants, cells) float32, for types without dedicated loops
    # (rows, ticks), of ``circuits.dynamics.ticks``; ``course`` is the row of a unit; 0: none
    factors: Any
    nats: Any  # (rows, ticks), the same for blocks


class Work(NamedTuple):
    """Working memory of a trial; made by ``plan.workspace``."""

    v: Any  # (cells,) state
    counts: Any  # (cells,) noise of four ticks, for types without dedicated loops
    x: Any  # (4, most cells of a block) inputs of the cells of one block in four ticks
    cell_x: Any  # (cells,) filtered input
    ring: Any  # (blocks, ring) rates of the last ticks, Hz
    state: Any  # (blocks,) filtered inputs, nats
    total: Any  # (blocks,) sums of rates over a sample
    common: Any  # (window,) common input of the cells of one block, nats
    # (window,) its effect on a cell's state; if cells are heterogeneous, that input (Lif) or the
    # mean advance
    mean_step: Any
    # (window,) the noise per bit; if cells are heterogeneous, the root of mean_step
    noise_step: Any
    states: Any  # (most variables, cells) of cells without dedicated loops
    heard: Any  # (4, most cells of a block) inputs of those cells
    marks: Any  # (most cells of a block,) a bit for each of four ticks in which one fired
    fired: Any  # (4, most cells of a block / 64) uint64: a bit for each cell that fired
    unit: Any  # (units,) filtered activity before the transfer
    passed: Any  # (units, window) and after it
    own_input: Any  # (own_input cells,) filtered activity, divided by the scale of its input
    scale: Any  # (own_inputs,) common to all cells of an own input
    sums: Any  # (most cells of a block,) arrivals in a tick
    spiked: Any  # (ring * blocks * most,) cells that fired in the last ticks
    spiked_n: Any  # (ring * blocks,) their number
    low_pass: Any  # (channels,) low-passed rates of the read-out, Hz
