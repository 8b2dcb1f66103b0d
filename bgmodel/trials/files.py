"""Files of tables: yours, those of other tools (PyDDM, HSSM), and the published sets that ship."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.support.files import read_provenance, read_table, unreadable
from bgmodel.support.processes import check_table_memory
from bgmodel.trials.columns import names_of, names_once
from circuits.errors import InputError, require, within

PYDDM = ({"RT": "rt", "choice": "response"}, {"rt": "rt", "choice": "response"})
"""Columns of a sample of PyDDM, by its own default and as exported here."""
OTHER = {"participant": "participant_id"}
"""Columns that are named in short."""
SEPARATORS = {".csv": ",", ".tsv": "\t"}
DECIMAL_SIGN = "is the decimal sign a comma? It must be a point"
HSSM = {"1", "-1"}
"""Responses of HSSM: to the upper and to the lower boundary."""


def read_rows(path: Path) -> pd.DataFrame:
    """Read a table from .csv, .tsv or .parquet; cells of text files are kept as text."""
    if path.suffix == ".parquet":
        return read_table(path)
    if path.suffix not in SEPARATORS:
        raise InputError(
            f"a table is read from .csv, .tsv or .parquet, got {str(path)!r}: save it as .csv",
            "path",
        )
    if not path.is_file():
        raise InputError(f"there is no table {str(path)!r}", "path", path)
    return read_text(path)


def read_text(path: Path, numeric: str | None = None) -> pd.DataFrame:
    """Return a table from .csv or .tsv as text, but for columns that begin with ``numeric``."""
    check_table_memory(path)
    separator = SEPARATORS[path.suffix]
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = csv.reader(stream, delimiter=separator)
            header, first = next(lines, []), next(filter(None, lines), [])
        if not any(header):
            raise InputError("the first line is blank, it must name the columns", "path", path)
        if len(header) == 1 and (other := next((c for c in ";,\t|" if c in header[0]), None)):
            hint = f"write {separator!r} between columns, and a point as the decimal sign"
            raise InputError(f"its columns are separated by {other!r}: {hint}", "path")
        # The name that pandas gives to an unnamed column.
        names = [name or f"Unnamed: {k}" for k, name in enumerate(header)]
        # Later rows must not be longer than the first one, but Pandas drops what it has beyond the
        # header, with a warning alone.
        beyond = [f"beyond {k}" for k in range(len(header), len(first))]
        columns: dict[str, Any] = {"header": 0, "names": [*names, *beyond]} if beyond else {}
        texts = [each for each in (*names, *beyond) if not (numeric and each.startswith(numeric))]
        table: pd.DataFrame = pd.read_csv(
            path, sep=separator, dtype=dict.fromkeys(texts, str), keep_default_na=False,
            index_col=False, low_memory=False, encoding="utf-8-sig", **columns,
        )  # fmt: skip
        if (table[beyond] != "").to_numpy().any():
            raise pd.errors.ParserError
    except pd.errors.ParserError:
        raise InputError(
            f"{str(path)!r}: a row has more cells than the header names ({DECIMAL_SIGN})", "path"
        ) from None
    except (OSError, ValueError, csv.Error) as error:
        raise unreadable(path, error) from None
    try:
        names_once(filter(None, header))
    except InputError as error:
        raise within(path.name, error, "path") from None
    return table.drop(columns=beyond)


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
    codes = names_of(table["response"])
    if set(codes) != HSSM:
        return table
    return table.assign(response=np.where(codes == "1", 1, 0))


SETS = ("roitman_shadlen_2002", "palmer_huk_shadlen_2005", "cavanagh_2011", "pedersen_frank_2020")
STOP_SET = "stop_signal_cnp"
"""The set of stop-signal trials, which are no choices; ``bgmodel.stopping.people`` reads it."""
SIMON_SET = "parkinson_simon_2018"
"""A Simon task of patients on and off medication; its trials without a response have different
deadlines, so that ``read_trials`` does not read it."""
CELLS_SET = "striatum_clicks"
"""Choices by clicks with the spikes of striatal cells, which are in a second table."""
OTHERS = (STOP_SET, SIMON_SET, CELLS_SET)
"""Sets that are no choices with one deadline."""


@dataclass(frozen=True, eq=False)
class Shipped:
    """A published set, with its description."""

    name: str  # As for ``read_trials``.
    # One row per trial: participant_id, trial, rt (s), response (1 or 0), conditions.
    table: pd.DataFrame = field(repr=False)
    columns: dict[str, str]  # descriptions
    strength: str | None  # Column of the signed strength of evidence.
    conditions: tuple[str, ...]
    citation: str
    source: str
    licence: str  # SPDX name.
    licence_file: str  # In the package's folder ``data``; "" where the licence asks for no text.
    note: str

    @property
    def about(self) -> dict[str, Any]:
        """Its name, and the facts to show with it."""
        names = ("name", "citation", "source", "licence", "note")
        return {name: getattr(self, name) for name in names}

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.table)

    @property
    def people(self) -> int:
        """Number of participants, people or monkeys."""
        return int(self.table["participant_id"].nunique())

    def text(self) -> str:
        """Return its size, citation, source, licence and remarks."""
        signed = [] if self.strength is None else [f"{self.strength} (signed)"]
        by = ", ".join([*signed, *self.conditions])
        licence = f" (bgmodel/data/{self.licence_file})" if self.licence_file else ""
        return (
            f"{self.name}: {self.trials} trials of {self.people} participants"
            f"{f', by {by}' if by else ''}\n"
            f"  {self.citation}\n  {self.source}\n  {self.licence}{licence}. {self.note}"
        )


def shipped(names: Sequence[str] = SETS) -> dict[str, Shipped]:
    """Return shipped sets by name, by default those of choices."""
    return {name: _read(name) for name in names}


def listed() -> tuple[str, pd.DataFrame]:
    """Return all shipped sets with their sources, as text and as a table."""
    sets = shipped((*SETS, *OTHERS)).values()
    rows = [{"name": one.name, "trials": one.trials, "participants": one.people,
             "strength": one.strength, "conditions": ", ".join(one.conditions), **one.about}
            for one in sets]  # fmt: skip
    return "\n\n".join(one.text() for one in sets), pd.DataFrame(rows)


def shipped_table(name: str) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return a shipped table, and the description stored in its file."""
    with resources.as_file(resources.files("bgmodel") / "data" / f"{name}.parquet") as path:
        return read_table(path), read_provenance(path)["parameters"]


def _read(name: str) -> Shipped:
    table, about = shipped_table(name)
    about = {"strength": None, "conditions": [], "licence_file": ""} | about
    kept = ("strength", "citation", "source", "licence", "licence_file", "note")
    return Shipped(
        name,
        table,
        columns={str(column): about["columns"][column] for column in table},
        conditions=tuple(about["conditions"]),
        **{field: about[field] for field in kept},
    )
