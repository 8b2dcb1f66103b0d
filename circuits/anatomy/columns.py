"""Rows of a circuit written in columns: field names once, in a header above the values."""

from __future__ import annotations

from typing import Any, TypeVar

from circuits.declaration.rows import Population, Projection

Row = TypeVar("Row", Population, Projection)
NAMES: dict[type, tuple[str, ...]] = {Population: ("name",), Projection: ("source", "target")}
"""The columns that identify a row; every part begins with them."""


def rows(kind: type[Row], *parts: tuple[str | tuple[Any, ...], ...]) -> tuple[Row, ...]:
    """Return the rows of a table in columns; each part has a header of field names, then its rows.

    The first part contains all rows. Later parts contain only rows that differ from the defaults of
    their columns, and begin with the columns that identify a row.
    """
    names = NAMES[kind]
    by_key: dict[tuple[Any, ...], dict[str, Any]] = {}
    for number, (header, *lines) in enumerate(parts):
        columns = tuple(str(header).split())
        if columns[: len(names)] != names:
            raise ValueError(f"a part must begin with {' '.join(names)}, got {header!r}")
        for line in lines:
            if len(line) != len(columns):
                raise ValueError(f"{line[0]}: {len(columns)} columns, got {len(line)} values")
            key = tuple(line[: len(names)])
            if number and key not in by_key:
                raise ValueError(f"{header!r} has a row {'->'.join(key)}, the first part does not")
            by_key.setdefault(key, {}).update(zip(columns, line, strict=True))
    return tuple(kind(**row) for row in by_key.values())
