"""Where dopamine acts: the pathways with receptors, and how a level changes their weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from circuits.arrays import Array
from circuits.declaration.network import Network
from circuits.declaration.rows import RECEPTORS, Population, Projection
from circuits.errors import InputError

# A level of dopamine, or one per tick.
Level = TypeVar("Level", float, Array)


@dataclass(frozen=True, repr=False)
class DopamineTable(Network):
    """A network in which dopamine scales the pathways that have receptors."""

    input: str = "ctx"
    """Population that receives the evidence."""

    def receptors(self) -> tuple[tuple[Projection, Population | Projection], ...]:
        """Return the pathways scaled by dopamine, each with the row that has the receptor.

        These are pathways with receptors at their terminals, and pathways from the input onto cells
        with receptors; if both have receptors, only those of the pathway count.
        """
        pairs: list[tuple[Projection, Population | Projection]] = []
        for p in self.projections:
            cells = self.population(p.target)
            if p.receptor:
                pairs.append((p, p))
            elif cells.receptor and p.source == self.input:
                pairs.append((p, cells))
        return tuple(pairs)

    def dopamine_changes(self, level: Level) -> list[tuple[Projection, Level, Level]]:
        """Return the effects of a dopamine level relative to this circuit's; 1 has no effect.

        The weight of a pathway with D1 receptors is multiplied by ``level``, with D2 receptors by
        ``2 - level``; see ``receptors``. Its input at ``operating_point_nats`` does not change.
        Each effect is a pathway, the change of its weight's factor (relative to 1), and the nats
        added to its target's bias; the level may be an array, one per tick.
        """
        changes = []
        for p, row in self.receptors():
            if p.factors and row.operating_point_nats:
                bias = "dopamine about a pivot would need a bias for each"
                raise InputError(f"{p.name} differs from channel to channel: {bias}", "dopamine")
            change = RECEPTORS[row.receptor] * (level - 1)
            changes.append((p, change, -(change * p.weight * row.operating_point_nats)))
        return changes
