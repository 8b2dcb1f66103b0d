"""Published sets of choices and times that ship with the package."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import pandas as pd

from bgmodel.support.files import read_provenance, read_table

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


def shipped() -> dict[str, Shipped]:
    """Return the shipped sets of choices by name."""
    return {name: _read(name) for name in SETS}


def every_set() -> dict[str, Shipped]:
    """Return all shipped sets by name: those of choices, then the others."""
    return {name: _read(name) for name in (*SETS, *OTHERS)}


def listed() -> tuple[str, pd.DataFrame]:
    """Return all shipped sets with their sources, as text and as a table."""
    sets = every_set().values()
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
