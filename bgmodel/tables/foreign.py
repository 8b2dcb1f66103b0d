"""Users' tables: their files, columns of other names, and the frames of PyDDM and HSSM."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.support.files import read_table, unreadable
from bgmodel.support.processes import check_table_memory
from bgmodel.tables.columns import names_once
from circuits.errors import InputError, require

PYDDM = ({"RT": "rt", "choice": "response"}, {"rt": "rt", "choice": "response"})
"""Columns of a sample of PyDDM, by its own default and as exported here."""
OTHER = {"participant": "participant_id"}
"""Columns that are named in short."""
SEPARATORS = {".csv": ",", ".tsv": "\t"}
HSSM = {"1", "-1"}
"""Responses of HSSM: to the upper and to the lower boundary."""


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


def renamed(table: pd.DataFrame, **names: str | None) -> pd.DataFrame:
    """Return a table with our column names, those of PyDDM and responses of HSSM recognised."""
    table = named(table, {name: (OTHER.get(name, name), theirs) for name, theirs in names.items()})
    if names.get("rt") is None and names.get("response") is None:
        table = _of_pyddm(table)
    return _of_hssm(table)


def named(table: pd.DataFrame, options: Mapping[str, tuple[str, str | None]]) -> pd.DataFrame:
    """Return a table with columns renamed: each option maps to our name and the user's, or None."""
    names = names_once(table.columns)
    renaming = {option: pair for option, pair in options.items() if pair[1] is not None}
    for option, (ours, name) in renaming.items():
        there = isinstance(name, str) and name in names
        require(there, option, f"must be one of the columns {', '.join(names)}", name)
        if name != ours and ours in names:
            raise InputError(
                f"{option} is {name!r}, but there is also a column {ours}: remove or rename it",
                option,
            )
    meant = [name for _, name in renaming.values()]
    require(len(set(meant)) == len(meant), "columns", "must be named once each", meant)
    return table.set_axis(names, axis=1).rename(
        columns={str(name): ours for ours, name in renaming.values()}
    )


def _of_pyddm(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with PyDDM's columns renamed, if it has these."""
    names = list(table.columns)
    for columns in PYDDM:
        rest = [name for name in names if name not in columns]
        if set(columns) <= set(names) and not {"rt", "response"} & set(rest):
            return table.rename(columns=columns)
    return table


def _of_hssm(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with responses 0 instead of -1, if all are 1 or -1 and have a time."""
    names = list(table.columns)
    if names.count("rt") != 1 or names.count("response") != 1 or table["rt"].isna().any():
        return table
    codes = table["response"].map(_code)
    if set(codes) != HSSM:
        return table
    return table.assign(response=np.where(codes == "1", 1, 0))


def _code(value: object) -> str:
    """Return a response as text; 1.0 is 1."""
    try:
        number = float(str(value))
    except ValueError:
        return str(value)
    return f"{number:g}"
