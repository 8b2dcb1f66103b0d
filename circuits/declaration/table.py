"""The declaration: a circuit is tables, of populations, projections and courses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np

from circuits.arrays import Array
from circuits.checks import check_finite, check_positive, check_range
from circuits.declaration.courses import DOPAMINE, Course, extremes
from circuits.declaration.network import Network, check_rows
from circuits.declaration.rows import RECEPTORS, WHOLE, Population, Projection
from circuits.errors import InputError, require

NOT_WRITTEN = ("unedited",)
"""Fields of a circuit that say where it came from, not what it is: no file and no hash has them."""

EDITED = "edited from: "
"""Prefix of ``about`` once a number of a table has changed: the text describes the original."""

NATS = "nats"
UNITS = (NATS, "salience")
"""Units of a circuit's drive and OUT."""

# A level of dopamine, or one per tick.
Level = TypeVar("Level", float, Array)


@dataclass(frozen=True, repr=False)
class CircuitTable(Network):
    """A network with an input, a read-out, and courses: all that engines and theory read.

    The evidence enters ``input`` as a drive in nats, one number per channel, that is zero at rest:
    the input is ``drive_gain * (drive + rest_drive)``. The decoded rate of ``readout`` is OUT. In
    a circuit of another ``unit`` drive, OUT and every field whose name ends in nats are in that.
    """

    input: str = "ctx"
    """The population where evidence enters."""
    readout: str = "SNr"
    """The population where OUT is read."""
    reference_nats: float = 3.0
    """``S = ln sum exp y`` at rest; of another unit than nats, each channel's input at rest."""
    drive_gain: float = 1.0
    """Factor on the drive that keeps OUT in nats."""
    readout_tau_ms: float = 0.0
    """Time constant of the low-pass filter of the read-out, ms."""
    exact: bool = False
    """Whether OUT is meant to be ``-ln P`` at the fixed point; editing a weight clears it."""
    range_nats: tuple[float, float] = (0.0, math.inf)
    """Lowest and highest ``S`` (of another unit than nats, input) at which the circuit works."""
    readable_nats: tuple[float, float] = (0.0, math.inf)
    """Lowest and highest OUT that the read-out's rate stands for."""
    centred: bool = True
    """Whether the mean of the drive over channels must be subtracted before it enters. A circuit
    that cancels what channels have in common does without: each channel gets its own evidence."""
    max_deficit_nats: float = math.inf
    """How far below the leader's drive another channel's may fall: a silent cell cannot fall
    further. The leader's OUT changes by at most ``ln(1 + (channels - 1) exp(-reach))``."""
    max_lead_nats: float = math.inf
    """Largest mean lead, nats of drive, that one channel may gain over the mean of the others per
    100 ms, or per reading where readings are further apart. Beyond it decisions come late or
    never. Infinite where it was not measured."""
    most_channels: int = 1000
    """Most alternatives for which the circuit has a state of rest."""
    wiring_seed: int = 0
    """Key of what differs from cell to cell: connections and heterogeneity."""
    courses: tuple[Course, ...] = ()
    """The third table: what changes within a trial. Most circuits have none."""
    about: str = field(default="", compare=False)
    """One sentence with its source, of the table before any edit: an edited one begins with
    ``EDITED``. It is no part of what makes two circuits equal."""
    unit: str = NATS
    """Unit of drive and OUT: "nats", or "salience", from which no posterior follows."""
    default_gain: float | None = None
    """Nats of drive per nat of evidence that the circuit was made with; None if not known."""
    chronic: bool = False
    """Whether lesions are old: the circuit starts at its own rest, not at that of the intact
    one."""
    unedited: Self | None = field(default=None, compare=False)
    """The table before its edits, which set it. It is no part of what makes two circuits equal,
    and no file keeps it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_rows(self.name, Course, self.courses)
        if self.channels > self.most_channels:
            most = f"{self.name} takes at most {self.most_channels} alternatives"
            raise InputError(f"{most}, got {self.channels}", "channels", self.channels)
        self._check_numbers()
        self._check_unit()
        self._reaches()
        self._check_courses()

    def _check_numbers(self) -> None:
        for name in ("max_deficit_nats", "max_lead_nats"):
            require(getattr(self, name) > 0, name, "must be > 0", getattr(self, name))
        check_range(0, math.inf, readout_tau_ms=self.readout_tau_ms)
        for name in ("range_nats", "readable_nats"):
            low, high = getattr(self, name)
            require(low <= high, name, "must be two numbers that rise", (low, high))
        check_finite(reference_nats=self.reference_nats, drive_gain=self.drive_gain)

    def _check_unit(self) -> None:
        require(self.unit in UNITS, "unit", f"must be one of {', '.join(UNITS)}", self.unit)
        if self.exact:
            self.check_nats("exact, OUT = -ln P,")
        if self.default_gain is not None:
            check_positive(default_gain=self.default_gain)

    def _reaches(self) -> None:
        """Refuse a circuit whose evidence cannot reach its read-out."""
        for role in ("input", "readout"):
            must = f"must be one of the nuclei of {self.name}, {', '.join(self._known)}"
            require(getattr(self, role) in self._known, role, must, getattr(self, role))
        ends = self.input, self.readout
        if any(self.population(name).pooled for name in ends):
            raise InputError(f"{' and '.join(ends)} need a channel an alternative", "input")
        reached = {self.input}
        for _ in self.populations:
            reached |= {
                p.target
                for p in self.projections
                if p.source in reached
                and p.weight
                and any(p.factors or (1,))
                and self.axons_of(p).any()
                and self.intact_of(p.source).any()
            }
        if self.readout not in reached:
            raise InputError(f"no pathway is left from {self.input} to {self.readout}", "readout")

    def _check_courses(self) -> None:
        """Refuse a course of nothing, and one that takes dopamine out of its range."""
        for row in self.courses:
            if row.what not in (DOPAMINE, *self._known):
                said = f"{row.name}: {self.name} has no nucleus {row.what!r}: a course is of"
                raise InputError(f"{said} {', '.join((DOPAMINE, *self._known))}", "courses")
        rows = [row for row in self.courses if row.what == DOPAMINE]
        if not rows:
            return
        first = rows[0].name
        if DOPAMINE in self._known:
            raise InputError(f"{first}: a nucleus of {self.name} has that name too", "courses")
        if not self.receptors():
            said = f"{first}: no row of {self.name} has a receptor, it would change nothing"
            raise InputError(said, "courses")
        self.dopamine_changes(1.0)
        for moved, time_ms in extremes(rows):
            if not -1 <= moved <= 1:
                at = np.array([time_ms])
                there = [row for row in rows if float(row.at(at)[0]) * moved > 0]
                last = max(there, key=lambda row: row.from_ms).name
                level = f"with this row it is {1 + moved:.3g} at {time_ms:.4g} ms"
                said = f"{last}: the level of dopamine must lie in 0..2, {level}"
                raise InputError(said, "courses")

    def check_steady(self, what: str) -> None:
        """Raise ValueError, in a circuit with courses, for what knows no time."""
        if self.courses:
            steady = "circuit.steady, without them, or circuit.dopamine(level), which stays"
            said = f"{self.name} has courses, and {what} knows no time: take {steady}"
            raise InputError(said, "courses")

    def check_nats(self, what: str, instead: str = "") -> None:
        """Raise ValueError, in a circuit of another unit, for what has a meaning in nats alone."""
        if self.unit != NATS:
            said = f"{self.name} works in {self.unit}, not nats: {what} has no meaning there"
            raise InputError(said + instead, "unit")

    @property
    def rest_drive(self) -> float:
        """What the input adds to the drive of each channel: its input at rest."""
        return self.reference_nats - (np.log(self.channels) if self.unit == NATS else 0.0)

    def receptors(self) -> tuple[tuple[Projection, Population | Projection], ...]:
        """Return the pathways that dopamine scales, each with the row that has the receptor.

        That is a pathway with receptors at its terminals, or one from the input onto cells with
        receptors; where both have them, those of the pathway count.
        """
        found: list[tuple[Projection, Population | Projection]] = []
        for p in self.projections:
            cells = self.population(p.target)
            if p.receptor:
                found.append((p, p))
            elif cells.receptor and p.source == self.input:
                found.append((p, cells))
        return tuple(found)

    def dopamine_changes(self, level: Level) -> list[tuple[Projection, Level, Level]]:
        """Return the changes by a level of dopamine, relative to this circuit's; 1 changes nothing.

        The weight of a pathway with D1 receptors is multiplied by ``level``, with D2 receptors by
        ``2 - level``; see ``receptors``. What it adds at the ``operating_point_nats`` stays what it
        was.

        Parameters
        ----------
        level : float or array
            The level, or one per tick.

        Returns
        -------
        list of (Projection, change, nats)
            Each pathway, what is added to the factor 1 of its weight, and nats that are added to
            its target's bias.
        """
        found = []
        for p, row in self.receptors():
            if p.factors and row.operating_point_nats:
                bias = "dopamine about a pivot would need a bias for each"
                raise InputError(f"{p.name} differs from channel to channel: {bias}", "dopamine")
            change = RECEPTORS[row.receptor] * (level - 1)
            found.append((p, change, -(change * p.weight * row.operating_point_nats)))
        return found

    @property
    def steady(self) -> Self:
        """The circuit without courses: what it is while it settles, before the drive begins."""
        return replace(self, courses=()) if self.courses else self

    @property
    def unlesioned(self) -> Self:
        """The circuit with every lesion and cut undone; biases that recovered from one stay."""
        rows = tuple(replace(p, **WHOLE) for p in self.populations)
        paths = tuple(replace(p, intact=1.0, intact_by_channel=()) for p in self.projections)
        return replace(self, populations=rows, projections=paths, chronic=False)
