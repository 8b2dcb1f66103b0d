"""Rows from text: new rows, and rows with changed fields.

A new value must have the field's declared type::

    STN.bias_nats -2.3                  a field of a population
    STN.cell.cv 0.2                     a constant of its cell
    STN.cell Phase                      another type of cell, with its constants as cell.NAME
    STN->GPe.delay_ms 4                 a field of a pathway
    STN->GPe.synapse AMPA               its receptor; the row is then called STN->GPe AMPA
    STN->GPe NMDA.weight 0.3            a field of one receptor of a pathway
    D1.receptor ""                      no value: dopamine does not act on D1 itself

A new row consists of its name and fields. Missing fields take their defaults, or the values of the
row given as ``like``; a row with an amount is a course. A value with blanks needs quotes::

    D1->GPe weight=-0.1 delay_ms=4      a pathway
    D1->GPe like=D1->SNr weight=-0.1    a pathway like another, existing or newly added
    STN->SNr NMDA weight=0.2 tau_ms=100 another receptor of a pathway
    TRN like=STN bias_nats=-1           a population like another, without its lesions
    TRN cell=Phase cell.cv=0.2 gain_hz_per_nat=20 cite="my data"
    dopamine amount=0.5 to_ms=300       a course: of dopamine
    STN amount=0.2 from_ms=100          or of the input of a population
    D2[0] amount=-2 to_ms=400           or of one of its channels
    urgency                             a motif of ``circuits.declaration.motifs``
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import MISSING, fields, replace
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from circuits.cells import CELLS, Cell
from circuits.declaration.courses import DOPAMINE, Course
from circuits.declaration.edits import Edit, row_of
from circuits.declaration.motifs import MOTIFS
from circuits.declaration.rows import WHOLE, Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.errors import InputError, owned, require

Row = Population | Projection
Edited = TypeVar("Edited", Population, Projection, Cell)

A_ROW = 'a new row is its name and FIELD=VALUE, such as "D1->GPe weight=-0.1 delay_ms=4"'
NAMES = ("name", "source", "target")
"""Fields that identify a row; edits cannot change them."""
OF_CELL = "cell."
OF_COURSES = ("amount", "from_ms", "to_ms", "rise_ms", "decay_ms")
"""Fields that mark a new row as a course."""


def with_fields(row: Edited, values: Mapping[str, object], owner: str) -> Edited:
    """Return a row, or a cell, with some fields changed; ``owner`` is its name in messages."""
    cell = type(row.cell) if isinstance(row, Population) else None
    _check_names(values, _names(type(row)), owner, _names(type(row), cell))
    new: Edited = _made(type(row), row, values, owner)
    return new


def changed_rows(circuit: CircuitTable, edits: Sequence[Edit]) -> dict[str, Row]:
    """Return the rows changed by edits that set fields, by their names before the edits.

    All fields of a row are set together, so their order does not matter.
    """
    by_row: dict[str, list[Edit]] = {}
    for edit in edits:
        with naming(edit.text):
            name = circuit.row(edit.row).name
        by_row.setdefault(name, []).append(edit)
    return {name: _changed(circuit.row(name), changes) for name, changes in by_row.items()}


def _changed(row: Row, edits: Sequence[Edit]) -> Row:
    with naming(*(edit.text for edit in edits)):
        return _row(type(row), row, {edit.field: str(edit.value) for edit in edits}, {})


def new_rows(
    circuit: CircuitTable, texts: Sequence[str], more: Mapping[str, object]
) -> list[Row | Course]:
    """Return the rows to add to a circuit.

    A row may be like an existing row or another new row, in any order. A population like a lesioned
    one is itself intact. The name of a motif adds its courses. ``more`` has fields of each.
    """
    known: dict[str, Row] = dict(circuit)
    new: dict[str, tuple[str, dict[str, Any]]] = {}
    read: dict[str, Sequence[Row | Course]] = {}
    for text in texts:
        with naming(text):
            name, values = _new(text)
            new[text] = name, {**more, **values}
            require(not more.keys() & values, "add", "must have each field once", text)
            if name in MOTIFS and not new[text][1]:
                read[text] = MOTIFS[name](circuit)
    while waiting := {text: each for text, each in new.items() if text not in read}:
        names = {name for name, _ in waiting.values()} - known.keys()
        ready = [text for text, (_, each) in waiting.items() if each.get("like") not in names]
        if not ready:
            with naming(*waiting):
                reason = "rows that are like each other say nothing: give one its fields"
                raise InputError(reason, "add")
        for text in ready:
            with naming(text):
                row = _read(circuit, known, *waiting[text])
            read[text] = [row]
            if not isinstance(row, Course):
                known[row.name] = row
    return [row for text in texts for row in read[text]]


def _read(
    circuit: CircuitTable, known: Mapping[str, Row], name: str, given: Mapping[str, Any]
) -> Row | Course:
    if name == DOPAMINE or any(field in OF_COURSES for field in given):
        return _course(name, given)
    if name in known:
        reason = f"{name} already exists: use set, or another name or receptor"
        raise InputError(reason, "add", name)
    source, arrow, target = name.partition(" ")[0].partition("->")
    kind = Projection if arrow else Population
    old, values = given.get("like"), {k: v for k, v in given.items() if k != "like"}
    like = None if old is None else known[old] if old in known else circuit.row(old)
    if like is not None and not isinstance(like, kind):
        raise InputError(f"{name} can't be like {like.name}: one of them is a pathway", "add")
    identity = {"source": source, "target": target} if arrow else {"name": name}
    if like is not None:
        assumed = f"; assumed: {', '.join(values)}" if values else ""
        values.setdefault("cite", f"as {like.name}{assumed}")
        like = replace(like, cite_more="")
    if isinstance(like, Population):
        like = replace(like, **WHOLE, published_hz=())
    return _row(kind, like, values, identity)


def _course(what: str, texts: Mapping[str, Any]) -> Course:
    owner = f"a course of {what}"
    _check_names(texts, [f.name for f in fields(Course) if f.name != "what"], owner)
    course: Course = _made(Course, None, {"what": what, **_typed(Course, texts)}, owner)
    return course


def naming(*edits: str) -> AbstractContextManager[None]:
    """Prefix a ValueError with the edits that it is about."""
    return owned(", ".join(map(repr, edits)), "edits", ValueError)


def _new(text: str) -> tuple[str, dict[str, Any]]:
    tidied = re.sub(r"\s*(->|=)\s*", r"\1", text.strip())  # without blanks around -> and =
    tidied = re.sub(r"^([^\s=\[]+)\s*\[\s*", r"\1[", tidied)
    words = shlex.split(tidied) or [""]
    name = row_of(words)
    words += [f"synapse={receptor}" for receptor in name.split()[1:]]
    pairs = [word.partition("=") for word in words]
    texts: dict[str, Any] = {field: value for field, equals, value in pairs if equals}
    if not name or "=" in name or len(texts) < len(pairs):
        raise InputError(f"{A_ROW}, each field once; or one of {', '.join(MOTIFS)}", "add", text)
    return name, texts


def _row(
    kind: type[Row], old: Row | None, declared: Mapping[str, Any], identity: Mapping[str, str]
) -> Row:
    """Return a row from its fields, some as text; others are those of the old row, if any."""
    owner = "->".join(identity.values()) or (old.name if old else "")
    cell = type(old.cell) if isinstance(old, Population) else None
    made = declared.get("cell")
    if kind is Population and "cell" in declared:
        known = isinstance(made, Cell) or made in CELLS
        require(known, "cell", f"must be one of {', '.join(CELLS)}", made, owner=owner)
        cell = type(made) if isinstance(made, Cell) else CELLS[str(made)]
    _check_names(declared, _names(kind, cell), owner)
    constants = {k.removeprefix(OF_CELL): v for k, v in declared.items() if k.startswith(OF_CELL)}
    texts = {k: v for k, v in declared.items() if k != "cell" and not k.startswith(OF_CELL)}
    values = {**_typed(kind, texts), **identity}
    if isinstance(made, Cell):
        values["cell"] = made
    elif cell:
        kept = old.cell if isinstance(old, Population) and "cell" not in declared else None
        values["cell"] = _made(cell, kept, _typed(cell, constants), f"{owner}: the cell")
    row: Row = _made(kind, old, values, owner)
    return row


def _made(kind: type, old: Any, values: Mapping[str, Any], owner: str) -> Any:
    """Return a dataclass with these values; other fields are the old one's, or defaults."""
    if old is not None:
        return replace(old, **values)
    needed = [f.name for f in fields(kind) if f.default is MISSING and f.name not in values]
    if needed:
        hint = ", or like=ROW" if kind in get_args(Row) else ""
        raise InputError(f"{owner} needs {' and '.join(needed)}{hint}", "add")
    return kind(**values)


def _typed(kind: type, texts: Mapping[str, Any]) -> dict[str, Any]:
    """Convert texts to the types declared by a dataclass; other values stay as they are.

    A text that cannot be converted stays text; the dataclass rejects it and says what it expects.
    """
    # Imported only here, because it takes a tenth of a second.
    from pydantic import TypeAdapter

    types, values = get_type_hints(kind), dict[str, Any](texts)
    for name, text in texts.items():
        with suppress(ValueError):
            if isinstance(text, str):
                values[name] = TypeAdapter(types[name]).validate_python(_parts(types[name], text))
    return values


def _parts(kind: type, text: str) -> object:
    """Prepare a text for pydantic: split tuples, and accept whole numbers written as 1e3."""
    if get_origin(kind) is tuple:
        return text.split(",") if text else []
    return float(text) if kind is int else text


def _names(kind: type, cell: type | None = None) -> list[str]:
    names = [f.name for f in fields(kind) if f.name not in NAMES]
    return names + [OF_CELL + f.name for f in (fields(cell) if cell else ())]


def _check_names(
    names: Iterable[str], valid: Sequence[str], owner: str, shown: Sequence[str] = ()
) -> None:
    for name in names:
        if name not in valid:
            listed = ", ".join(shown or valid) or "there is none"
            raise InputError(f"{owner} has no {name!r}: {listed}", name)
