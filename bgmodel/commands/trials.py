"""What commands that write a trial table say of it."""

from __future__ import annotations

import sys

import pandas as pd


def warn_of_trials(table: pd.DataFrame, criterion: str) -> None:
    """Say on stderr if the deadline decided most trials, or if they came before any reading.

    Parameters
    ----------
    table : DataFrame
        As from ``tables.trial_table``.
    criterion : str
        The option that says when to stop, for the advice.
    """
    count = len(table)
    late = int((table["forced"] | table["undecided"]).sum())
    if late > count / 2:
        what = "the deadline decided them" if table["forced"].any() else "they stay undecided"
        print(
            f"bgmodel: {late} of {count} trials never met the threshold, {what}: give more "
            f"readings or a lower {criterion}",
            file=sys.stderr,
        )
    early = int(table["premature"].sum())
    if early > count / 2:
        print(
            f"bgmodel: {early} of {count} trials decided before their first reading, without "
            f"evidence: give a higher {criterion}",
            file=sys.stderr,
        )
