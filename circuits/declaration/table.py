"""The declaration of a circuit: its tables of populations, projections and courses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np

from circuits.arrays import Array
from circuits.checks import check_channel, check_finite, check_positive, check_range, place_of
from circuits.declaration.courses import DOPAMINE, Course, extremes
from circuits.declaration.network import Network, check_rows
from circuits.declaration.rows import RECEPTORS, WHOLE, Population, Projection
from circuits.errors import InputError, require

NOT_WRITTEN = ("unedited", "dopamine_edit")
"""Fields of a circuit that record its origin; they are neither written to files nor hashed."""

EDITED = "edited from: "
"""Prefix of ``about`` once a number of a table has changed: the text describes the original."""

NATS = "nats"
UNITS = (NATS, "salience")
"""Units of a circuit's drive and OUT."""


# A level of dopamine, or one per tick.
Level = TypeVar("Level", float, Array)


@dataclass(frozen=True, repr=False)
class CircuitTable(Network):
    """A network with an input, a read-out, and courses; the input of engines and theory.

    The evidence enters ``input`` as a drive in nats, one number per channel, that is zero at rest:
    the input is ``drive_gain * (drive + rest_drive)``. The decoded rate of ``readout`` is OUT. If
    the circuit has another ``unit``, it applies to drive, OUT and all fields that end in ``_nats``.
    """

    input: str = "ctx"  #: Population that receives the evidence.
    readout: str = "SNr"  #: Population from which OUT is read.
    reference_nats: float = 3.0
    """``S = ln sum exp y`` at rest; if the unit is not nats, each channel's resting input."""
    drive_gain: float = 1.0  #: Factor on the drive that keeps OUT in nats.
    readout_tau_ms: float = 0.0
    """Time constant of the read-out's low-pass filter, ms; at 0 OUT is the rate of one tick."""
    exact: bool = False
    """Whether OUT is meant to be ``-ln P`` at the fixed point; editing a weight clears it."""
    range_nats: tuple[float, float] = (0.0, math.inf)
    """Lowest and highest ``S`` (or input, if the unit is not nats) at which the circuit works."""
    readable_nats: tuple[float, float] = (0.0, math.inf)
    """Lowest and highest OUT that the read-out's rate can represent."""
    centred: bool = True
    """Whether the mean drive over channels must be subtracted beforehand. A circuit that cancels
    common input does not need this: each channel receives its own evidence."""
    max_deficit_nats: float = math.inf
    """How far the drive of a channel can fall below the leader's before its cells are silent and
    follow no further. This changes the leader's OUT by at most
    ``ln(1 + (channels - 1) exp(-max_deficit_nats))``."""
    max_lead_nats: float = math.inf
    """Largest mean lead, nats of drive, that one channel may gain over the mean of the others per
    100 ms, or per reading where readings are further apart. Beyond it decisions come late or
    never. Infinite where it was not measured."""
    most_channels: int = 1000
    """Largest number of alternatives for which the circuit has a resting state."""
    wiring_seed: int = 0  #: Seed of connections and heterogeneity, which differ between cells.
    more_inputs: tuple[str, ...] = ()
    """Other nuclei, such as "STN", or channels of them, "GPe[0]", that receive an input in each
    trial, such as a stop signal: the last columns of the drive, nats."""
    courses: tuple[Course, ...] = ()
    """The third table: changes within a trial. Most circuits have none."""
    about: str = field(default="", compare=False)
    """One sentence with its source about the table before any edit; after an edit it begins with
    ``EDITED``. It is ignored when circuits are compared."""
    unit: str = NATS
    """Unit of drive and OUT: "nats", or "salience", from which no posterior follows."""
    default_gain: float | None = None
    """Nats of drive per nat of evidence for which the circuit was designed; None if unknown."""
    chronic: bool = False
    """Whether lesions are chronic: runs start at the resting state of this circuit, not at that of
    the intact one."""
    unedited: Self | None = field(default=None, compare=False)
    """The table before its edits; None for an unedited one. It is ignored when circuits are
    compared, and not saved to files."""
    dopamine_edit: float = field(default=1.0, compare=False)
    """Dopamine level set by the last edit of it, or 1; ignored and not saved, like ``unedited``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_rows(self.name, Course, self.courses)
        if self.channels > self.most_channels:
            most = f"{self.name} takes at most {self.most_channels} alternatives"
            raise InputError(f"{most}, got {self.channels}", "channels", self.channels)
        self._check_numbers()
        self._reaches()
        self._check_more_inputs()
        self._check_courses()

    def _check_numbers(self) -> None:
        for name in ("max_deficit_nats", "max_lead_nats"):
            require(getattr(self, name) > 0, name, "must be > 0", getattr(self, name))
        check_range(0, math.inf, readout_tau_ms=self.readout_tau_ms)
        for name in ("range_nats", "readable_nats"):
            low, high = getattr(self, name)
            require(low <= high, name, "must be two numbers that rise", (low, high))
        check_finite(reference_nats=self.reference_nats, drive_gain=self.drive_gain)
        require(self.unit in UNITS, "unit", f"must be one of {', '.join(UNITS)}", self.unit)
        if self.exact:
            self.check_nats("exact, OUT = -ln P,")
        if self.default_gain is not None:
            check_positive(default_gain=self.default_gain)

    def _reaches(self) -> None:
        """Reject a circuit whose evidence cannot reach its read-out."""
        for role in ("input", "readout"):
            must = f"must be one of the nuclei of {self.name}, {', '.join(self._known)}"
            require(getattr(self, role) in self._known, role, must, getattr(self, role))
        ends = self.input, self.readout
        if any(self.population(name).pooled for name in ends):
            raise InputError(f"{' and '.join(ends)} need one channel per alternative", "input")
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

    @property
    def columns(self) -> int:
        """Columns of the drive: one per channel, and one per entry of ``more_inputs``."""
        return self.channels + len(self.more_inputs)

    def input_places(self) -> list[tuple[str, int | None]]:
        """Return the nucleus, and the channel or None for all, of each of ``more_inputs``."""
        return [place_of(text) for text in self.more_inputs]

    def _check_more_inputs(self) -> None:
        known = [name for name in self._known if name != self.input]
        seen: set[tuple[str, int]] = set()
        for text, (name, channel) in zip(self.more_inputs, self.input_places(), strict=True):
            must = f"must be among {', '.join(known)}, or a channel of one, such as STN[0]"
            require(name in known, "more_inputs", must, text, owner=self.name)
            count = self.channels_of(name)
            if channel is not None:
                must = f"must be channels that exist, {name} has {count}"
                require(channel < count, "more_inputs", must, text)
            places = {(name, k) for k in (range(count) if channel is None else [channel])}
            require(not places & seen, "more_inputs", "must name each place once", self.more_inputs)
            seen |= places

    def _check_courses(self) -> None:
        for row in self.courses:
            name, channel = place_of(row.what)
            if row.what != DOPAMINE and name not in self._known:
                reason = f"{row.name}: {self.name} has no nucleus {row.what!r}: a course is of"
                known = ", ".join((DOPAMINE, *self._known))
                raise InputError(f"{reason} {known}, or of one channel, such as STN[0]", "courses")
            if channel is not None:
                check_channel(row.name, channel, self.channels_of(name))
        rows = [row for row in self.courses if row.what == DOPAMINE]
        if not rows:
            return
        first = rows[0].name
        if DOPAMINE in self._known:
            raise InputError(f"{first}: a nucleus of {self.name} has that name too", "courses")
        if not self.receptors():
            reason = f"{first}: no row of {self.name} has a receptor, so it would have no effect"
            raise InputError(reason, "courses")
        self.dopamine_changes(1.0)
        for moved, time_ms in extremes(rows):
            if not -1 <= moved <= 1:
                at = np.array([time_ms])
                there = [row for row in rows if float(row.at(at)[0]) * moved > 0]
                last = max(there, key=lambda row: row.from_ms).name
                level = f"with this row it is {1 + moved:.3g} at {time_ms:.4g} ms"
                reason = f"{last}: the level of dopamine must be within 0..2, {level}"
                raise InputError(reason, "courses")

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

    def check_steady(self, what: str) -> None:
        """Raise ValueError if the circuit has courses, for methods without time."""
        if self.courses:
            steady = "circuit.steady, which has none, or circuit.dopamine(level), which is constant"
            reason = f"{self.name} has courses, but {what} has no time: use {steady}"
            raise InputError(reason, "courses")

    def check_nats(self, what: str, instead: str = "") -> None:
        """Raise ValueError if the circuit's unit is not nats, for quantities that need nats."""
        if self.unit != NATS:
            reason = f"{self.name} works in {self.unit}, not nats: {what} has no meaning there"
            raise InputError(reason + instead, "unit")

    @property
    def rest_drive(self) -> float:
        """Resting input of each channel, which is added to its drive."""
        return self.reference_nats - (np.log(self.channels) if self.unit == NATS else 0.0)

    @property
    def steady(self) -> Self:
        """The circuit without courses: its state before the drive begins."""
        return replace(self, courses=()) if self.courses else self

    @cached_property
    def unlesioned(self) -> Self:
        """The circuit with every lesion and cut undone; compensated biases stay."""
        rows = tuple(replace(p, **WHOLE) for p in self.populations)
        paths = tuple(replace(p, intact=1.0, intact_by_channel=()) for p in self.projections)
        return replace(self, populations=rows, projections=paths, chronic=False)
