"""Effects of courses at each tick, shared by all engines: factors on pathways, and added nats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from circuits.arrays import Array, Index
from circuits.checks import place_of
from circuits.declaration.courses import DOPAMINE
from circuits.declaration.table import CircuitTable
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import Wiring


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
