"""Writer of circuits as TOML files with tables in columns; ``circuits.table_reader`` reads them.

A file contains one circuit for one number of alternatives, because values may depend on it. Missing
entries take their defaults. The cell of a population is the name of an entry in ``[cells]``, or of
a cell type that needs no constants.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from circuits.cells import CELLS
from circuits.checks import is_bool
from circuits.declaration.courses import Course
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import EDITED, NOT_WRITTEN, CircuitTable
from circuits.errors import InputError
from circuits.store import replacing

FORMAT = 1
"""Version of the file format."""
SUFFIX = ".toml"
TABLES: dict[str, type[Population] | type[Projection] | type[Course]] = {
    "populations": Population,
    "projections": Projection,
    "courses": Course,
}
NOT_HASHED = ("published_hz", "cite_more")
"""Fields of rows for display only, which are not part of the hash."""
SPARE = ("courses",)
"""Tables that are omitted from a file if they are empty."""
LARGE = 1e15
"""Floats of at least this size are not written as whole numbers."""
TYPE = "type"
"""Key under which a cell's type is stored."""


def is_path(name: str | Path) -> bool:
    """Whether a circuit's name is the path of a file."""
    return Path(name).suffix == SUFFIX


def plain(circuit: CircuitTable) -> dict[str, Any]:
    """Return a circuit as plain data: fields of rows and cells that differ from their defaults."""
    contents = {"name": circuit.name, "channels": circuit.channels, **_changed(circuit)}
    for table in TABLES:
        rows = getattr(circuit, table)
        if rows or table not in SPARE:
            contents[table] = [_plain_row(row) for row in rows]
    return contents


def digest(circuit: CircuitTable) -> str:
    """Return the hexadecimal SHA-256 of a circuit's content, the same for equal circuits."""
    held = plain(circuit)
    for table in TABLES:
        for row in held.get(table, ()):
            for name in NOT_HASHED:
                row.pop(name, None)
    if circuit.about:  # the rows already show that the circuit was edited
        held["about"] = circuit.about.removeprefix(EDITED)
    text = json.dumps(_canonical(held), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def identity(circuit: CircuitTable) -> dict[str, str]:
    """Return the name and the hash of an edited circuit, for provenance."""
    return {"name": circuit.name, "sha256": digest(circuit)}


def text(circuit: CircuitTable) -> str:
    """Return a circuit as the text of a file."""
    data = plain(circuit)
    data.setdefault("reference_nats", circuit.reference_nats)
    tables = {name: data.pop(name) for name in TABLES if name in data}
    lines = [
        f"# The circuit {json.dumps(circuit.name)}, sha256 {digest(circuit)} when it was written.",
        "# Each row stands under its columns; a column that is left out has its default.",
        f"format = {FORMAT}",
        *(f"{key} = {_value(value)}" for key, value in data.items()),
    ]
    labels = _labels(circuit)
    if any(label not in CELLS for label in labels.values()):
        lines += ["", "[cells]", *_cell_lines(labels)]
    for row, values in zip(circuit.populations, tables["populations"], strict=True):
        values["cell"] = labels[row.cell]
    for name, columns in tables.items():
        lines += ["", f"[{name}]", *_columns(TABLES[name], columns)]
    return "\n".join(lines) + "\n"


def write(circuit: CircuitTable, path: str | Path) -> Path:
    """Write a circuit to a .toml file, completely or not at all; missing folders are created."""
    path = Path(path)
    if path.suffix != SUFFIX:
        raise InputError(f"a circuit file must end in {SUFFIX}, got {str(path)!r}", "path", path)
    with replacing(path) as partial:
        partial.write_text(text(circuit), encoding="utf-8")
    return path


def _changed(row: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that differ from their defaults, or have none."""
    written = (f for f in fields(row) if f.init and f.name not in NOT_WRITTEN)
    values = ((f, getattr(row, f.name)) for f in written)
    return {f.name: value for f, value in values if value != f.default}


def _plain_row(row: Population | Projection | Course) -> dict[str, Any]:
    values = _changed(row)
    if isinstance(row, Population):
        values["cell"] = {TYPE: type(row.cell).__name__, **_changed(row.cell)}
    return values


def _canonical(value: Any) -> Any:
    """Return plain data in which equal numbers have the same form: 5 and 5.0 are equal."""
    if isinstance(value, Mapping):
        return {key: _canonical(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_canonical(inner) for inner in value]
    if is_bool(value):
        return bool(value)
    if isinstance(value, (str, int)):
        return value
    return int(value) if float(value).is_integer() else float(value)


def _labels(circuit: CircuitTable) -> dict[Any, str]:
    """Return the name of each cell: its type, plus its first nucleus if it has constants."""
    labels: dict[Any, str] = {}
    for row in circuit.populations:
        kind = type(row.cell).__name__
        labels.setdefault(row.cell, f"{kind}_{row.name}" if _changed(row.cell) else kind)
    return labels


def _cell_lines(labels: Mapping[Any, str]) -> list[str]:
    import tomlkit

    named = {tomlkit.key(name).as_string(): cell for cell, name in labels.items()}
    wide = max(map(len, named))
    return [
        f"{name:<{wide}} = {{ {TYPE} = {_value(type(cell).__name__)}"
        + "".join(f", {key} = {_value(value)}" for key, value in _changed(cell).items())
        + " }"
        for name, cell in named.items()
        if _changed(cell)
    ]


def _columns(kind: type, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    known = {f.name: f.default for f in fields(kind)}
    names = [name for name in known if any(name in row for row in rows)]
    cells = [[_value(name) for name in names]]
    cells += [[_value(row.get(name, known[name])) for name in names] for row in rows]
    wide = [max(map(len, column)) + 2 for column in zip(*cells, strict=True)]
    lines = [
        "".join(f"{text + ',':<{w}}" for text, w in zip(row[:-1], wide, strict=False)) + row[-1]
        for row in cells
    ]
    indent = " " * len("columns = ")
    return [
        f"columns = [{lines[0]}]",
        "rows = [",
        *(f"{indent}[{line}]," for line in lines[1:]),
        "]",
    ]


def _value(value: Any) -> str:
    """Return a value as TOML; whole numbers without a decimal point."""
    import tomlkit

    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    large = isinstance(value, float) and abs(value) >= LARGE
    return str(tomlkit.item(float(value) if large else _canonical(value)).as_string())
