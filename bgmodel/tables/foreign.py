"""Tables in other words: columns of other names, and the frames of PyDDM and HSSM."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from bgmodel.tables.columns import names_once
from circuits.errors import InputError, require

PYDDM = ({"RT": "rt", "choice": "response"}, {"rt": "rt", "choice": "response"})
"""Columns of a sample of PyDDM, by its own default and as exported here."""
OTHER = {"participant": "participant_id"}
"""Columns that are named in short."""
HSSM = {"1", "-1"}
"""Responses of HSSM: to the upper and to the lower boundary."""


def renamed(table: pd.DataFrame, **names: str | None) -> pd.DataFrame:
    """Return a table with our column names; ``names`` has the user's, None where they agree.

    A table of PyDDM (RT or rt, and choice) is recognised by its columns if neither rt nor response
    is named, and responses of HSSM (1 and -1) by their values: -1 becomes 0.
    """
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
