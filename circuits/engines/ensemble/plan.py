"""From the wiring to what the compiled engine reads: flat records, units of one threshold."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.cells import Escape, Lif, Phase
from circuits.engines.ensemble import kernel, lanes, records
from circuits.spec import Circuit
from circuits.ticks import (
    NO_SPREAD,
    Clock,
    Scheme,
    cell_factors,
    jitter,
    lif_tick,
    refractory_ticks,
    spike_hz,
)
from circuits.wiring import Array, Wiring, fan_in

LIF = ("keep", "rest", "slope", "kick", "threshold")
"""Constants of a Lif's tick that all cells of a block share, if they are alike."""


def plan(wiring: Wiring, clock: Clock, kept: npt.NDArray[np.bool_]) -> records.Plan:
    """Lay a circuit out for the compiled engine.

    Parameters
    ----------
    wiring : Wiring
        The circuit as arrays.
    clock : Clock
        Times of the run.
    kept : array (blocks,) bool
        Blocks whose spikes are written down.

    Raises
    ------
    ValueError
        If the circuit uses a cell type or a transfer that the compiled engine does not know.
    """
    circuit, dt = wiring.circuit, clock.dt_ms
    scheme = Scheme(wiring, dt)
    rows = [wiring.row(b) for b in range(wiring.blocks)]
    units = [wiring.projection(q) for q in range(wiring.units)]
    for law in [row.transfer for row in rows] + [q.transfer for q in units]:
        if law not in kernel.TRANSFERS:
            raise ValueError(f"the ensemble engine knows no transfer {law!r}: use rate or brian2")
    for row in rows:
        if row.cell.kind not in kernel.KINDS:
            raise ValueError(f"the ensemble engine knows no cell {row.cell.kind!r}: use brian2")
    sparse = np.array([_sparse(circuit, q) for q in units], dtype=bool)
    unit_rest, rest_x, rest_hz = scheme.start
    targets = [np.flatnonzero(wiring.weight[:, q]) for q in range(wiring.units)]
    apart = np.array(
        [kernel.SPREAD if row.spiking and row.spread else kernel.ALIKE for row in rows]
    )
    for q in np.flatnonzero(sparse):
        apart[targets[q]] = kernel.WIRED

    cells = np.array([row.neurons if row.spiking else 0 for row in rows])
    filled = -(-cells // lanes.LANES) * lanes.LANES
    start = np.concatenate([[0], np.cumsum(filled)[:-1]]).astype(np.int64)

    weight = np.where(sparse[None, :], 0.0, wiring.weight)
    delays = scheme.unit_delay
    known = min(int(delays.min(initial=kernel.WINDOW)), kernel.WINDOW)
    window = known // kernel.WORD * kernel.WORD or 1
    ring = 1 << (int(delays.max(initial=1)) + window + kernel.WORD).bit_length()
    strands, fibres, wires, needs = _strands(wiring, scheme, sparse, filled, targets)
    # Ticks taken one by one are rare: to list their spikes saves compiling more loops.
    listing = bool((kept | needs).any() or window == 1)
    source_from, sources = _edges(wiring.deliver)
    input_from, inputs = _edges(weight)
    strand_from = np.searchsorted(strands["target"], np.arange(wiring.blocks + 1))
    drives = np.full(wiring.blocks, -1)
    drives[wiring.blocks_of(circuit.input)] = np.arange(circuit.channels)
    lif = [
        lif_tick(row.cell, NO_SPREAD, dt) if isinstance(row.cell, Lif) else dict.fromkeys(LIF, 0.0)
        for row in rows
    ]
    readout = circuit.population(circuit.readout)
    return records.Plan(
        clock=_records(
            records.CLOCK,
            1,
            ticks=clock.ticks,
            settle=clock.settle_ticks,
            step=clock.step_ticks,
            sample=clock.sample_ticks,
            ring=ring,
            window=window,
            listing=listing,
            dt_s=dt / 1000,
            readout_decay=scheme.readout_decay,
            readout_baseline=readout.baseline_hz,
            readout_gain=readout.gain_hz_per_nat,
        ),
        blocks=_records(
            records.BLOCK,
            wiring.blocks,
            kind=[kernel.KINDS[row.cell.kind] for row in rows],
            law=[kernel.TRANSFERS[row.transfer] for row in rows],
            drive=drives,
            input=input_from[:-1],
            inputs=input_from[1:],
            strand=strand_from[:-1],
            strands=strand_from[1:],
            start=start,
            cells=cells,
            spike_hz=spike_hz(cells, dt),
            filled=filled,
            apart=apart,
            kept=kept,
            baseline=wiring.baseline_hz,
            gain=wiring.gain_hz_per_nat,
            floor=wiring.floor_hz,
            decay=scheme.block_decay,
            push=scheme.block_gain,
            # What a sparse unit always delivers is the same for all cells.
            bias=wiring.bias + (wiring.weight - weight) @ wiring.constant,
            drive_gain=circuit.drive_gain,
            rest_x=rest_x,
            rest_hz=rest_hz,
            jitter=[
                jitter(row.cell, NO_SPREAD) if isinstance(row.cell, Phase) else 0.0 for row in rows
            ],
            **{name: [constants[name] for constants in lif] for name in LIF},
            hold=[_hold(row.cell, dt) for row in rows],
            begin=[_begin(row.cell, dt)[0] for row in rows],
            begin_span=[_begin(row.cell, dt)[1] for row in rows],
        ),
        units=_records(
            records.UNIT,
            wiring.units,
            law=[kernel.TRANSFERS[q.transfer] for q in units],
            delay=scheme.unit_delay,
            source=source_from[:-1],
            sources=source_from[1:],
            decay=scheme.unit_decay,
            constant=wiring.constant,
            rest=unit_rest,
        ),
        sources=sources,
        inputs=inputs,
        strands=strands,
        fibres=fibres,
        wires=wires,
        readout=wiring.blocks_of(circuit.readout),
        ticks=lanes.SINGLE if window == 1 else lanes.FOUR,
        constants=_constants(wiring, start, filled, apart, dt),
    )


def _records(dtype: np.dtype, count: int, /, **columns: Any) -> Any:
    """Return a record array with one column a keyword."""
    table = np.zeros(count, dtype)
    assert set(columns) == set(dtype.names or ())
    for name, values in columns.items():
        table[name] = values
    return table


def _sparse(circuit: Circuit, p: Any) -> bool:
    between = circuit.population(p.source).spiking and circuit.population(p.target).spiking
    return bool(p.probability < 1 and between)


def _hold(cell: object, dt_ms: float) -> float:
    """Return what the state of a cell is set to by a spike."""
    if isinstance(cell, Lif):
        return -float(lanes.WAIT) * refractory_ticks(cell.refractory_ms, dt_ms)
    if isinstance(cell, Escape):
        return -float(refractory_ticks(cell.refractory_ms, dt_ms))
    return 0.0


def _constants(
    wiring: Wiring, start: Any, filled: Any, apart: Any, dt_ms: float
) -> npt.NDArray[np.float32] | None:
    """Return the constants of each cell where cells differ; None if none do."""
    if not apart.any():
        return None
    constants = np.zeros((5, int(filled.sum())), np.float32)
    for b in np.flatnonzero(apart):
        row = wiring.row(b)
        here = slice(start[b], start[b] + row.neurons)
        factors = cell_factors(wiring.circuit, row.name, int(wiring.channel[b]))
        constants[lanes.FACTOR, here] = factors[0]
        if isinstance(row.cell, Phase):
            constants[lanes.KICK, here] = jitter(row.cell, factors)
        if isinstance(row.cell, Lif):
            own = lif_tick(row.cell, factors, dt_ms)
            constants[:, here] = [own[name] for name in ("keep", "rest", "slope", "kick", "unit")]
    return constants


def _strands(
    wiring: Wiring, scheme: Scheme, sparse: Any, filled: Any, targets: list[Any]
) -> tuple[Any, Any, Any, npt.NDArray[np.bool_]]:
    """Lay out connections cell by cell: strands, fibres, wires, and whose spikes they need."""
    circuit = wiring.circuit
    strands: list[tuple[Any, ...]] = []
    fibres: list[tuple[Any, ...]] = []
    wires = [np.zeros(0, np.uint64)]
    size = cells = 0
    needs = np.zeros(wiring.blocks, dtype=bool)
    for q in np.flatnonzero(sparse):
        p = wiring.projection(q)
        sources = np.flatnonzero(wiring.deliver[q])
        gains = wiring.deliver[q, sources]
        if len(sources) and not np.allclose(gains, gains[0]):
            raise ValueError(f"{p.name}: sparse connections need one weight for all channels")
        needs[sources] = True
        for b in targets[q]:
            first, degree = len(fibres), 1
            for source in sources:
                who = fan_in(circuit, p, int(wiring.channel[b]), int(wiring.channel[source]))
                degree = who.shape[1]
                table = np.zeros((circuit.population(p.source).neurons, filled[b]), np.uint8)
                table[who.ravel(), np.repeat(np.arange(len(who)), degree)] = 1
                fibres.append((source, size))
                wires.append(_bits(table))
                size += len(wires[-1])
            decay = scheme.unit_decay[q]
            jump = (1 - decay) * gains.sum() / max(len(gains), 1) / (degree * scheme.dt_ms / 1000)
            places = (b, cells, scheme.unit_delay[q], first, len(fibres))
            strands.append((*places, decay, jump, wiring.weight[b, q], scheme.start[0][q]))
            cells += int(filled[b])
    strands.sort(key=lambda strand: strand[0])
    return (
        np.array(strands, dtype=records.STRAND),
        np.array(fibres, dtype=records.FIBRE),
        np.concatenate(wires),
        needs,
    )


def _bits(table: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint64]:
    """Return rows of 0 and 1 as bits, in the order that ``lanes.add_row`` reads."""
    groups = table.reshape(len(table), -1, 8, 8)
    return np.packbits(groups, axis=2, bitorder="little").ravel().view(np.uint64)


def _edges(matrix: Array) -> tuple[Any, Any]:
    """Return where each row's nonzero entries start, and the entries as records."""
    rows, columns = np.nonzero(matrix)
    starts = np.searchsorted(rows, np.arange(len(matrix) + 1))
    return starts, _records(records.EDGE, len(rows), index=columns, weight=matrix[rows, columns])


def workspace(p: records.Plan) -> records.Work:
    """Return the memory that one trial at a time runs in."""
    blocks, units, clock = len(p.blocks), len(p.units), p.clock[0]
    ring, window = int(clock["ring"]), max(int(clock["window"]), kernel.WORD)
    cells = int(p.blocks["filled"].sum())
    connected = int(p.blocks["filled"][p.strands["target"]].sum())
    widest = int(p.blocks["filled"].max())
    most = widest if clock["listing"] else 1
    return records.Work(
        v=np.zeros(cells, np.float32),
        counts=np.zeros(cells, np.uint32),
        x=np.zeros((kernel.WORD, widest), np.float32),
        own=np.zeros(cells, np.float32),
        ring=np.zeros((blocks, ring)),
        state=np.zeros(blocks),
        total=np.zeros(blocks),
        common=np.zeros(window),
        push=np.zeros(window, np.float32),
        kick=np.zeros(window, np.float32),
        limit=np.zeros(window, np.uint32),
        unit=np.zeros(units),
        passed=np.zeros((units, window)),
        strand=np.zeros(connected, np.float32),
        scale=np.zeros(len(p.strands)),
        sums=np.zeros(widest, np.uint8),
        marks=np.zeros(widest, np.uint8) if clock["listing"] else None,
        places=np.zeros(kernel.WORD, np.int64),
        found=np.zeros(ring * blocks * most, np.int32),
        found_n=np.zeros(ring * blocks, np.int32),
        low_pass=np.zeros(len(p.readout)),
    )


def _begin(cell: object, dt_ms: float) -> tuple[float, float]:
    """Return where a cell may start, as the lanes hold it: the least, and the span."""
    if isinstance(cell, Lif):
        return 0.0, float(lif_tick(cell, NO_SPREAD, dt_ms)["threshold"])
    return (0.0, 1.0) if isinstance(cell, Phase) else (0.0, 0.0)
