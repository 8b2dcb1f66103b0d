"""The edits that turn one circuit into another, and those that an engine does not use."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from circuits.cells import Cell
from circuits.circuit import Circuit
from circuits.declaration.edits import VERBS, Edits
from circuits.declaration.row_edits import NAMES, OF_CELL, Row
from circuits.declaration.rows import Population
from circuits.engines import Engine, engine_of
from circuits.errors import InputError

FOR_READERS = ("cite", "cite_more", "published_hz")
"""Fields that change no run."""


def differences(first: Circuit, second: Circuit) -> Edits:
    """Return edits of the first circuit that give the rows of the second.

    Fields that change no run, such as citations, are left out. Raises InputError if no edits do:
    rows are missing in the second, or the circuits differ in more than rows, such as their input,
    unit or courses.
    """
    edits = Edits(_lines(first, second))
    edited = first.edited(*edits)
    for name in ("channels", "input", "readout", "drive_gain", "reference_nats", "centred", "unit",
                 "readout_tau_ms", "default_gain", "courses"):  # fmt: skip
        if getattr(edited, name) != getattr(second, name):
            reason = f"no edits turn {first.name} into {second.name}: they differ in {name}"
            raise InputError(reason, "second")
    for before, after in zip(_rows(edited), _rows(second), strict=True):
        if before != after:
            reason = f"no edits turn {first.name} into {second.name}: {after.name} differs"
            raise InputError(reason, "second")
    return edits


def _rows(circuit: Circuit) -> list[Row]:
    """Return all rows by name, without what is for readers."""
    rows: list[Row] = [replace(row, published_hz=()) for row in circuit.populations]
    rows += circuit.projections
    rows = [replace(row, cite="", cite_more="") for row in rows]
    return sorted(rows, key=lambda row: row.name)


def _lines(first: Circuit, second: Circuit) -> Iterator[str]:
    old, new = ({row.name: row for row in _rows(one)} for one in (first, second))
    if missing := [name for name in old if name not in new]:
        reason = f"no edits turn {first.name} into {second.name}, which has no {missing[0]}"
        raise InputError(reason, "second")
    for name, row in new.items():
        if name not in old:
            values = (f"{field}={shlex.quote(_text(value))}" for field, value in _values(row, None))
            yield " ".join((f"add {name}", *values))
            continue
        for field, value in _values(row, old[name]):
            yield f"set {name}.{field} {_text(value)}"


def _values(row: Row | Cell, old: Row | Cell | None) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a row that differ from those of another, or from their defaults."""
    for field in fields(row):
        if not field.init or field.name in (*NAMES, "synapse", *FOR_READERS):
            continue
        value = getattr(row, field.name)
        if isinstance(row, Population) and field.name == "cell":
            same = isinstance(old, Population) and type(old.cell) is type(value)
            if not same:
                yield "cell", type(value).__name__
            kept = old.cell if same and isinstance(old, Population) else None
            for name, constant in _values(value, kept):
                yield OF_CELL + name, constant
        elif value != (field.default if old is None else getattr(old, field.name)):
            yield field.name, value


def _text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def check_edits(edits: Edits, engine: Engine | str) -> None:
    """Raise ValueError for an edit of a field that the engine does not use."""
    chosen = engine_of(engine)
    for edit in edits.parsed():
        if chosen.ignores(edit.field or VERBS[edit.verb].changes):
            reason = f"{edit.text!r} has no effect in the {engine} engine"
            raise InputError(f"{reason}: use another engine, such as population", "edits")


def ignored_edits(circuit: Circuit, engine: Engine) -> list[str]:
    """Return the edited fields that the engine does not use, each with its rows, as text."""
    rows: dict[str, list[str]] = {}
    for row, field in _edited_fields(circuit):
        if engine.ignores(field):
            rows.setdefault(field, []).append(row)
    return [f"{field} of {', '.join(names)}" for field, names in rows.items()]


def _edited_fields(circuit: Circuit) -> Iterator[tuple[str, str]]:
    """Yield row and field of every number that differs from the unedited table."""
    table = circuit if circuit.unedited is None else circuit.unedited
    for row in circuit.values():
        old = table.get(row.name, row)
        pairs: list[tuple[str, Any, Any]] = [("", old, row)]
        if isinstance(row, Population) and isinstance(old, Population):
            pairs += [("cell.", old.cell, row.cell)] if type(old.cell) is type(row.cell) else []
        for prefix, was, now in pairs:
            for f in fields(was):
                if getattr(was, f.name) != getattr(now, f.name):
                    yield row.name, prefix + f.name
