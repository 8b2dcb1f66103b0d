"""Rows of a circuit written in columns: the names of the fields once, above the values."""

from __future__ import annotations

from typing import Any, TypeVar

from circuits.declaration.rows import Population, Projection

Row = TypeVar("Row", Population, Projection)
NAMES: dict[type, tuple[str, ...]] = {Population: ("name",), Projection: ("source", "target")}
"""The columns that tell rows apart: every part begins with them."""


def rows(kind: type[Row], *parts: tuple[str | tuple[Any, ...], ...]) -> tuple[Row, ...]:
    """Return the rows of a table in columns.

    Parameters
    ----------
    kind : type
        ``Population`` or ``Projection``.
    *parts : tuples
        The table, in one part or in several that stand below each other. The first entry of a part
        is its header, names of fields between blanks; each other entry is a row of values. The
        first part has all rows; a later one has those that differ from the defaults of its columns.

    Raises
    ------
    ValueError
        If a row has another number of values than its header, a part does not begin with the
        columns that name a row, or a later part has a row that the first has not.
    """
    names = NAMES[kind]
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for number, (header, *lines) in enumerate(parts):
        columns = tuple(str(header).split())
        if columns[: len(names)] != names:
            raise ValueError(f"a part begins with {' '.join(names)}, got {header!r}")
        for line in lines:
            if len(line) != len(columns):
                raise ValueError(f"{line[0]}: {len(columns)} columns, got {len(line)} values")
            key = tuple(line[: len(names)])
            if number and key not in found:
                raise ValueError(f"{header!r} has a row {'->'.join(key)}, the first part has none")
            found.setdefault(key, {}).update(zip(columns, line, strict=True))
    return tuple(kind(**row) for row in found.values())
