"""Fields of a circuit that an engine does not use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from circuits.circuit import Circuit
from circuits.declaration.edits import VERBS, Edits
from circuits.declaration.rows import Population
from circuits.engines import Engine, engine_of
from circuits.errors import InputError


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
