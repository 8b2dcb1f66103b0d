"""The clock and the integration scheme of one tick, shared by the dynamic engines.

At tick k, with all rates of earlier ticks known:

1. units: ``u = D u + (1 - D) deliver r[k - delay]``; the filtered activity is ``u + constant``;
2. blocks: ``input = bias + factor weight g(u + constant) + drive + course``, then
   ``x = A x + (1 - A) input``; a cell that hears nats filters in its membrane instead; the factor
   is 1 and the course 0 unless the circuit has courses (``timed``);
3. cells: populations without spikes transmit ``r[k] = rates(x)``, spiking ones
   ``r[k] = spikes / (neurons dt)``; a renewal cell fires, once in a tick at most, if its
   expected spikes, the sum of ``rates(x) dt``, have reached the end of an interval;
4. read-out: ``o = R o + (1 - R) r[k]``.

Cells with a tick use single precision, everything else double. Their update consists of products
and sums ``a + b c``, each rounded once to single precision: a spike depends on the last bit of a
potential, so an engine that rounded elsewhere would produce other spikes. A product of singles is
exact in double precision, so ``single(a + b*c)`` equals a processor's fused multiply-add.

The population engine instead interpolates rates linearly between ticks, so that its filters have
the correct mean lag for any tick and its results are second order in the tick.

A delay is at least one tick. Runs start at the intact circuit's resting state, or at the lesioned
one's if lesions are chronic; the evidence begins after a settling time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Index
from circuits.cells.cell import Cell, Constants, tick_constants
from circuits.cells.renewal import first_spikes, wait
from circuits.checks import check_positive, check_range, place_of, whole_ticks
from circuits.declaration.courses import DOPAMINE
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import resting_state
from circuits.dynamics.wiring import Wiring
from circuits.errors import EditWarning, InputError

SPIKE_BITS = 40
"""Bits of the rate added per spike: sums of up to 8192 spikes are exact in any order."""
ALL_ALIKE = np.ones(3)
"""Factors on the constants of a cell that equals its row."""
LEAST_FACTOR = 0.1
"""Lowest value of a cell's constant, as a fraction of its population's."""
TICK_MS = 0.1
"""The tick where no longer one is exact enough or divides all times."""


@dataclass(frozen=True)
class Clock:
    """Times of a run, in ms and in ticks, of which each must be a multiple."""

    steps: int  # number of readings of evidence
    step_ms: float  # from one reading to the next; each reading is held until the next
    dt_ms: float = TICK_MS  # one tick
    sample_ms: float = 1.0  # from one recorded sample to the next
    settle_ms: float = 300.0  # at rest before the first reading; not recorded

    def __post_init__(self) -> None:
        check_positive(dt_ms=self.dt_ms, step_ms=self.step_ms, sample_ms=self.sample_ms)
        check_range(0, math.inf, settle_ms=self.settle_ms)
        _ = self.settle_ticks  # raises unless it is a multiple of the tick
        if self.step_ticks % self.sample_ticks:
            times = f"{self.step_ms} and {self.sample_ms}"
            reason = f"step_ms must be a multiple of sample_ms, got {times}"
            raise InputError(reason, "sample_ms")

    @property
    def step_ticks(self) -> int:
        """Ticks per reading."""
        return whole_ticks("step_ms", self.step_ms, self.dt_ms)

    @property
    def sample_ticks(self) -> int:
        """Ticks per sample."""
        return whole_ticks("sample_ms", self.sample_ms, self.dt_ms)

    @property
    def settle_ticks(self) -> int:
        """Ticks before the first reading."""
        return whole_ticks("settle_ms", self.settle_ms, self.dt_ms)

    @property
    def ticks(self) -> int:
        """Ticks in the whole run."""
        return self.settle_ticks + self.steps * self.step_ticks

    @property
    def samples(self) -> int:
        """Number of samples recorded."""
        return self.steps * self.step_ticks // self.sample_ticks

    @property
    def time_ms(self) -> Array:
        """Time of each sample, ms from the first reading: the end of its averaging window."""
        return np.arange(1, self.samples + 1, dtype=np.float64) * self.sample_ms

    def about(self, seed: int, first_trial: int) -> dict[str, float]:
        """Return the entries of ``Activity.about`` for a run with noise."""
        run = {"seed": int(seed), "first_trial": first_trial}
        return run | {"dt_ms": self.dt_ms, "settle_ms": self.settle_ms}

    def step_of(self, tick: int) -> int:
        """Return the reading that holds at a tick, -1 before the first."""
        late = tick - self.settle_ticks
        return late // self.step_ticks if late >= 0 else -1


@dataclass(frozen=True)
class Scheme:
    """A wiring with a given tick: the factors of the four steps above, and the initial state."""

    wiring: Wiring
    dt_ms: float

    @cached_property
    def unit_decay(self) -> Array:
        """D of each unit."""
        return _decay(self.dt_ms, np.array([p.tau_ms for p in self.wiring.projections]))

    @cached_property
    def unit_delay(self) -> Index:
        """Delay of each unit, ticks, at least 1."""
        delays = [
            whole_ticks(f"the delay of {p.name}", p.delay_ms, self.dt_ms)
            for p in self.wiring.projections
        ]
        return np.maximum(np.array(delays, dtype=np.intp), 1)

    @cached_property
    def block_decay(self) -> Array:
        """A of each block's filter; 0 where cells filter in their membrane."""
        return _decay(self.dt_ms, self.wiring.column("tau_ms"))

    @cached_property
    def readout_decay(self) -> float:
        """R of the read-out."""
        return float(_decay(self.dt_ms, np.array([self.wiring.circuit.readout_tau_ms]))[0])

    @cached_property
    def start(self) -> tuple[Array, Array, Array]:
        """Initial units (without constant), block states in nats, and rates in Hz."""
        edited = self.wiring.circuit
        unlesioned = edited.unlesioned
        x, rates = resting_state(edited if edited.chronic else unlesioned)
        try:
            if not edited.chronic and edited != unlesioned:
                resting_state(edited)
        except ValueError:
            EditWarning.warn(
                f"{edited.name} has no resting state after these edits: its activity depends "
                "on the settling time"
            )
        return self.wiring.deliver @ rates, x, rates

    @cached_property
    def renewals(self) -> list[Cell]:
        """Distinct renewal cells, each with a table of intervals."""
        return list(dict.fromkeys(r.cell for r in self.wiring.rows if r.cell.renewal()))

    def constants(self, block: int) -> Constants:
        """Return the constants of a block's cells: scalars, or (neurons,) if heterogeneous.

        Renewal cells have one, the factor ``slow`` on their intervals.
        """
        row, circuit = self.wiring.rows[block], self.wiring.circuit
        factors = ALL_ALIKE
        if row.heterogeneity:
            factors = cell_factors(circuit, row.name, int(self.wiring.channel[block]))
        if row.cell.renewal():
            return {"slow": np.float32(1 / factors[0])}
        return tick_constants(row.cell, factors, self.dt_ms)


def tick_ms(wiring: Wiring, candidates_ms: tuple[float, ...], *times_ms: float) -> float:
    """Return the first candidate that divides all delays and these times, or else ``TICK_MS``."""
    delays = [p.delay_ms for p in wiring.projections]
    for dt in candidates_ms:
        ticks = np.array([*delays, *times_ms]) / dt
        if np.abs(ticks - np.round(ticks)).max() < 1e-6:
            return dt
    return TICK_MS


def cell_factors(circuit: CircuitTable, name: str, channel: int) -> Array:
    """Return the factors (3, neurons) of each cell's constants; 1 where the heterogeneity is 0.

    ``Cell.constants`` defines which constants they multiply. They depend on the circuit's
    ``wiring_seed``, not on the trial. Their mean over the cells of a channel is 1 (except for the
    few cut off at ``LEAST_FACTOR``): otherwise channels of 300 cells would differ permanently by up
    to 0.03 nats of OUT, like a prior. A channel with a single cell has no heterogeneity.
    """
    row = circuit.population(name)
    key = noise.stream_key(circuit.wiring_seed, 0, f"{name}/{channel}")
    draws = np.array([noise.bits32(key, noise.CELLS_TICK + i, row.neurons) for i in range(3)])
    draws -= draws.mean(axis=1, keepdims=True)
    return np.maximum(1 + row.heterogeneity * draws, LEAST_FACTOR)


def spike_hz(neurons: Any, dt_ms: float) -> Any:
    """Return the rate, Hz, that one spike in a tick adds to a population of ``neurons`` cells."""
    mantissa, exponent = np.frexp(1000 / (np.maximum(neurons, 1) * dt_ms))
    return np.ldexp(np.round(np.ldexp(mantissa, SPIKE_BITS)), exponent - SPIKE_BITS)


def starting_state(
    cell: Cell, constants: Constants, stream: int, neurons: int
) -> tuple[npt.NDArray[Any], ...]:
    """Return the initial values of a cell type's state variables, (neurons,) each.

    That of renewal cells is the number of expected spikes at which they first fire.
    """
    if cell.renewal():
        words = noise.train_words(stream, np.arange(neurons), 0)
        return (np.float64(constants["slow"]) * wait(first_spikes(cell), words),)
    begin = cell.begin or cell.lacks("begin", "engines that spike")
    begun = begin(noise.uniform(stream, noise.START_TICK, neurons), *constants.values())
    return tuple(np.broadcast_to(np.float32(value), neurons).copy() for value in begun)


def _decay(dt_ms: float, tau_ms: Array) -> Array:
    safe = np.where(tau_ms > 0, tau_ms, 1.0)
    return np.where(tau_ms > 0, np.exp(-dt_ms / safe), 0.0)


@dataclass(frozen=True)
class Timed:
    """Tables of changes from tick to tick; row 0 of each is neutral."""

    factors: Array  # (rows, ticks) on the weights of units
    nats: Array  # (rows, ticks) added to the input of blocks
    of_unit: Index  # (units,) row of each
    of_block: Index  # (blocks,) row of each

    def at(self, tick: int) -> tuple[Array, Array]:
        """Return the factors (units,) and the nats (blocks,) at a tick."""
        # Without courses the tables are one tick long.
        k = min(tick, self.factors.shape[1] - 1)
        return self.factors[self.of_unit, k], self.nats[self.of_block, k]

    @property
    def still(self) -> bool:
        """Whether nothing changes."""
        return not (self.of_unit.any() or self.of_block.any())


def timed(wiring: Wiring, clock: Clock) -> Timed:
    """Return the courses of a circuit, averaged over each tick of a run."""
    circuit = wiring.circuit
    if not circuit.courses:
        still = np.zeros(wiring.units, dtype=np.intp), np.zeros(wiring.blocks, dtype=np.intp)
        return Timed(np.ones((1, 1)), np.zeros((1, 1)), *still)
    level, nats = _sums(circuit, clock)
    factors = {p.name: np.ones(clock.ticks) for p in circuit.projections}
    if any(course.what == DOPAMINE for course in circuit.courses):
        for p, change, added in circuit.dopamine_changes(level):
            factors[p.name] = 1 + change
            for place in nats:
                nats[place] += added if place[0] == p.target else 0.0
    paths, path_rows = rows(list(factors.values()), np.ones(clock.ticks))
    places, place_rows = rows(list(nats.values()), np.zeros(clock.ticks))
    known = list(nats)
    each = [(row.name, int(k)) for row, k in zip(wiring.rows, wiring.channel, strict=True)]
    of_block = [known.index(one if one in nats else (one[0], None)) for one in each]
    return Timed(path_rows, place_rows, paths[wiring.path], places[of_block])


def _sums(circuit: CircuitTable, clock: Clock) -> tuple[Array, dict[tuple[str, int | None], Array]]:
    """Return dopamine's level, and the nats added to populations and to channels with courses."""
    late = clock.ticks - clock.settle_ticks
    level = np.ones(clock.ticks)
    nuclei = [(row.name, None) for row in circuit.populations]
    driven = [place_of(course.what) for course in circuit.courses if course.what != DOPAMINE]
    nats = {place: np.zeros(clock.ticks) for place in (*nuclei, *driven)}
    for course in circuit.courses:
        name, channel = place_of(course.what)
        here = [sums for (row, k), sums in nats.items() if row == name and channel in (None, k)]
        for sums in [level] if course.what == DOPAMINE else here:
            sums[clock.settle_ticks :] += course.in_ticks(late, clock.dt_ms)
    return level, nats


def rows(values: list[Array], first: Array) -> tuple[Index, Array]:
    """Return row indices into a table, and the table of distinct rows, starting with ``first``."""
    distinct = {first.tobytes(): first}
    for row in values:
        # Adding 0 turns -0.0 into 0.0.
        distinct.setdefault((row + 0.0).tobytes(), row + 0.0)
    places = {key: place for place, key in enumerate(distinct)}
    of = np.array([places[(row + 0.0).tobytes()] for row in values], dtype=np.intp)
    return of, np.array(list(distinct.values()))
