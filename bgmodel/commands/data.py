"""The command that lists, shows and writes the shipped data sets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from bgmodel.commands.checks import Shows, check_ending
from bgmodel.support import files
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.tables.shipped import Shipped


@dataclass(frozen=True)
class Data(Shows):
    """List the published data sets that come with the package, or show one of them.

    For one set it prints accuracy and response times of each participant in each condition; for
    sets that are no choices with one deadline, numbers of trials and responses, and median times.

    Examples: bgmodel data; bgmodel data roitman_shadlen_2002;
    bgmodel data cavanagh_2011 --out cavanagh.csv
    """

    name: Positional[str] = ""
    """Name of a set."""
    output: Annotated[Path | None, arg(name="out")] = None
    """File for the set, one row per trial, .parquet or .csv."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tables.shipped import every_set

        sets = every_set()
        known = f"one of {', '.join(sets)}"
        require(not self.name or self.name in sets, "name", f"must be {known}", self.name)
        if self.output is not None:
            check_ending("out", self.output, ".parquet", ".csv")
            if not self.name:
                raise InputError(f"out needs the name of a set: {known}", "out")
        if not self.name:
            self._list(sets)
            return
        self._show(sets[self.name])
        if self.output is not None:
            self._write(sets[self.name], self.output)

    def _list(self, sets: dict[str, Shipped]) -> None:
        """Show all sets."""
        import pandas as pd

        rows = [
            {
                "name": one.name,
                "trials": one.trials,
                "participants": one.people,
                "strength": one.strength,
                "conditions": ", ".join(one.conditions),
                **one.about,
            }
            for one in sets.values()
        ]
        self.show("\n\n".join(_head(one) for one in sets.values()), pd.DataFrame(rows))

    def _show(self, one: Shipped) -> None:
        """Show accuracy and times of a set, or numbers of trials of one that is no choices."""
        from bgmodel.tables.choices import read_choices
        from bgmodel.tables.shipped import SETS
        from bgmodel.tables.statistics import statistics

        about = one.about
        if one.name in SETS:
            choices = read_choices(one.name, strength=one.strength, conditions=one.conditions)
            found = statistics(choices)
            about["checksum"] = choices.checksum
        else:
            times = one.table.groupby(["participant_id", *one.conditions])["rt"]
            found = times.agg(trials="size", responses="count", median_s="median").reset_index()
        columns = "\n".join(f"{name:<16}{meaning}" for name, meaning in one.columns.items())
        shown = found.to_string(index=False, float_format="{:.3f}".format)
        text = f"{_head(one)}\n\n{columns}\n\n{shown}"
        self.show(text, found, columns=one.columns, output=self.output, **about)

    def _write(self, one: Shipped, output: Path) -> None:
        """Write a set, with its source."""
        files.write_table(one.table, output, columns=one.columns, **one.about)
        self.note(f"{one.trials} trials -> {output}")


def _head(one: Shipped) -> str:
    """Return the description and source of a set."""
    signed = [] if one.strength is None else [f"{one.strength} (signed)"]
    by = ", ".join([*signed, *one.conditions])
    text = f" (bgmodel/data/{one.licence_file})" if one.licence_file else ""
    return (
        f"{one.name}: {one.trials} trials of {one.people} participants"
        f"{f', by {by}' if by else ''}\n"
        f"  {one.citation}\n"
        f"  {one.source}\n"
        f"  {one.licence}{text}. {one.note}"
    )
