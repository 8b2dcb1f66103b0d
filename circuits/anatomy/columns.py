"""Rows of a circuit written in columns: the names of the fields once, above the values."""

from __future__ import annotations

from typing import Any, TypeVar

from circuits.rows import Population, Projection

Row = TypeVar("Row", Population, Projection)


def rows(kind: type[Row], *parts: tuple[str | tuple[Any, ...], ...]) -> tuple[Row, ...]:
    """Return the rows of a table in columns.

    Parameters
    ----------
    kind : type
        ``Population`` or ``Projection``.
    *parts : tuples
        The table, in one part or in several that stand below each other. The first entry of a part
        is its header, names of fields between blanks; each other entry is a row of values. Parts
        have the same rows in the same order, and the same first column.

    Raises
    ------
    ValueError
        If a row has another number of values than its header, or parts differ in their rows.
    """
    found: list[dict[str, Any]] = [{} for _ in parts[0][1:]]
    for header, *lines in parts:
        names = str(header).split()
        if len(lines) != len(found):
            raise ValueError(f"the table has {len(found)} rows, its part {header!r} {len(lines)}")
        for row, line in zip(found, lines, strict=True):
            if len(line) != len(names):
                raise ValueError(f"{line[0]}: {len(names)} columns, got {len(line)} values")
            if row.get(names[0], line[0]) != line[0]:
                raise ValueError(f"{names[0]} is {row[names[0]]!r} in one part, {line[0]!r} below")
            row.update(zip(names, line, strict=True))
    return tuple(kind(**row) for row in found)
