"""Conversion of the wiring to the population kernel's records and tables of laws and filters."""

from __future__ import annotations

from dataclasses import replace
from math import gcd, lcm
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.declaration.rows import Population
from circuits.declaration.transfer import named
from circuits.dynamics.ticks import Clock, Scheme, Timed, timed
from circuits.dynamics.wiring import Wiring
from circuits.engines.compiling import edges
from circuits.engines.compiling import records as filled
from circuits.engines.population import kernel, records
from circuits.engines.population.answers import POINTS, STEPS, Mixture, answers, looked_up
from circuits.engines.shipped import PopulationsEngine
from circuits.errors import InputError, NoiseWarning

SLOW_MS = 50.0
"""Time constant of the running mean of the input that selects the filters' coefficients: slower
than noise, faster than response times."""
REFRESH_MS = 8.0
"""Time between updates of a block's filter coefficients to its state, for any tick."""
RUNAWAY_HZ = 1e6
"""Rate above which a run is stopped, because a feedback loop is unstable."""
FEW = 30
FEW_CELLS = (
    f"the population engine assumes Gaussian noise, and that of fewer than {FEW} cells is not: "
    "check the results with a spiking engine"
)
NO_ANSWERS = {"table": -1.0} | dict.fromkeys(("lags", "state_lowest", "state_per", "noise"), 0.0)
"""Fields of the record of a block whose cells have no filters."""


def plan(scheme: Scheme, clock: Clock, engine: PopulationsEngine) -> records.Plan:
    """Convert a circuit to the records of the population engine."""
    wiring = scheme.wiring
    if engine.noise or engine.by_cells:
        _check(wiring)
    tables = _Tables(wiring, engine, clock.dt_ms)
    courses = timed(wiring, replace(clock, settle_ms=0.0))
    source_from, sources = edges(records.EDGE, wiring.deliver)
    input_from, inputs = edges(records.EDGE, wiring.weight)
    blocks = _blocks(scheme, tables, courses, input_from)
    for sentence in tables.rough:
        NoiseWarning.warn(sentence)
    still = courses.still  # None, to avoid compiling unused code
    return records.Plan(
        clock=_clock(scheme, clock),
        # a row per postsynaptic sum, or block: law, filter, and positions of its inputs
        units=_units(scheme, tables, courses, source_from),
        blocks=blocks,
        sources=sources,  # blocks, with weights, that reach a unit
        inputs=inputs,  # units that reach a block
        driven=np.flatnonzero(wiring.columns >= 0),  # blocks that receive a column of the drive
        readout=wiring.blocks_of(wiring.circuit.readout),
        laws=_together(tables.laws, 2),  # without dedicated loops: values at even steps
        tables=_together(tables.rows, kernel.COEFFICIENTS),  # state by state
        # (rows, 1 + ticks), after one tick of rest; ``course`` is the row of a unit, or a block
        factors=None if still else _behind_rest(courses.factors, 1.0),
        nats=None if still else _behind_rest(courses.nats, 0.0),
    )


def _behind_rest(rows: Array, rest: float) -> npt.NDArray[np.float32]:
    return np.pad(rows, ((0, 0), (1, 0)), constant_values=rest).astype(np.float32)


def _together(tables: dict[Any, Array], least: int) -> npt.NDArray[np.float32]:
    return np.array(list(tables.values()) or [np.zeros(least)], np.float32)


def _check(wiring: Wiring) -> None:
    """Raise ValueError if cells of a channel have different inputs, which is not supported."""
    for p in wiring.circuit.projections:
        if wiring.circuit.is_sparse(p):
            message = "the population engine assumes that all cells of a channel share their input"
            connects = f"{p.name} connects {p.probability:.0%}: use spikes"
            raise InputError(f"{message}, but {connects}", "probability")


class _Tables:
    """Tables of laws and coefficients, each stored once, and their assignment to blocks."""

    def __init__(self, wiring: Wiring, engine: PopulationsEngine, dt_ms: float) -> None:
        self.wiring, self.engine, self.dt_ms = wiring, engine, dt_ms
        self.laws: dict[Any, Array] = {}
        self.rows: dict[Any, Array] = {}
        self.rough: dict[str, None] = {}

    def block(self, row: Population) -> dict[str, float]:
        """Return the fields of a block's record set by its law and its cells' responses."""
        fields = NO_ANSWERS | self.transfer(row.transfer)
        fields["baseline"], fields["hz_per_nat"] = row.baseline_hz, row.gain_hz_per_nat
        fields["floor"] = row.cell.lowest_hz
        own_law = self.engine.by_cells and row.cell.hears == "nats"
        if not (row.spiking and (own_law or self.engine.noise)):
            return fields
        line = row.transfer, row.baseline_hz, row.gain_hz_per_nat
        key = Mixture(row.cell, *line, row.heterogeneity)
        responses = answers(key, self.dt_ms)
        ends, full = (responses.lowest, responses.highest), (responses.lowest, responses.top)
        if responses.rough and self.engine.noise:
            self.rough[responses.rough] = None
        fields["table"] = _place(self.rows, key, responses.rows.T.ravel())
        fields["state_lowest"], fields["state_per"] = responses.lowest, _per(ends, STEPS)
        if self.engine.noise and row.neurons < FEW:
            self.rough[FEW_CELLS] = None
        if self.engine.noise:
            fields["noise"] = (row.neurons * self.dt_ms / 1000) ** -0.5
        if own_law:
            fields |= self._looked_up(key, full, responses.hz)
            fields |= {"lags": responses.lags, "baseline": 0, "hz_per_nat": 1, "floor": 0}
        return fields

    def transfer(self, name: str) -> dict[str, float]:
        if name in kernel.TRANSFERS:
            return {"law": kernel.TRANSFERS[name], "column": 0, "lowest": 0, "per": 0}
        lowest, highest, values = looked_up(name)
        return self._looked_up(name, (lowest, highest), values)

    def _looked_up(self, key: Any, ends: tuple[float, float], values: Array) -> dict[str, float]:
        column = _place(self.laws, key, values)
        per = _per(ends, POINTS)
        return {"law": kernel.LOOKED_UP, "column": column, "lowest": ends[0], "per": per}


def _per(ends: tuple[float, float], points: int) -> float:
    """Return the number of steps per nat for ``points`` points between two ends."""
    return (points - 1) / (ends[1] - ends[0])


def _place(tables: dict[Any, Array], key: Any, values: Array) -> int:
    """Return the index of a table, adding it if it is new."""
    tables.setdefault(key, values)
    return list(tables).index(key)


def _low_pass(tau_ms: Array, dt_ms: float) -> dict[str, Array]:
    """Return the factors of a low-pass filter of values interpolated linearly between ticks.

    It is exact for such values, so its error is of second order in the tick, and its mean lag is
    its time constant.
    """
    some = tau_ms > 0
    safe = np.where(some, tau_ms, 1.0)
    gain = -np.expm1(-dt_ms / safe)
    before = gain * safe / dt_ms - np.exp(-dt_ms / safe)
    return {"gain": np.where(some, gain, 1.0), "before": np.where(some, before, 0.0)}


def _blocks(scheme: Scheme, tables: _Tables, courses: Timed, input_from: Any) -> Any:
    wiring = scheme.wiring
    of_rows = [tables.block(row) for row in wiring.rows]
    columns = {name: [one[name] for one in of_rows] for name in of_rows[0]}
    by_cells = tables.engine.by_cells
    rows = wiring.rows
    tau_ms = np.array([row.tau_ms + (0 if by_cells else row.cell.membrane_ms()) for row in rows])
    return filled(
        records.BLOCK,
        wiring.blocks,
        drive=wiring.columns,
        input=input_from[:-1],
        inputs=input_from[1:],
        bias=wiring.bias,
        drive_gain=wiring.drive_gains,
        course=courses.of_block,
        **columns,
        **_low_pass(tau_ms, scheme.dt_ms),
    )


def _units(scheme: Scheme, tables: _Tables, courses: Timed, source_from: Any) -> Any:
    wiring = scheme.wiring
    paths = wiring.projections
    of_paths = [tables.transfer(p.transfer) for p in paths]
    return filled(
        records.UNIT,
        wiring.units,
        delay=scheme.unit_delay,
        source=source_from[:-1],
        sources=source_from[1:],
        constant=wiring.constant,
        course=courses.of_unit,
        **{name: [one[name] for one in of_paths] for name in of_paths[0]},
        **_low_pass(np.array([p.tau_ms for p in paths]), scheme.dt_ms),
    )


def _clock(scheme: Scheme, clock: Clock) -> Any:
    circuit = scheme.wiring.circuit
    readout = circuit.population(circuit.readout)
    read = _low_pass(np.array([circuit.readout_tau_ms]), clock.dt_ms)
    longest = kernel.WINDOW
    refresh = longest * max(round(REFRESH_MS / clock.dt_ms / longest), 1)
    return filled(
        records.CLOCK,
        1,
        step=clock.step_ticks,
        sample=clock.sample_ticks,
        refresh=refresh,
        start=lcm(kernel.KEY_TICKS, clock.sample_ticks, refresh),
        follow_slowly=-np.expm1(-clock.dt_ms / SLOW_MS),
        readout_gain=read["gain"],
        readout_before=read["before"],
        readout_baseline=readout.baseline_hz,
        readout_nats_per_hz=1 / readout.gain_hz_per_nat,
        runaway_hz=RUNAWAY_HZ,
    )


def window(p: records.Plan) -> tuple[int, ...]:
    """Return the longest window of ticks that fits the delays, the readings and the samples."""
    least, clock = int(p.units["delay"].min(initial=kernel.WINDOW)), p.clock[0]
    divisor = gcd(clock["step"], clock["sample"])
    fits = [n for n in kernel.WINDOWS if n <= least and divisor % n == 0]
    return kernel.WINDOWS[max(fits)]


def rest(scheme: Scheme) -> records.State:
    """Return the resting state, in one entry."""
    wiring = scheme.wiring
    units, x, hz = scheme.start
    active = zip(wiring.projections, units + wiring.constant, strict=True)
    passed = [named(p.transfer)(np.array([u]))[0] for p, u in active]
    blocks = np.zeros((wiring.blocks, kernel.STATE_ROWS))
    blocks[:, : kernel.SLOPE] = x[:, None]
    ring = np.repeat(hz[:, None], int(scheme.unit_delay.max(initial=1)), axis=1)
    of_units = np.array([units, units, passed]).T
    parts = (ring, blocks, of_units, hz[wiring.blocks_of(wiring.circuit.readout)])
    return records.State(*(np.array(part[None], np.float32, order="C") for part in parts))


def workspace(p: records.Plan, *, kept: bool) -> records.Work:
    """Return the working memory of a group of trials.

    A row has one number per lane; the rows of a unit or a block are contiguous.
    """
    blocks, units, channels = len(p.blocks), len(p.units), len(p.readout)
    places = 1 << (int(p.units["delay"].max(initial=1)) + kernel.WINDOW).bit_length()

    def rows(count: int, *of: int, kind: type = np.float32) -> npt.NDArray[Any]:
        return np.zeros((*of, count * kernel.LANES), kind)

    return records.Work(
        ring=rows(places, blocks),  # rates of the last ticks, Hz
        units=rows(kernel.UNIT_ROWS, units),  # filters
        states=rows(kernel.STATE_ROWS, blocks),  # filters
        coefficients=rows(kernel.COEFFICIENTS, blocks),  # of these filters
        passed=rows(kernel.WINDOW, units),  # activity transmitted in each tick of a window, nats
        jumps=rows(kernel.WINDOW, units),  # change of a previous output due to that of its factor
        # change of a block's previous input due to courses
        shifts=None if p.factors is None else rows(kernel.WINDOW),
        totals=rows(1, blocks),  # sums of rates over a sample
        counts=rows(1, kind=np.uint32),  # ones in the bytes of a word of noise
        values=rows(kernel.WINDOW),  # input or activity of one block at a time, nats
        # places in a table, the numbers there, and the next ones
        found=tuple(rows(kernel.WINDOW, kind=kind) for kind in (np.int32, np.float32, np.float32)),
        drive=rows(1, blocks),  # by the current reading, nats
        low_pass=rows(1, channels),  # low-passed rates of the read-out, Hz
        out=rows(1, channels),  # nats
        lowest=rows(1),  # lowest OUT, nats
        streams=rows(1, blocks, kind=np.uint64),  # keys of the noise of each trial
        keys=rows(2, blocks, kind=np.uint32),  # keys of the present ticks, in halves
        **{name: rows(1, kind=np.int64) for name in kernel.OF_LANES},
        soonest=np.zeros(1, np.int64),  # tick of the next reading of any lane
        kept=kept,  # whether rates are recorded
    )
