"""Reader of circuit files, written by ``table_writer`` or by hand; errors name the line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from typing import Any

from circuits.cells import CELLS
from circuits.checks import parsed_toml
from circuits.circuit import Circuit
from circuits.declaration.courses import Course
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import NOT_WRITTEN
from circuits.declaration.table_writer import FORMAT, SPARE, TABLES, TYPE
from circuits.errors import InputError, owned, within

OWN_KEYS = (f.name for f in fields(Circuit) if f.init and f.name not in NOT_WRITTEN)
KEYS = ("format", *OWN_KEYS, "cells")
NEEDED = ("format", "channels", "reference_nats", *(name for name in TABLES if name not in SPARE))
"""Required keys: a default resting input, say, would be meaningless for another table."""


def read(path: str | Path, channels: int | None = None) -> Circuit:
    """Read a circuit from a file written by ``table_writer.write`` or by hand.

    If ``channels`` is given, it must be that of the file. Errors name the file and the line.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{str(path)!r} can't be read as text: {error}", "path") from None
    except OSError as error:
        reason = f"the circuit {str(path)!r} can't be read: {error.strerror}"
        raise InputError(reason, "path") from None
    circuit = parse(text, path.name)
    if channels not in (None, circuit.channels):
        held = f"{path.name} contains a circuit for {circuit.channels} alternatives"
        reason = f"{held}, not {channels}: use {circuit.channels} channels"
        raise InputError(reason, "channels")
    return circuit


def parse(text: str, file: str) -> Circuit:
    """Return the circuit in the text of a file; ``file`` is its name in errors."""
    return _Reader(text, file).circuit(parsed_toml(text, file))


class _Reader:
    """The tables of one file, with the locations that errors name."""

    def __init__(self, text: str, file: str) -> None:
        self.file, self.lines = file, _lines(text)
        self.places: dict[str, str] = {}

    def circuit(self, data: dict[str, Any]) -> Circuit:
        for key in data:
            self._known(self._at("", key), "key", key, KEYS)
        for key in NEEDED:
            if key not in data:
                raise InputError(f"{self.file}: the key {key!r} is missing", key)
        if (form := data.pop("format")) != FORMAT:
            reason = f"{self._at('', 'format')}: the format must be {FORMAT}, got {form!r}"
            raise InputError(reason, "format")
        cells = self._cells(data.pop("cells", {}))
        tables = {name: self._rows(name, data.pop(name), cells) for name in TABLES if name in data}
        self._check_ends(tables)
        settings = {key: _hashable(value) for key, value in data.items()}
        try:
            return Circuit(**{"name": Path(self.file).stem, **settings, **tables})
        except (ValueError, TypeError) as error:
            raise within(self._named_in(str(error)), error, "path") from None

    def _named_in(self, message: str) -> str:
        """Return the location of the row or key that a message begins with, otherwise the file."""
        for name in re.split(r": | must ", message)[:2]:
            if name in self.places:
                return self.places[name]
            if ("", name) in self.lines:
                return self._at("", name)
        return self.file

    def _cells(self, cells: Any) -> dict[str, Any]:
        if not isinstance(cells, dict):
            raise InputError.of("cells", "must be a table", cells, owner=self._at("", "cells"))
        return {name: self._cell(name, one) for name, one in cells.items()}

    def _cell(self, name: str, cell: Any) -> Any:
        where = self._at("cells", name)
        if not isinstance(cell, dict) or TYPE not in cell:
            raise InputError(f'{where}: a cell is {{ type = "Phase", ... }}, got {cell!r}', "cell")
        values = {key: _hashable(value) for key, value in cell.items()}
        kind = values.pop(TYPE)
        self._known(where, "cell type", kind, CELLS)
        for key in values:
            what = f"constant of a {kind} cell"
            self._known(where, what, key, [f.name for f in fields(CELLS[kind]) if f.init])
        if missing := _needed(CELLS[kind], *values):
            raise InputError(f"{where}: a {kind} cell needs {missing}", "cell")
        with owned(where, "row", ValueError, TypeError):
            return CELLS[kind](**values)

    def _rows(self, table: str, contents: Any, cells: Mapping[str, Any]) -> tuple[Any, ...]:
        where = self._at("", table)
        if not isinstance(contents, dict) or set(contents) != {"columns", "rows"}:
            reason = f"{where}: {table} must contain columns and rows, and nothing else"
            raise InputError(reason, table)
        kind, columns, rows = TABLES[table], contents["columns"], contents["rows"]
        for name in ("columns", "rows"):
            if not isinstance(contents[name], list):
                reason = f"{self._at(table, name)}: {name} must be a list in brackets"
                raise InputError(reason, name)
        self._check_columns(table, kind, columns)
        if (table, len(rows)) in self.lines or (rows and (table, len(rows) - 1) not in self.lines):
            # Here rows are not on separate lines, so they are counted instead.
            self.lines = {key: n for key, n in self.lines.items() if isinstance(key[1], str)}
        places = [self._at(table, k) for k in range(len(rows))]
        return tuple(map(partial(self._row, kind, columns, cells), rows, places))

    def _check_columns(self, table: str, kind: type, columns: list[Any]) -> None:
        where = self._at(table, "columns")
        for name in columns:
            self._known(where, f"column of {table}", name, [f.name for f in fields(kind)])
            if columns.count(name) > 1:
                reason = f"{where}: the column {name!r} of {table} appears twice"
                raise InputError(reason, table)
        if missing := _needed(kind, *columns):
            raise InputError(f"{where}: {table} needs the columns {missing}", table)

    def _row(
        self, kind: type, columns: list[str], cells: Mapping[str, Any], row: Any, where: str
    ) -> Any:
        if not isinstance(row, list) or len(row) != len(columns):
            count = len(row) if isinstance(row, list) else "no list of"
            raise InputError(f"{where}: {len(columns)} columns, but {count} values", "row")
        values = {name: _hashable(value) for name, value in zip(columns, row, strict=True)}
        if kind is Population:
            values["cell"] = self._cell_of(values["cell"], cells, where)
        with owned(where, "row", ValueError, TypeError):
            made = kind(**values)
        if made.name in self.places and kind is not Course:
            reason = f"there is already a row {made.name!r}: it needs another name or synapse"
            raise InputError(f"{where}: {reason}", "synapse" if kind is Projection else "row")
        self.places[made.name] = where
        return made

    def _cell_of(self, name: Any, cells: Mapping[str, Any], where: str) -> Any:
        """Return the cell named by a row: an entry of the file, or a type without constants."""
        self._known(where, "cell", name, {**cells, **CELLS})
        if name in cells:
            return cells[name]
        if needs := _needed(CELLS[name]):
            raise InputError(f"{where}: a {name} cell needs {needs}: name it under [cells]", "cell")
        return CELLS[name]()

    def _check_ends(self, tables: Mapping[str, Sequence[Any]]) -> None:
        names = [row.name for row in tables["populations"]]
        for p in tables["projections"]:
            for end in (p.source, p.target):
                self._known(f"{self.places[p.name]}: {p.name}", "nucleus", end, names)

    @staticmethod
    def _known(where: str, what: str, name: Any, known: Any) -> None:
        if not isinstance(name, str) or name not in known:
            names = ", ".join(known)
            reason = f"{where}: there is no {what} {name!r}; there are {names}"
            raise InputError(reason, str(name), name)

    def _at(self, table: str, what: str | int) -> str:
        """Return the file and the line of a key, or of a row by its number."""
        line = self.lines.get((table, what))
        if line is not None:
            return f"{self.file}, line {line}"
        if isinstance(what, int):
            return f"{self.file}, {table}, row {what + 1}"
        return self.file


def _needed(kind: type, *names: str) -> str:
    """Return the fields of a dataclass without a default that are not given, for a message."""
    bare = [f for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]
    return ", ".join(f.name for f in bare if f.init and f.name not in names)


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def _lines(text: str) -> dict[tuple[str, str | int], int]:
    """Return the line number of each key of a table, and of rows that are on separate lines."""
    table, rows, numbers = "", 0, dict[tuple[str, str | int], int]()
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if header := re.match(r"\[\s*([\w.-]+)\s*\]", line):
            table, rows = header[1], 0
            numbers["", table] = number
        elif re.match(r"""\[\s*["']""", line):
            numbers[table, rows] = number
            rows += 1
        elif key := re.match(r"""["']?([\w -]+?)["']?\s*=""", line):
            numbers[table, key[1]] = number
    return numbers
