"""Conversion of the wiring to the flat records of the compiled engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.cells import Cell, renewal
from circuits.declaration.table import CircuitTable
from circuits.dynamics.ticks import Clock, Scheme, Timed, cell_factors, rows, spike_hz, timed
from circuits.dynamics.wiring import Wiring, fan_in
from circuits.engines.compiling import edges
from circuits.engines.compiling import records as filled
from circuits.engines.spikes import kernel, lanes, records, trains
from circuits.engines.spikes.cells import GENERAL, CompiledCell, entry
from circuits.errors import InputError


def plan(wiring: Wiring, clock: Clock, kept: npt.NDArray[np.bool_]) -> records.Plan:
    """Convert a circuit to the records of the compiled engine; spikes of ``kept`` are recorded."""
    places = _Places(Scheme(wiring, clock.dt_ms), timed(wiring, clock))
    own_inputs, own_sources, connections, needs = _own_inputs(places)
    of_block, nats = _added(places)
    window, ring = _window(places.scheme)
    # Single ticks are rare, so their spikes are listed, which avoids compiling more loops.
    listing = bool((kept | needs).any() or window == 1)
    source_from, sources = edges(records.EDGE, wiring.deliver)
    input_from, inputs = edges(records.EDGE, places.weight)
    return records.Plan(
        # times in ticks, the read-out, and whether spikes are listed cell by cell
        clock=_clock(places, clock, window, ring, listing),
        # a row per block: its kind, the positions of its cells and inputs, its constants
        blocks=_blocks(places, kept, input_from, own_inputs, of_block),
        units=_units(places, source_from),  # a row per postsynaptic sum
        sources=sources,  # blocks, with weights, that reach a unit
        inputs=inputs,  # units that reach a block
        own_inputs=own_inputs,  # a row per target block of a sparse projection
        own_sources=own_sources,  # blocks that feed one, and their rows in ``connections``
        connections=connections,  # uint64: a row of bits per source cell, the cells it reaches
        readout=wiring.blocks_of(wiring.circuit.readout),
        ticks=lanes.SINGLE if window == 1 else lanes.FOUR,  # by which cells advance at once
        constants=_constants(places),
        tick_constants=_tick_constants(places),
        factors=places.courses.factors,  # (rows, ticks); ``course`` is the row of a unit; 0: none
        nats=nats,  # the same for blocks
        slow=_slow(places),  # (cells,) factors on the intervals of renewal cells
        # (tables, bins + 1) of their intervals, and of the waits for their first spikes
        intervals=_tables(places, renewal.intervals),
        first_spikes=_tables(places, renewal.first_spikes),
    )


@dataclass(frozen=True)
class _Places:
    """Positions and kinds of blocks and cells."""

    scheme: Scheme
    courses: Timed

    @property
    def wiring(self) -> Wiring:
        return self.scheme.wiring

    @property
    def circuit(self) -> CircuitTable:
        return self.wiring.circuit

    @cached_property
    def entries(self) -> list[CompiledCell]:
        return [entry(row.cell) for row in self.wiring.rows]

    @cached_property
    def sparse(self) -> npt.NDArray[np.bool_]:
        """Units that every target cell sums separately."""
        return np.array([self.circuit.is_sparse(p) for p in self.wiring.projections], dtype=bool)

    @cached_property
    def targets(self) -> list[npt.NDArray[np.intp]]:
        """Blocks that each unit reaches."""
        return [np.flatnonzero(self.wiring.weight[:, q]) for q in range(self.wiring.units)]

    @cached_property
    def weight(self) -> Array:
        """Weights of input common to all cells of a block."""
        return np.where(self.sparse[None, :], 0.0, self.wiring.weight)

    @cached_property
    def variation(self) -> npt.NDArray[np.int64]:
        """How the cells of each block differ."""
        heterogeneity = [row.spiking and row.heterogeneity for row in self.wiring.rows]
        variation = np.where(heterogeneity, kernel.OWN_CONSTANTS, kernel.IDENTICAL)
        for q in np.flatnonzero(self.sparse):
            variation[self.targets[q]] = kernel.OWN_INPUTS
        return variation

    @cached_property
    def cells(self) -> npt.NDArray[np.int64]:
        return np.array([row.neurons if row.spiking else 0 for row in self.wiring.rows])

    @cached_property
    def filled(self) -> npt.NDArray[np.int64]:
        """Cells of each block, including padding."""
        return -(-self.cells // lanes.LANES) * lanes.LANES

    @cached_property
    def buckets(self) -> tuple[Array, Array]:
        """Buckets of each block, a power of 2 or 0, and how many are passed per interval."""
        waiting = np.array([row.cell.renewal() for row in self.wiring.rows]) * self.cells
        per_spike = np.maximum(waiting / trains.CELLS_PER_BUCKET, 1.0)
        count = 2 ** np.ceil(np.log2(trains.TURN * per_spike)).astype(np.int64)
        return np.where(waiting, count, 0), per_spike

    @cached_property
    def start(self) -> npt.NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.filled)[:-1]]).astype(np.int64)


def _window(scheme: Scheme) -> tuple[int, int]:
    """Return for how many ticks input is known in advance, and for how many rates are stored."""
    delays = scheme.unit_delay
    known = min(int(delays.min(initial=kernel.WINDOW)), kernel.WINDOW)
    window = known // kernel.WORD * kernel.WORD or 1
    return window, 1 << (int(delays.max(initial=1)) + window + kernel.WORD).bit_length()


def _clock(places: _Places, clock: Clock, window: int, ring: int, listing: bool) -> Any:
    readout = places.circuit.population(places.circuit.readout)
    return filled(
        records.CLOCK,
        1,
        ticks=clock.ticks,
        settle=clock.settle_ticks,
        step=clock.step_ticks,
        sample=clock.sample_ticks,
        ring=ring,
        window=window,
        listing=listing,
        dt_s=clock.dt_ms / 1000,
        readout_decay=places.scheme.readout_decay,
        readout_baseline=readout.baseline_hz,
        readout_gain=readout.gain_hz_per_nat,
    )


def _blocks(places: _Places, kept: Any, input_from: Any, own_inputs: Any, of_block: Any) -> Any:
    """Return one record per block; fields that its cell type leaves out are 0."""
    wiring, scheme = places.wiring, places.scheme
    _, rest_x, rest_hz = scheme.start
    own_from = np.searchsorted(own_inputs["target"], np.arange(wiring.blocks + 1))
    pairs = zip(places.entries, wiring.rows, strict=True)
    constants = [made.columns(row.cell, scheme.dt_ms) for made, row in pairs]
    of_type = {name: [columns.get(name, 0) for columns in constants] for name in records.OF_TYPE}
    return filled(
        records.BLOCK,
        wiring.blocks,
        kind=[made.kind for made in places.entries],
        variables=[len(row.cell.state) for row in wiring.rows],
        table=[scheme.renewals.index(r.cell) if r.cell.renewal() else 0 for r in wiring.rows],
        bucket=np.cumsum(places.buckets[0]) - places.buckets[0],
        buckets=places.buckets[0],
        buckets_per_spike=places.buckets[1],
        nats=[row.cell.hears == "nats" for row in wiring.rows],
        law=[_law(row.transfer) for row in wiring.rows],
        drive=wiring.columns,
        input=input_from[:-1],
        inputs=input_from[1:],
        own_input=own_from[:-1],
        own_inputs=own_from[1:],
        start=places.start,
        cells=places.cells,
        spike_hz=spike_hz(places.cells, scheme.dt_ms),
        filled=places.filled,
        variation=places.variation,
        kept=kept,
        course=of_block,
        baseline=wiring.baseline_hz,
        gain=wiring.gain_hz_per_nat,
        floor=wiring.floor_hz,
        decay=scheme.block_decay,
        filter_gain=1 - scheme.block_decay,
        # The constant output of a sparse unit is the same for all cells.
        bias=wiring.bias + (wiring.weight - places.weight) @ wiring.constant,
        drive_gain=wiring.drive_gains,
        rest_x=rest_x,
        rest_hz=rest_hz,
        **of_type,
    )


def _units(places: _Places, source_from: Any) -> Any:
    return filled(
        records.UNIT,
        places.wiring.units,
        law=[_law(p.transfer) for p in places.wiring.projections],
        delay=places.scheme.unit_delay,
        source=source_from[:-1],
        sources=source_from[1:],
        decay=places.scheme.unit_decay,
        constant=places.wiring.constant,
        rest=places.scheme.start[0],
        course=places.courses.of_unit,
    )


def _added(places: _Places) -> tuple[npt.NDArray[np.intp], Array]:
    """Return each block's row, and the nats added by courses, also through sparse units."""
    wiring, courses = places.wiring, places.courses
    sparse = places.sparse & (courses.of_unit > 0)
    if not sparse.any():
        return courses.of_block, courses.nats
    always = (wiring.weight * wiring.constant)[:, sparse]
    beyond = courses.factors[courses.of_unit[sparse]] - 1
    pairs = zip(courses.of_block, always, strict=True)
    added = [courses.nats[row] + each @ beyond for row, each in pairs]
    return rows(added, courses.nats[0])


def _law(name: str) -> int:
    if name not in kernel.TRANSFERS:
        message = f"the spikes engine knows the transfers {', '.join(kernel.TRANSFERS)}"
        raise InputError(f"{message}, not {name!r}: use brian2 or plain", "transfer")
    return kernel.TRANSFERS[name]


def _constants(places: _Places) -> npt.NDArray[np.float32] | None:
    """Return the constants (5, cells) of Lif cells that differ; None, to compile less, if none do.

    These are decay, rest (corrected for the mean of the noise), slope, noise step and unit of
    potential.
    """
    differing = {b: places.entries[b].varied for b in np.flatnonzero(places.variation)}
    varied = {b: function for b, function in differing.items() if function}
    if not varied:
        return None
    constants = np.zeros((5, int(places.filled.sum())), np.float32)
    for b, function in varied.items():
        here = slice(places.start[b], places.start[b] + places.cells[b])
        row, channel = places.wiring.rows[b], int(places.wiring.channel[b])
        factors = cell_factors(places.circuit, row.name, channel)
        constants[:, here] = function(row.cell, factors, places.scheme.dt_ms)
    return constants


def _slow(places: _Places) -> npt.NDArray[np.float32]:
    """Return the factor on the intervals of each renewal cell, 1 for others."""
    slow = np.ones(int(places.filled.sum()), np.float32)
    for b, row in enumerate(places.wiring.rows):
        if row.cell.renewal():
            here = slice(places.start[b], places.start[b] + places.cells[b])
            slow[here] = places.scheme.constants(b)["slow"]
    return slow


def _tables(places: _Places, table: Callable[[Cell], Array]) -> npt.NDArray[np.float32]:
    """Return a table of each distinct renewal cell; without any, one of zeros."""
    tables = [table(cell) for cell in places.scheme.renewals]
    return np.array(tables or [np.zeros(renewal.BINS + 1)], dtype=np.float32)


def _tick_constants(places: _Places) -> npt.NDArray[np.float32]:
    """Return the constants (most constants, cells) of types without dedicated loops."""
    general = [b for b, made in enumerate(places.entries) if made is GENERAL]
    by_block = {b: list(places.scheme.constants(b).values()) for b in general}
    most = max(map(len, by_block.values()), default=1)
    constants = np.zeros((most, int(places.filled.sum())), np.float32)
    for b, values in by_block.items():
        for k, value in enumerate(values):
            constants[k, places.start[b] : places.start[b] + places.cells[b]] = value
    return constants


def _own_inputs(places: _Places) -> tuple[Any, Any, Any, npt.NDArray[np.bool_]]:
    """Return inputs that differ between cells, their sources, connections, and blocks to list."""
    wiring, scheme, filled = places.wiring, places.scheme, places.filled
    own_inputs: list[tuple[Any, ...]] = []
    own_sources: list[tuple[Any, ...]] = []
    connections = [np.zeros(0, np.uint64)]
    size = cells = 0
    needs = np.zeros(wiring.blocks, dtype=bool)
    for q in np.flatnonzero(places.sparse):
        p = wiring.projections[q]
        sources = np.flatnonzero(wiring.deliver[q])
        gains = wiring.deliver[q, sources]
        if len(sources) and not np.allclose(gains, gains[0]):
            message = f"{p.name}: sparse connections need one weight for all channels"
            raise InputError(message, "probability")
        needs[sources] = True
        for b in places.targets[q]:
            first, degree = len(own_sources), 1
            for source in sources:
                who = fan_in(wiring.circuit, p, int(wiring.channel[b]), int(wiring.channel[source]))
                degree = who.shape[1]
                neurons = wiring.circuit.population(p.source).neurons
                connections.append(_bits(who, neurons, filled[b]))
                own_sources.append((source, size))
                size += len(connections[-1])
            decay = scheme.unit_decay[q]
            jump = (1 - decay) * gains.sum() / max(len(gains), 1) / (degree * scheme.dt_ms / 1000)
            course = places.courses.of_unit[q]
            at = (b, cells, scheme.unit_delay[q], first, len(own_sources), course)
            own_inputs.append((*at, decay, jump, wiring.weight[b, q], scheme.start[0][q]))
            cells += int(filled[b])
    own_inputs.sort(key=lambda own_input: own_input[0])
    return (
        np.array(own_inputs, dtype=records.OWN_INPUT),
        np.array(own_sources, dtype=records.OWN_SOURCE),
        np.concatenate(connections),
        needs,
    )


def _bits(who: npt.NDArray[np.int64], sources: int, targets: int) -> npt.NDArray[np.uint64]:
    """Return which targets each source reaches as bits, in the order of ``lanes.add_row``.

    ``who`` (target cells, in-degree) are the source cells that reach each target cell; ``targets``
    includes padding.
    """
    table = np.zeros((sources, targets), np.uint8)
    table[who.ravel(), np.repeat(np.arange(len(who)), who.shape[1])] = 1
    groups = table.reshape(sources, -1, 8, 8)
    return np.packbits(groups, axis=2, bitorder="little").ravel().view(np.uint64)


def workspace(p: records.Plan) -> records.Work:
    """Return the working memory of one trial."""
    blocks, units, clock = len(p.blocks), len(p.units), p.clock[0]
    ring, window = int(clock["ring"]), max(int(clock["window"]), kernel.WORD)
    cells = int(p.blocks["filled"].sum())
    connected = int(p.blocks["filled"][p.own_inputs["target"]].sum())
    widest = int(p.blocks["filled"].max())
    most = widest if clock["listing"] else 1
    return records.Work(
        v=np.zeros(cells, np.float32),  # potentials of Lif cells
        counts=np.zeros(cells, np.uint32),  # noise of four ticks
        x=np.zeros((kernel.WORD, widest), np.float32),  # inputs of one block's cells in four ticks
        cell_x=np.zeros(cells, np.float32),  # filtered input
        ring=np.zeros((blocks, ring)),  # rates of the last ticks, Hz
        state=np.zeros(blocks),  # filtered inputs, nats
        total=np.zeros(blocks),  # sums of rates over a sample
        common=np.zeros(window),  # common input of the cells of one block, nats
        # its effect on the potential of Lif cells, or that input if they differ
        mean_step=np.zeros(window, np.float32),
        # of cells without dedicated loops; their inputs follow
        states=np.zeros((int(p.blocks["variables"].max(initial=1)), cells), np.float32),
        heard=np.zeros((kernel.WORD, widest)),
        marks=np.zeros(widest, np.uint8),  # a bit for each of four ticks in which one fired
        unit=np.zeros(units),  # filtered activity before the transfer
        passed=np.zeros((units, window)),  # and after it
        own_input=np.zeros(connected, np.float32),  # filtered activity, divided by the scale
        scale=np.zeros(len(p.own_inputs)),  # common to all cells of an own input
        sums=np.zeros(widest, np.uint8),  # arrivals in a tick
        spiked=np.zeros(ring * blocks * most, np.int32),  # cells that fired in the last ticks
        spiked_n=np.zeros(ring * blocks, np.int32),  # their number
        low_pass=np.zeros(len(p.readout)),  # low-passed rates of the read-out, Hz
        trains=np.zeros(cells, records.TRAIN),  # state of renewal cells
        expected=np.zeros(blocks),  # spikes expected so far of each of them, in every block
        own_expected=np.zeros(cells if connected else 0),  # of each cell if inputs differ
        buckets=np.zeros(int(p.blocks["buckets"].sum()), np.int32),  # first cell of each
        fired=np.zeros(kernel.WORD, np.int64),  # cells of one block that fired in each tick
        after=np.zeros(kernel.WORD),  # expected spikes of one block after each tick
    )
