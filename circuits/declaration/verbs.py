"""Edits of a circuit: methods that return a new circuit and leave the old one unchanged.

Edits that need a fixed point, such as compensation, are in ``circuits.circuit``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from typing import Any, Self

from circuits.checks import check_channel, check_channels, check_positive, check_range
from circuits.declaration.courses import Course
from circuits.declaration.edits import Edit, Edits
from circuits.declaration.row_edits import changed_rows, naming, with_fields
from circuits.declaration.rows import OF_CELLS, OF_TIME, Population, Projection
from circuits.declaration.table import EDITED, CircuitTable
from circuits.errors import EditWarning, InputError, shown

NOT_COMPUTED = (*OF_CELLS, *OF_TIME, "synapse", "cite", "cite_more", "published_hz")
"""Fields of rows that do not affect the fixed point."""
BY_CHANNEL = {"weight": "factors", "intact": "intact_by_channel"}
"""Fields of a pathway, and the factors on them in each target channel."""


class EditableTable(CircuitTable):
    """A table with methods that edit it."""

    def with_population(self, name: str, /, **fields: object) -> Self:
        """Return the circuit with fields of a population changed: ``bias_nats=-2.3``."""
        return self._with(with_fields(self.population(name), fields, name))

    def with_cell(self, name: str, /, **constants: object) -> Self:
        """Return the circuit with constants of a population's cells changed: ``cv=0.2``."""
        cell = with_fields(self.population(name).cell, constants, f"the cell of {name}")
        return self.with_population(name, cell=cell)

    def with_projection(self, name: str, /, **fields: object) -> Self:
        """Return the circuit with fields of a projection changed: ``delay_ms=4``."""
        row = self.projection(name)
        return self._with(with_fields(row, fields, row.name), names=[row.name])

    def set(self, field: str, value: object) -> Self:
        """Return the circuit with one field of a row, or of its cells, set to a new value.

        Parameters
        ----------
        field : str
            ``"STN.bias_nats"``, ``"STN.cell.cv"`` or ``"STN->GPe.delay_ms"``.
        value : number, str or sequence
            Its new value.

        Raises
        ------
        ValueError
            For an unknown row or field (the message lists the known ones), or an invalid value.
        """
        text = ",".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)
        return self._set(Edits([f"set {field}={text}"]).parsed())

    def _set(self, edits: Sequence[Edit]) -> Self:
        rows = changed_rows(self, edits)
        with naming(*(edit.text for edit in edits)):
            return self._with(*rows.values(), names=rows)

    def lesion(self, name: str, fraction: float = 1.0, *, channel: int | None = None) -> Self:
        """Return the circuit with a fraction of a nucleus lesioned.

        All of its output is scaled, including its tone. The lesioned cells are still simulated and
        shown, but have no effect. Scaling all pathways of a nucleus to 0 is less: see ``scale``.

        Repeated lesions of a nucleus compound, as do clamps, cuts and factors of ``scale``: each
        applies to what is left. Two lesions of 10 % leave 81 %. Edits as text (``edited``) may not
        change the same number twice.

        Parameters
        ----------
        name : str
            The nucleus.
        fraction : float
            Fraction lost of what is left, 0..1.
        channel : int, optional
            The channel to lesion; by default all.

        Raises
        ------
        ValueError
            For an unknown nucleus or channel, a fraction out of range, the input or the read-out
            itself, a clamped nucleus, or, in one channel, a pooled nucleus.
        """
        return self._lost(name, fraction, channel, clamped=False)

    def clamp(self, name: str, fraction: float = 1.0, *, channel: int | None = None) -> Self:
        """Return the circuit with a fraction of a nucleus's output held at its resting rate.

        Unlike after a lesion, the targets receive a constant in place of the lost output.
        Parameters and errors are those of ``lesion``.
        """
        return self._lost(name, fraction, channel, clamped=True)

    def _lost(self, name: str, fraction: float, channel: int | None, *, clamped: bool) -> Self:
        row = self.population(name)
        if name in (self.input, self.readout):
            role = "input" if name == self.input else "read-out"
            raise InputError(f"{name} is the {role}: without it there is no decision", "nucleus")
        if (self.intact_of(name) < 1).any() and row.clamped != clamped:
            there = "clamped" if row.clamped else "lesioned"
            reason = f"{name} is already {there}: it can't be both lesioned and clamped"
            raise InputError(reason, "nucleus")
        check_range(0, 1, fraction=fraction)
        if channel is not None and row.pooled:
            none = f"it has no channel {shown(channel)} to lesion, give none"
            reason = f"{name} is pooled, one for all alternatives: {none}"
            raise InputError(reason, "channel")
        if channel is not None:
            check_channel(name, channel, self.channels)
        if fraction == 0:
            return self
        if channel is None:
            return self.with_population(name, intact=row.intact * (1 - fraction), clamped=clamped)
        left = list(row.intact_by_channel or (1.0,) * self.channels)
        left[int(channel)] *= 1 - fraction
        return self.with_population(name, intact_by_channel=tuple(left), clamped=clamped)

    def scale(self, pathway: str, factor: float, channel: int | None = None) -> Self:
        """Return the circuit with the weight of one pathway multiplied by a factor.

        A pathway transmits deviations from its source's ``baseline_hz``; the tone of the baseline
        is part of the target's bias. Scaling to 0 thus removes the source's signal but not its
        tone. ``cut``, the loss of axons, removes both.

        Parameters
        ----------
        pathway : str
            ``"STN->SNr"``, with all its receptors, or ``"STN->SNr NMDA"``.
        factor : float
            At least 0.
        channel : int, optional
            The target's channel in which it is scaled; by default all.

        Raises
        ------
        ValueError
            For an unknown pathway, receptor or channel, a factor below 0, or, in one channel, a
            pathway that is not linear.
        """
        rows = self.pathways(pathway)
        check_range(0, math.inf, factor=factor)
        return self._multiplied(rows, "weight", factor, channel)

    def cut(self, pathway: str, fraction: float = 1.0, channel: int | None = None) -> Self:
        """Return the circuit with a fraction of the axons of one pathway removed, 0..1.

        The target loses both the source's signal and its tone; ``scale`` keeps the tone. Cutting
        all pathways of a nucleus by a fraction is the same as lesioning it by that fraction. Other
        parameters and errors are those of ``scale``; the last pathway from the input to the
        read-out cannot be cut.
        """
        rows = self.pathways(pathway)
        check_range(0, 1, fraction=fraction)
        return self._multiplied(rows, "intact", 1 - fraction, channel)

    def block(self, receptor: str, fraction: float = 1.0, channel: int | None = None) -> Self:
        """Return the circuit with a fraction of receptors blocked, as by an antagonist.

        The target loses the signal and the tone that they transmit, as after ``cut``.

        Parameters
        ----------
        receptor : str
            That of a pathway, ``"STN->SNr NMDA"``, or of all pathways onto a nucleus,
            ``"GPe GABA-A"``.
        fraction : float
            Fraction blocked, 0..1.
        channel : int, optional
            The target's channel in which they are blocked; by default all.

        Raises
        ------
        ValueError
            As ``cut``, and for a receptor that none of the pathways has.
        """
        check_range(0, 1, fraction=fraction)
        place, _, synapse = " ".join(str(receptor).split()).partition(" ")
        _, arrow, target = place.rpartition("->")
        into = self.population(target).name
        onto = [p for p in self.projections if p.target == into]
        rows = self.pathways(place) if arrow else onto
        blocked = [p for p in rows if synapse and p.synapse == synapse]
        if not blocked:
            known = ", ".join(f"{p.name} ({p.synapse or 'none declared'})" for p in rows)
            where = "of" if arrow else "onto"
            raise InputError(
                f"{self.name}: no pathway {where} {place} has the receptor {shown(synapse)}: "
                f"{known or 'there is none'}",
                "synapse",
                synapse,
            )
        return self._multiplied(blocked, "intact", 1 - fraction, channel)

    def _multiplied(
        self, rows: Sequence[Projection], field: str, factor: float, channel: int | None = None
    ) -> Self:
        """Return the circuit with a field of pathways multiplied, or one target channel of it."""
        if channel is not None:
            for row in rows:
                check_channel(row.name, channel, self.channels_of(row.target))
        if factor == 1:
            return self
        new = []
        for row in rows:
            name, value = field, getattr(row, field) * factor
            if channel is not None:
                count, name = self.channels_of(row.target), BY_CHANNEL[field]
                values = list(getattr(row, name) or (1.0,) * count)
                values[int(channel)] *= factor
                value = tuple(values)
            new.append(with_fields(row, {name: value}, row.name))
        return self._with(*new)

    def dopamine(self, level: float) -> Self:
        """Return the circuit at a dopamine level relative to this one; the range is 0..2.

        See ``dopamine_changes``. Courses of dopamine are kept, relative to the new level: the level
        1.2 and a course of +0.5 multiply a weight with D1 receptors by 1.2 and 1.5.

        Warns
        -----
        EditWarning
            If no row of the circuit has a receptor, so that a level has no effect. If the circuit
            was already edited to another level, since two levels do not combine into
            one: 0.9 and 0.8 multiply weights with D1 receptors by 0.72 and those with D2 receptors
            by 1.32. For a level of 0.8, edit the original circuit.
        """
        check_range(0, 2, level=level)
        if level == 1:
            return self
        if self.dopamine_edit != 1:
            EditWarning.warn(
                f"{self.name} was already edited to a dopamine level of {self.dopamine_edit:g}: "
                "further levels are relative to that, and two do not combine into one. For an "
                "absolute level, edit the circuit from before that edit"
            )
        if not self.receptors():
            EditWarning.warn(f"no row of {self.name} has a receptor: dopamine has no effect")
        circuit = replace(self, dopamine_edit=level)
        for p, change, nats in self.dopamine_changes(level):
            bias = circuit.population(p.target).bias_nats + nats
            circuit = circuit._multiplied([p], "weight", 1 + change)
            circuit = circuit.with_population(p.target, bias_nats=bias)
        return circuit

    def with_channels(self, channels: int) -> Self:
        """Return the circuit for another number of alternatives.

        The default gain and the largest lead, measured for the old number, are dropped.
        """
        check_channels(channels)
        same = channels == self.channels
        return self._edited(
            channels=channels,
            default_gain=self.default_gain if same else None,
            max_lead_nats=self.max_lead_nats if same else math.inf,
        )

    def with_neurons(self, neurons: int) -> Self:
        """Return the circuit with another number of cells in every spiking population.

        This and the next two methods raise ValueError if there are no spiking populations.
        """
        return self._everywhere(neurons=neurons)

    def with_neurons_times(self, factor: float) -> Self:
        """Return the circuit with cell counts multiplied by ``factor`` and rounded."""
        check_positive(factor=factor)
        rows = tuple(
            replace(p, neurons=max(1, round(p.neurons * factor))) if p.spiking else p
            for p in self.populations
        )
        return self._edited(populations=rows)

    def with_heterogeneity(self, heterogeneity: float) -> Self:
        """Return the circuit with heterogeneous cells in every spiking population."""
        return self._everywhere(heterogeneity=heterogeneity)

    def with_connections(self, probability: float) -> Self:
        """Return the circuit with sparse connections, of fixed in-degree, between spiking cells.

        Nonlinear pathways stay dense, because their transfer acts on the sum over all cells.
        """
        between = [p for p in self.projections if p.transfer == "linear" and self.joins_cells(p)]
        if not between:
            raise InputError(f"{self.name} has no pathway between cells that spike", "probability")
        return self._with(*(replace(p, probability=probability) for p in between))

    def with_inputs(self, *names: str) -> Self:
        """Return the circuit with further inputs, one more column of the drive for each.

        Parameters
        ----------
        *names : str
            Nuclei ("STN": all its channels alike), or channels of them ("GPe[0]"). Each receives,
            before its filter, the nats of its column; columns are in the order of the names.

        Raises
        ------
        ValueError
            For an unknown nucleus or channel, the nucleus that the evidence drives, or a place
            named twice.
        """
        return replace(self, more_inputs=names)

    def with_rows(self, *rows: Population | Projection | Course) -> Self:
        """Return the circuit with further rows, of which ``add`` makes one from its fields."""
        for row in rows:
            if not isinstance(row, (Population, Projection, Course)):
                reason = f"a row must be a Population, Projection or Course, got {row!r}"
                raise InputError(reason, "row")
        return self._with_tables(
            self.populations + tuple(row for row in rows if isinstance(row, Population)),
            self.projections + tuple(row for row in rows if isinstance(row, Projection)),
            self.courses + tuple(row for row in rows if isinstance(row, Course)),
        )

    def _with(self, *rows: Population | Projection, names: Iterable[str] = ()) -> Self:
        """Return the circuit with rows in place of those of these names, by default their own."""
        new: dict[str, Any] = dict(zip(names or [row.name for row in rows], rows, strict=True))
        return self._with_tables(
            tuple(new.get(p.name, p) for p in self.populations),
            tuple(new.get(p.name, p) for p in self.projections),
        )

    def _with_tables(
        self,
        populations: tuple[Population, ...],
        projections: tuple[Projection, ...],
        courses: tuple[Course, ...] | None = None,
    ) -> Self:
        """Return the circuit with other tables, or itself if they are the same.

        It stays exact unless a field that affects the fixed point changes. The largest lead, which
        was measured for its delays and time constants, becomes unknown if one of them changes.
        Courses are kept unless others are given.
        """
        tables = populations, projections, self.courses if courses is None else courses
        if tables == (self.populations, self.projections, self.courses):
            return self
        old, new = self.populations + self.projections, populations + projections
        exact = self.exact and [*map(_computes, old)] == [*map(_computes, new)]
        exact = exact and tables[2] == self.courses
        # Rows may be renamed, but stay in their places.
        kept = populations[: len(self.populations)] + projections[: len(self.projections)]
        same = [*map(_times, old)] == [*map(_times, kept)]
        return self._edited(
            populations=populations,
            projections=projections,
            courses=tables[2],
            exact=exact,
            max_lead_nats=self.max_lead_nats if same else math.inf,
        )

    def _edited(self, **changes: Any) -> Self:
        """Return the circuit with fields changed, and marked as edited if they differ."""
        if all(getattr(self, name) == value for name, value in changes.items()):
            return self
        about = EDITED + self.about.removeprefix(EDITED) if self.about else ""
        unedited = self if self.unedited is None else self.unedited
        return replace(self, about=about, unedited=unedited, **changes)

    def _everywhere(self, **values: Any) -> Self:
        if not any(row.spiking for row in self.populations):
            reason = f"{self.name} has no spiking cells: {', '.join(values)} would have no effect"
            raise InputError(reason, "cells")
        rows = tuple(replace(p, **values) if p.spiking else p for p in self.populations)
        return self._edited(populations=rows)


def _computes(row: Population | Projection) -> list[object]:
    """Return the fields of a row that affect the fixed point."""
    return [getattr(row, f.name) for f in fields(row) if f.name not in NOT_COMPUTED]


def _times(row: Population | Projection) -> tuple[float, ...]:
    if isinstance(row, Population):
        return row.tau_ms, getattr(row.cell, "tau_ms", 0.0)
    return row.delay_ms, row.tau_ms
