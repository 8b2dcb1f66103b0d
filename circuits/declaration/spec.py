"""The declaration: a circuit is tables, populations, projections and courses, and edits of them.

Nothing about a pathway is written anywhere else. An edit returns a new circuit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.checks import check_channels, check_number, check_types
from circuits.declaration.courses import DOPAMINE, Course, extremes
from circuits.declaration.edits import VERBS, Edit, Edits
from circuits.declaration.row_edits import changed_rows, naming, new_rows, with_fields
from circuits.declaration.rows import (
    GABA,
    GLUTAMATE,
    PATTERNS,
    RECEPTORS,
    SIGNS,
    WHOLE,
    Population,
    Projection,
)

NOT_WRITTEN = ("unedited",)
"""Fields of a circuit that say where it came from, not what it is: no file and no hash has them."""

NOT_COMPUTED = ("neurons", "spread", "probability", "delay_ms", "tau_ms", "cite")
"""Fields of rows that leave the fixed point as it is."""

EDITED = "edited from: "
"""Prefix of ``about`` once a number of a table has changed: the text describes the original."""

NATS = "nats"
UNITS = (NATS, "salience")
"""Units of a circuit's drive and OUT."""

__all__ = [
    "DOPAMINE", "GABA", "GLUTAMATE", "NATS", "PATTERNS", "UNITS", "Circuit", "Course", "Population",
    "Projection",
]  # fmt: skip

Level = TypeVar("Level", float, Array)
"""A level of dopamine, or one per tick."""


@dataclass(frozen=True)
class Circuit(Mapping[str, "Population | Projection"]):
    """A whole circuit; every engine reads this and nothing else.

    It is a mapping of its rows by name: ``circuit["STN"]`` is a population, ``circuit["STN->GPe"]``
    a projection.

    The evidence enters ``input`` as a drive in nats, one number a channel, that is zero at rest:
    the input is ``drive_gain * (drive + rest_drive)``. The decoded rate of ``readout`` is OUT. In
    a circuit of another ``unit`` drive, OUT and every field whose name ends in nats are in that.

    Parameters
    ----------
    name : str
        What it is called.
    populations, projections : tuple
        The two tables.
    channels : int
        Number of alternatives.
    input, readout : str
        Populations where evidence enters and where OUT is read.
    unit : str
        Of drive and OUT: "nats", or "salience", from which no posterior follows.
    reference_nats : float
        ``S = ln sum exp y`` at rest; of another unit than nats, each channel's input at rest.
    default_gain : float, optional
        Nats of drive per nat of evidence that the circuit was made with; none if that is not known.
    drive_gain : float
        Factor on the drive that keeps OUT in nats.
    readout_tau_ms : float
        Low-pass of the read-out, ms.
    exact : bool
        Whether its fixed point claims to be ``-ln P``; an edit of a weight takes the claim away.
    range_nats : tuple of float
        Lowest and highest ``S`` (of another unit than nats, input) at which the circuit works.
    readable_nats : tuple of float
        Lowest and highest OUT that the read-out's rate stands for.
    centred : bool
        Whether the mean of the drive over channels must be taken off before it enters. A circuit
        that cancels what channels have in common does without: each channel gets its own evidence.
    reach_nats : float
        How far below the leader's drive another channel's may fall: a silent cell cannot fall
        further. The leader's OUT changes by at most ``ln(1 + (channels - 1) exp(-reach))``.
    most_lead_nats : float
        Largest mean lead, nats of drive, that one channel may gain over the mean of the others per
        100 ms, or per reading where readings are further apart. Beyond it decisions come late or
        never. Infinite where it was not measured.
    most_channels : int
        Most alternatives for which the circuit has a state of rest.
    wiring_seed : int
        Key of what differs from cell to cell: connections and spread.
    chronic : bool
        Whether lesions are old: the circuit starts at its own rest, not at that of the intact one.
    courses : tuple
        The third table: what changes within a trial. Most circuits have none.
    about : str
        One sentence with its source, of the table before any edit: an edited one begins with
        ``EDITED``. It is no part of what makes two circuits equal.
    unedited : Circuit, optional
        The table before its edits, which set it. It is no part of what makes two circuits equal,
        and no file keeps it.
    """

    name: str
    populations: tuple[Population, ...]
    projections: tuple[Projection, ...]
    channels: int = 2
    input: str = "ctx"
    readout: str = "SNr"
    reference_nats: float = 3.0
    drive_gain: float = 1.0
    readout_tau_ms: float = 0.0
    exact: bool = False
    range_nats: tuple[float, float] = (0.0, math.inf)
    readable_nats: tuple[float, float] = (0.0, math.inf)
    centred: bool = True
    reach_nats: float = math.inf
    most_lead_nats: float = math.inf
    most_channels: int = 1000
    wiring_seed: int = 0
    courses: tuple[Course, ...] = ()
    about: str = field(default="", compare=False)
    unit: str = NATS
    default_gain: float | None = None
    chronic: bool = False
    unedited: Circuit | None = field(default=None, repr=False, compare=False)
    _known: dict[str, Population] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        check_types(self, str(self.name))
        self._check_rows()
        object.__setattr__(self, "_known", {p.name: p for p in self.populations})
        if len(self._known) != len(self.populations):
            raise ValueError(f"{self.name}: two populations have one name")
        if len({p.name for p in self.projections}) != len(self.projections):
            raise ValueError(f"{self.name}: two projections join the same populations")
        check_channels(self.channels)
        object.__setattr__(self, "channels", int(self.channels))
        if self.channels > self.most_channels:
            raise ValueError(
                f"{self.name} takes at most {self.most_channels} alternatives, got {self.channels}"
            )
        self._check_numbers()
        self._check_unit()
        for row in self.populations:
            if row.intact_by_channel and len(row.intact_by_channel) != self.channels_of(row.name):
                raise ValueError(
                    f"{row.name}: intact_by_channel needs one number for each of "
                    f"{self.channels_of(row.name)} channels, got {len(row.intact_by_channel)}"
                )
        for p in self.projections:
            self._check_projection(p)
        self._reaches()
        self._check_courses()

    def __repr__(self) -> str:
        """Return one line: the tables are long, ``circuits.show.text`` prints them."""
        from circuits.declaration.table_files import digest  # reads this module

        own = (row for row in self.populations if row.spiking and not row.pooled)
        return (
            f"Circuit({self.name}: {self.channels} channels in {self.unit}, "
            f"{len(self.populations)} populations, {len(self.projections)} pathways, "
            f"{f'{len(self.courses)} courses, ' if self.courses else ''}"
            f"{sum(row.neurons for row in own)} cells per channel, sha256 {digest(self)[:8]})"
        )

    def _repr_html_(self) -> str:
        """Return both tables, for a notebook."""
        from circuits.show import html

        return html(self)

    def _check_rows(self) -> None:
        tables: tuple[tuple[type, tuple[object, ...]], ...] = (
            (Population, self.populations),
            (Projection, self.projections),
            (Course, self.courses),
        )
        for kind, rows in tables:
            for row in rows:
                if not isinstance(row, kind):
                    raise ValueError(f"{self.name}: a row must be a {kind.__name__}, got {row!r}")

    def _check_projection(self, p: Projection) -> None:
        """Refuse a weight of the wrong sign, and numbers for other channels than the target's."""
        channels = self.channels_of(p.target)
        what = self.population(p.source).transmitter
        if p.weight * SIGNS[what] < 0:
            raise ValueError(
                f"{p.name}: {p.source} releases {what}, so the weight must be "
                f"{'>=' if SIGNS[what] > 0 else '<='} 0, got {p.weight}"
            )
        for name in ("factors", "intact_by_channel"):
            count = len(getattr(p, name))
            if count not in (0, channels):
                raise ValueError(
                    f"{p.name}: {name} must hold one number for each of {channels} channels, got "
                    f"{count}"
                )

    def _check_numbers(self) -> None:
        for name in ("reach_nats", "most_lead_nats"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be > 0, got {getattr(self, name)}")
        if not 0 <= self.readout_tau_ms < math.inf:
            raise ValueError(f"readout_tau_ms must be >= 0, got {self.readout_tau_ms}")
        for name in ("range_nats", "readable_nats"):
            if any(map(math.isnan, getattr(self, name))):
                raise ValueError(f"{name} must be two numbers, got {getattr(self, name)}")
            if sorted(getattr(self, name)) != list(getattr(self, name)):
                raise ValueError(f"{name} must rise, got {getattr(self, name)}")
        for name in ("reference_nats", "drive_gain"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite, got {getattr(self, name)}")

    def _check_unit(self) -> None:
        if self.unit not in UNITS:
            raise ValueError(f"unit must be one of {', '.join(UNITS)}, got {self.unit!r}")
        if self.exact:
            self.check_nats("exact, OUT = -ln P,")
        if self.default_gain is not None and not 0 < self.default_gain < math.inf:
            raise ValueError(f"default_gain must be > 0 and finite, got {self.default_gain}")

    def _check_courses(self) -> None:
        """Refuse a course of nothing, and one that takes dopamine out of its range."""
        for row in self.courses:
            if row.what not in (DOPAMINE, *self._known):
                names = ", ".join(self._known)
                raise ValueError(
                    f"{row.name}: {self.name} has no nucleus {row.what!r}: a course is of "
                    f"{DOPAMINE}, {names}"
                )
        rows = [row for row in self.courses if row.what == DOPAMINE]
        if not rows:
            return
        if DOPAMINE in self._known:
            raise ValueError(f"{rows[0].name}: a nucleus of {self.name} has that name too")
        if not self.receptors():
            raise ValueError(
                f"{rows[0].name}: no row of {self.name} has a receptor, it would change nothing"
            )
        self.dopamine_changes(1.0)
        for moved, time_ms in extremes(rows):
            if not -1 <= moved <= 1:
                at = np.array([time_ms])
                there = [row for row in rows if float(row.at(at)[0]) * moved > 0]
                raise ValueError(
                    f"{max(there, key=lambda row: row.from_ms).name}: the level of dopamine must "
                    f"lie in 0..2, with this row it is {1 + moved:.3g} at {time_ms:.4g} ms"
                )

    def check_steady(self, what: str) -> None:
        """Raise ValueError, in a circuit with courses, for what knows no time."""
        if self.courses:
            raise ValueError(
                f"{self.name} has courses, and {what} knows no time: take circuit.steady, the "
                "circuit without them, or circuit.dopamine(level) for a level that stays"
            )

    def check_nats(self, what: str, instead: str = "") -> None:
        """Raise ValueError, in a circuit of another unit, for what has a meaning in nats alone."""
        if self.unit != NATS:
            raise ValueError(
                f"{self.name} works in {self.unit}, not nats: {what} has no meaning there{instead}"
            )

    @property
    def rest_drive(self) -> float:
        """What the input adds to the drive of each channel: its input at rest."""
        return self.reference_nats - (np.log(self.channels) if self.unit == NATS else 0.0)

    def population(self, name: str) -> Population:
        """Return a row by name.

        Raises
        ------
        ValueError
            If there is none, with the names that there are.
        """
        if not isinstance(name, str) or name not in self._known:
            raise ValueError(f"{self.name} has no nucleus {name!r}: {', '.join(self._known)}")
        return self._known[name]

    def projection(self, source: str, target: str) -> Projection:
        """Return a row by its two ends; raises ValueError with the valid names."""
        for p in self.projections:
            if (p.source, p.target) == (source, target):
                return p
        valid = ", ".join(p.name for p in self.projections)
        raise ValueError(f"{self.name} has no pathway {source}->{target}: {valid}")

    def row(self, name: str) -> Population | Projection:
        """Return a population, ``"STN"``, or a projection, ``"STN->GPe"``, by its name."""
        if not isinstance(name, str) or "->" not in name:
            return self.population(name)
        source, _, target = name.partition("->")
        return self.projection(source, target)

    def __getitem__(self, name: str) -> Population | Projection:
        """Return a row by its name; KeyError with the names that there are."""
        try:
            return self.row(name)
        except ValueError as error:
            raise KeyError(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        """Go through the names of populations, then of projections."""
        yield from (row.name for row in self.populations)
        yield from (row.name for row in self.projections)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.populations) + len(self.projections)

    def channels_of(self, name: str) -> int:
        """Return how many channels a population has."""
        return 1 if self.population(name).pooled else self.channels

    def intact_of(self, name: str) -> Array:
        """Return the surviving fraction of a population, (its channels,)."""
        row = self.population(name)
        left = row.intact_by_channel or (1.0,) * self.channels_of(name)
        return row.intact * np.array(left, dtype=np.float64)

    def axons_of(self, p: Projection) -> Array:
        """Return the fraction of a pathway's axons that survives, (target channels,)."""
        left = p.intact_by_channel or (1.0,) * self.channels_of(p.target)
        return p.intact * np.array(left, dtype=np.float64)

    def spiking(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return names of populations; ValueError for one whose cells do not spike."""
        for name in (chosen := tuple(names)):
            if not self.population(name).spiking:
                raise ValueError(f"{name} has no cells that spike")
        return chosen

    def pattern(self, p: Projection) -> npt.NDArray[np.float64]:
        """Return which channels reach which, (target channels, source channels), factors included.

        Factors go in here and nowhere else: the pathway is linear, so they are factors on its
        weight.
        """
        pattern = PATTERNS[p.pattern](self.channels_of(p.target), self.channels_of(p.source))
        return np.asarray(pattern * np.array(p.factors)[:, None]) if p.factors else pattern

    # ---- edits: each returns a new circuit

    def with_population(self, name: str, /, **fields: object) -> Circuit:
        """Return the circuit with fields of a population changed: ``bias_nats=-2.3``."""
        return self._with(with_fields(self.population(name), fields, name))

    def with_cell(self, name: str, /, **constants: object) -> Circuit:
        """Return the circuit with constants of a population's cells changed: ``cv=0.2``."""
        cell = with_fields(self.population(name).cell, constants, f"the cell of {name}")
        return self.with_population(name, cell=cell)

    def with_projection(self, source: str, target: str, /, **fields: object) -> Circuit:
        """Return the circuit with fields of a projection changed: ``delay_ms=4``."""
        row = self.projection(source, target)
        return self._with(with_fields(row, fields, row.name))

    def set(self, field: str, value: object) -> Circuit:
        """Return the circuit with one field of a row, or of its cells, set to another value.

        Parameters
        ----------
        field : str
            ``"STN.bias_nats"``, ``"STN.cell.cv"`` or ``"STN->GPe.delay_ms"``.
        value : number, str or sequence
            Its new value.

        Raises
        ------
        ValueError
            For an unknown row or field, with those that there are, or an impossible value.
        """
        text = ",".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)
        return self.edited(f"set {field}={text}")

    def edited(self, *lines: str) -> Circuit:
        """Return the circuit with edits that are written as text.

        ``circuit.edited("lesion STN 10%", "set STN->GPe.delay_ms 4", "dopamine 0.9")``: the
        grammar is that of ``circuits.declaration.edits``. The order of the lines does not matter.

        Raises
        ------
        ValueError
            One sentence with the edit as it was written and what is allowed.
        """
        edits = Edits(lines)
        added, keep_rest = edits.of("add"), bool(edits.of("keep"))
        if keep_rest and not added:
            raise ValueError("'keep rest' is for rows that are added: add one")
        circuit = self._called(edits.of("neurons", "connections", "spread"))
        circuit = circuit.add(*(str(edit.value) for edit in added), keep_rest=keep_rest)
        fields = edits.of("set")
        rows = changed_rows(circuit, fields)
        with naming(*(edit.text for edit in fields)):
            circuit = circuit._with(*rows)
        circuit = circuit._called(edits.of("lesion", "clamp", "cut", "scale", "dopamine"))
        if not edits.compensates:
            return circuit
        rebound = {edit.row: float(edit.value) for edit in edits.of("rebound")}
        return circuit.compensate(self, rebound_nats=rebound)

    def _called(self, edits: Iterable[Edit]) -> Circuit:
        """Return the circuit after edits that are made by a method each, one after another."""
        circuit = self
        for edit in edits:
            channel = {} if edit.channel is None else {"channel": edit.channel}
            with naming(edit.text):
                circuit = getattr(circuit, VERBS[edit.verb].method)(*edit.arguments, **channel)
        return circuit

    def lesion(self, name: str, fraction: float = 1.0, *, channel: int | None = None) -> Circuit:
        """Return the circuit with a fraction of a nucleus lesioned.

        Its rate is scaled in all that it reaches, tone included; its own cells are still shown, for
        they go on unheard. So a lesion is more than its pathways scaled: see ``scale``.

        Parameters
        ----------
        name : str
            The nucleus.
        fraction : float
            Lost part, 0..1.
        channel : int, optional
            The channel in which it is lost; all if left out.

        Raises
        ------
        ValueError
            For an unknown nucleus or channel, a fraction out of range, the input or the read-out
            itself, a clamped nucleus, or, in one channel, a pooled nucleus.
        """
        return self._lost(name, fraction, channel, clamped=False)

    def clamp(self, name: str, fraction: float = 1.0, *, channel: int | None = None) -> Circuit:
        """Return the circuit with a fraction of a nucleus's output held at its resting rate.

        It is a lesion after which the targets receive the lost output back as a constant. The
        parameters and errors are those of ``lesion``.
        """
        return self._lost(name, fraction, channel, clamped=True)

    def _lost(self, name: str, fraction: float, channel: int | None, *, clamped: bool) -> Circuit:
        row = self.population(name)
        if name in (self.input, self.readout):
            raise ValueError(
                f"{name} is the {'input' if name == self.input else 'read-out'}: without it "
                "nothing is decided"
            )
        if (self.intact_of(name) < 1).any() and row.clamped != clamped:
            there = "clamped" if row.clamped else "lesioned"
            raise ValueError(f"{name} is {there} already: it can't be both lesioned and clamped")
        check_number("fraction", fraction)
        if not 0 <= fraction <= 1:
            raise ValueError(f"fraction must lie in 0..1, got {fraction}")
        if channel is not None:
            self._check_own_channel(row, channel)
        if fraction == 0:
            return self
        if channel is None:
            return self.with_population(name, intact=row.intact * (1 - fraction), clamped=clamped)
        left = list(row.intact_by_channel or (1.0,) * self.channels)
        left[int(channel)] *= 1 - fraction
        return self.with_population(name, intact_by_channel=tuple(left), clamped=clamped)

    def _check_own_channel(self, row: Population, channel: int) -> None:
        if row.pooled:
            raise ValueError(
                f"{row.name} is pooled, one for all alternatives: it has no channel {channel} to "
                "lesion, give none"
            )
        if channel not in range(self.channels):
            raise ValueError(
                f"{row.name}: channel must lie in 0..{self.channels - 1}, got {channel!r}"
            )

    def compensate(
        self, reference: Circuit | None = None, *, rebound_nats: Mapping[str, float] | None = None
    ) -> Circuit:
        """Return the circuit with every population's own rate at rest as it was before an edit.

        Each population's bias makes good what the edit changed in its input at rest; nothing else
        is changed. ``circuits.laws.homeostasis`` says how, and has the same rule as dynamics.
        Lesions are chronic then.

        Parameters
        ----------
        reference : Circuit, optional
            The circuit before the edits; of a lesioned one, that without lesions.
        rebound_nats : mapping from names to nats, optional
            How far above its old rate, in nats of its own activity, a population comes to rest.

        Raises
        ------
        ValueError
            Without a reference where there is no lesion, for a nucleus that is clamped, an
            unknown population, a rate that a population cannot have, or channels that would need
            different biases.
        """
        from circuits.laws.homeostasis import biases  # reads this module

        rows = [
            replace(self.population(name), bias_nats=bias)
            for name, bias in biases(self, reference, rebound_nats).items()
        ]
        found = self._with(*rows)
        return found if found == found.unlesioned else replace(found, chronic=True)

    def balanced(self, source: str = "STN") -> Circuit:
        """Return the circuit whose read-out does not follow what all channels share.

        The weight from a nucleus that sums them onto the read-out is what changes; recover rates at
        rest afterwards. ``circuits.laws.homeostasis`` has the rule.

        Parameters
        ----------
        source : str
            The nucleus.

        Raises
        ------
        ValueError
            If there is no such pathway, it is none that a rule could act on, or no weight of its
            sign will do.
        """
        from circuits.laws.homeostasis import balanced_weight  # reads this module

        weight = balanced_weight(self, source)
        return self.with_projection(source, self.readout, weight=weight)

    def scale(self, source: str, target: str, factor: float, channel: int | None = None) -> Circuit:
        """Return the circuit with the weight of one pathway multiplied by a factor.

        A pathway carries the change from its source's ``baseline_hz``, whose tone the table takes
        to be in the target's bias: scaled to 0 it takes what the source signals, not its tone. Of
        axons that are lost both go: ``cut``.

        Parameters
        ----------
        source, target : str
            The two ends of the pathway.
        factor : float
            At least 0.
        channel : int, optional
            The target's channel in which it is scaled; all if left out.

        Raises
        ------
        ValueError
            For an unknown pathway or channel, a factor below 0, or, in one channel, a pathway that
            is not linear.
        """
        row = self.projection(source, target)
        check_number("factor", factor)
        if not 0 <= factor < math.inf:
            raise ValueError(f"factor must be >= 0, got {factor}")
        if channel is None:
            return self.with_projection(source, target, weight=row.weight * factor)
        return self._multiplied(row, "factors", factor, channel)

    def cut(
        self, source: str, target: str, fraction: float = 1.0, channel: int | None = None
    ) -> Circuit:
        """Return the circuit without a fraction of the axons of one pathway.

        The target lacks what these carried: what the source signals, and its tone. ``scale``
        leaves the tone. A nucleus all of whose pathways are cut by a fraction is lesioned by it.

        Parameters
        ----------
        source, target : str
            The two ends of the pathway.
        fraction : float
            What is lost, 0..1.
        channel : int, optional
            The target's channel in which it is lost; all if left out.

        Raises
        ------
        ValueError
            For an unknown pathway or channel, a fraction out of range, or if no pathway is left
            from the input to the read-out.
        """
        row = self.projection(source, target)
        check_number("fraction", fraction)
        if not 0 <= fraction <= 1:
            raise ValueError(f"fraction must lie in 0..1, got {fraction}")
        if channel is None:
            return self.with_projection(source, target, intact=row.intact * (1 - fraction))
        return self._multiplied(row, "intact_by_channel", 1 - fraction, channel)

    def _multiplied(self, row: Projection, field: str, factor: float, channel: int) -> Circuit:
        """Return the circuit with one target channel's number of a pathway multiplied."""
        count = self.channels_of(row.target)
        if channel not in range(count):
            raise ValueError(f"{row.name}: channel must lie in 0..{count - 1}, got {channel!r}")
        if factor == 1:
            return self
        values = list(getattr(row, field) or (1.0,) * count)
        values[int(channel)] *= factor
        return self.with_projection(row.source, row.target, **{field: tuple(values)})

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

    def dopamine(self, level: float) -> Circuit:
        """Return the circuit at a dopamine level relative to this one; the range is 0..2.

        See ``dopamine_changes``. Courses of dopamine stay, relative to what is now the circuit's
        own level: the level 1.2 and a course of +0.5 multiply a weight with D1 receptors by 1.2
        and 1.5.
        """
        check_number("dopamine level", level)
        if not 0 <= level <= 2:
            raise ValueError(f"dopamine level must lie in 0..2, got {level}")
        circuit = self
        for p, change, nats in self.dopamine_changes(level) if level != 1 else ():
            bias = circuit.population(p.target).bias_nats + nats
            circuit = circuit.scale(p.source, p.target, 1 + change)
            circuit = circuit.with_population(p.target, bias_nats=bias)
        return circuit

    def dopamine_changes(self, level: Level) -> list[tuple[Projection, Level, Level]]:
        """Return the changes by a level of dopamine, relative to this circuit's; 1 changes nothing.

        The weight of a pathway with D1 receptors is multiplied by ``level``, with D2 receptors by
        ``2 - level``; see ``receptors``. What it adds at the ``pivot_nats`` stays what it was.

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
            if p.factors and row.pivot_nats:
                raise ValueError(
                    f"{p.name} differs from channel to channel: dopamine about a pivot would "
                    "need a bias for each"
                )
            change = RECEPTORS[row.receptor] * (level - 1)
            found.append((p, change, -(change * p.weight * row.pivot_nats)))
        return found

    def with_channels(self, channels: int) -> Circuit:
        """Return the circuit for another number of alternatives.

        The default gain and the largest lead were measured for one number: neither is kept.
        """
        same = channels == self.channels
        return self._edited(
            channels=channels,
            default_gain=self.default_gain if same else None,
            most_lead_nats=self.most_lead_nats if same else math.inf,
        )

    def with_neurons(self, neurons: int) -> Circuit:
        """Return the circuit with another number of cells in every spiking population.

        This and the next two raise ValueError where there is none: they would change nothing.
        """
        return self._everywhere(neurons=neurons)

    def with_neurons_times(self, factor: float) -> Circuit:
        """Return the circuit with so many times the cells of every spiking population, rounded."""
        check_number("factor", factor)
        if not 0 < factor < math.inf:
            raise ValueError(f"factor must be > 0 and finite, got {factor}")
        rows = tuple(
            replace(p, neurons=max(1, round(p.neurons * factor))) if p.spiking else p
            for p in self.populations
        )
        return self._edited(populations=rows)

    def with_spread(self, spread: float) -> Circuit:
        """Return the circuit with cells that differ by a fraction in every spiking population."""
        return self._everywhere(spread=spread)

    def with_connections(self, probability: float) -> Circuit:
        """Return the circuit with sparse connections, of fixed in-degree, between spiking cells.

        A pathway that bends stays as it is: it is the sum of all that bends.
        """
        between = [
            p.transfer == "linear"
            and all(self.population(end).spiking for end in (p.source, p.target))
            for p in self.projections
        ]
        if not any(between):
            raise ValueError(f"{self.name} has no pathway between cells that spike")
        rows = tuple(
            replace(p, probability=probability) if spikes else p
            for p, spikes in zip(self.projections, between, strict=True)
        )
        return self._edited(projections=rows)

    def add(
        self, *rows: Population | Projection | Course | str, keep_rest: bool = False
    ) -> Circuit:
        """Return the circuit with rows added: a nucleus, a pathway or a course of your own.

        A row may be text: ``"D1->GPe weight=-0.1 delay_ms=4"``, ``"TRN like=STN bias_nats=-1"``,
        ``"dopamine amount=0.5 to_ms=300"``, or the name of a motif, ``"striatal_FSI"``.

        Parameters
        ----------
        *rows : Population, Projection, Course or str
            What is added.
        keep_rest : bool
            Whether the nuclei that were there keep their rates at rest: their biases make good what
            the new rows add to their input, as in ``compensate``.
        """
        for row in rows:
            if not isinstance(row, (Population, Projection, Course, str)):
                raise ValueError(
                    f"a row is a Population, a Projection, a Course or text, got {row!r}"
                )
        new = new_rows(self, rows)
        with naming(*(row for row in rows if isinstance(row, str))):
            found = self._with_tables(
                self.populations + tuple(row for row in new if isinstance(row, Population)),
                self.projections + tuple(row for row in new if isinstance(row, Projection)),
                self.courses + tuple(row for row in new if isinstance(row, Course)),
            )
            if not keep_rest or found == self:
                return found
            return replace(found.compensate(self), chronic=self.chronic)

    @property
    def steady(self) -> Circuit:
        """The circuit without courses: what it is while it settles, before the drive begins."""
        return replace(self, courses=()) if self.courses else self

    @property
    def unlesioned(self) -> Circuit:
        """The circuit with every lesion and cut undone; biases that recovered from one stay."""
        whole: dict[str, Any] = {"intact": 1.0, "intact_by_channel": ()}
        rows = tuple(replace(p, **WHOLE) for p in self.populations)
        paths = tuple(replace(p, **whole) for p in self.projections)
        return replace(self, populations=rows, projections=paths, chronic=False)

    def _with(self, *rows: Population | Projection) -> Circuit:
        """Return the circuit with these rows in place of those of their names."""
        new: dict[str, Any] = {row.name: row for row in rows}
        return self._with_tables(
            tuple(new.get(p.name, p) for p in self.populations),
            tuple(new.get(p.name, p) for p in self.projections),
        )

    def _with_tables(
        self,
        populations: tuple[Population, ...],
        projections: tuple[Projection, ...],
        courses: tuple[Course, ...] | None = None,
    ) -> Circuit:
        """Return the circuit with other tables; itself if they are the same.

        It stays exact if they differ in nothing that a fixed point depends on. The largest lead
        that it follows, measured for its delays and time constants, becomes unknown when one of
        these changes. Courses stay unless others are given.
        """
        tables = populations, projections, self.courses if courses is None else courses
        if tables == (self.populations, self.projections, self.courses):
            return self
        old, new = self.populations + self.projections, populations + projections
        exact = self.exact and [*map(_computes, old)] == [*map(_computes, new)]
        exact = exact and tables[2] == self.courses
        times = {row.name: _times(row) for row in new}
        same = all(times.get(row.name) == _times(row) for row in old)
        return self._edited(
            populations=populations,
            projections=projections,
            courses=tables[2],
            exact=exact,
            most_lead_nats=self.most_lead_nats if same else math.inf,
        )

    def _edited(self, **changes: Any) -> Circuit:
        """Return the circuit with fields changed, and marked as edited if they differ."""
        if all(getattr(self, name) == value for name, value in changes.items()):
            return self
        about = EDITED + self.about.removeprefix(EDITED) if self.about else ""
        unedited = self if self.unedited is None else self.unedited
        return replace(self, about=about, unedited=unedited, **changes)

    def _everywhere(self, **values: Any) -> Circuit:
        if not any(row.spiking for row in self.populations):
            raise ValueError(
                f"{self.name} has no cells that spike: {', '.join(values)} say nothing"
            )
        rows = tuple(replace(p, **values) if p.spiking else p for p in self.populations)
        return self._edited(populations=rows)

    def _reaches(self) -> None:
        """Refuse a circuit whose evidence cannot reach its read-out."""
        for role in ("input", "readout"):
            if getattr(self, role) not in self._known:
                raise ValueError(
                    f"{self.name} has no nucleus {getattr(self, role)!r}: its {role} must be one "
                    f"of {', '.join(self._known)}"
                )
        if self.population(self.input).pooled or self.population(self.readout).pooled:
            raise ValueError(f"{self.input} and {self.readout} need a channel an alternative")
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
            raise ValueError(f"no pathway is left from {self.input} to {self.readout}")


def _computes(row: Population | Projection) -> list[object]:
    """Return the fields of a row that a fixed point depends on."""
    return [getattr(row, f.name) for f in fields(row) if f.name not in NOT_COMPUTED]


def _times(row: Population | Projection) -> tuple[float, ...]:
    """Return the delay and the time constants of a row, ms."""
    if isinstance(row, Population):
        return row.tau_ms, getattr(row.cell, "tau_ms", 0.0)
    return row.delay_ms, row.tau_ms
