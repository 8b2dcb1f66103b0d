"""Users' tables, with cells unchanged."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bgmodel.support.files import read_table, unreadable
from bgmodel.support.memory import check_table_memory
from circuits.errors import InputError

SEPARATORS = {".csv": ",", ".tsv": "\t"}


def read_rows(path: Path) -> pd.DataFrame:
    """Read a table from .csv, .tsv or .parquet; cells of text files are kept as text."""
    if path.suffix == ".parquet":
        return read_table(path)
    if path.suffix not in SEPARATORS:
        raise InputError(f"a table is read from .csv, .tsv or .parquet, got {str(path)!r}", "path")
    if not path.is_file():
        raise InputError(f"there is no table {str(path)!r}", "path", path)
    check_table_memory(path)
    try:
        cells = _cells(path, SEPARATORS[path.suffix])
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from None
    names = [str(name) for name in cells.iloc[0]]
    return cells.iloc[1:].set_axis(names, axis=1)


def separated(separator: str, wanted: str) -> InputError:
    """Return the error for a table with another column separator."""
    hint = f"write {wanted!r} between columns, and a point as the decimal sign"
    return InputError(f"its columns are separated by {separator!r}: {hint}", "path")


def _cells(path: Path, separator: str) -> pd.DataFrame:
    """Return all cells of a file as text; the first row holds the names of the columns."""
    with path.open(encoding="utf-8-sig") as stream:
        header = stream.readline()
    other = [mark for mark in ";,\t|" if mark in header]
    if other and separator not in header:
        raise separated(other[0], separator)
    return pd.read_csv(
        path, sep=separator, header=None, dtype=str, keep_default_na=False, encoding="utf-8-sig"
    )
