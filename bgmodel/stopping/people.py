"""Stop-signal trials of people: the set that ships, your own tables, and BIDS events."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from bgmodel.stopping.estimates import estimate_ssrt
from bgmodel.stopping.events import is_events, read_events
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.checks import path_of
from bgmodel.support.files import read_table
from bgmodel.tables.shipped import STOP_SET, shipped_table
from circuits.errors import DataWarning, InputError, collected, require, within

SHIPPED = STOP_SET
"""126 healthy adults, UCLA Consortium for Neuropsychiatric Phenomics (Poldrack et al. 2016)."""
COLUMNS = ("participant_id", "rt", "ssd")
MOST_AT_ZERO, FEWEST_AT_ZERO = 0.9, 5
"""If there are at least 5 stop trials with a delay of 0, and more than 0.9 of them have a response,
these delays are probably missing."""
SLOWEST_S = 20.0
"""Largest median response time and delay, s: longer ones are in ms."""


def read_people(
    table: pd.DataFrame | str | Path = SHIPPED,
    *,
    columns: Mapping[str, str] | None = None,
    restore: bool = False,
) -> dict[str, StopTrials]:
    """Return the stop-signal trials of each participant.

    Parameters
    ----------
    table : DataFrame, path or str
        One row per trial: participant_id, rt and ssd, both in seconds from the go stimulus; rt is
        empty without a response, ssd in go trials. If there are columns ``stimulus`` and
        ``response``, a response is correct where both are equal. A folder, or a file that ends in
        ``_events.tsv``, holds BIDS events: see ``bgmodel.stopping.events``. By default the set that
        ships.
    columns : mapping, optional
        Other names of columns, such as ``{"rt": "RT", "ssd": "delay"}``; in BIDS events also of
        ``trial_type``.
    restore : bool
        Whether delays of 0 will be inferred, so that there is no warning of them.

    Raises
    ------
    ValueError
        If a column is missing, times are in ms, or the trials of a participant are impossible: see
        ``StopTrials``.

    Warns
    -----
    UserWarning
        If nearly all stop trials with a delay of exactly 0 have a response, as in the set that
        ships: see ``bgmodel.stopping.restored``.
    """
    table = _table(table, columns)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        must = f"must have the columns {', '.join(COLUMNS)}"
        raise InputError.of("table", must, list(table.columns))
    for name in ("rt", "ssd"):
        median = float(table[name].median())
        require(not median > SLOWEST_S, name, "must be in seconds", median)
    people = {}
    for who, rows in table.groupby("participant_id", sort=True):
        correct = None
        if {"stimulus", "response"} <= set(table):
            correct = (rows["stimulus"] == rows["response"]).fillna(False).to_numpy(bool)
        rt_ms, ssd_ms = (1000 * rows[name].to_numpy(float) for name in ("rt", "ssd"))
        try:
            people[str(who)] = StopTrials(rt_ms, ssd_ms, correct)
        except InputError as error:
            raise within(f"participant {who}", error, "table") from None
    if not restore:
        _warn_of_zeros(table)
    return people


def _table(table: pd.DataFrame | str | Path, columns: Mapping[str, str] | None) -> pd.DataFrame:
    """Return the rows of a table, of the set that ships, or of BIDS events."""
    if isinstance(table, str) and table == SHIPPED:
        return shipped_table(SHIPPED)[0]
    if not isinstance(table, pd.DataFrame):
        path = path_of(table, "table")
        if is_events(path):
            return read_events(path, columns)
        table = read_table(path)
    return table.rename(columns={theirs: ours for ours, theirs in (columns or {}).items()})


def _warn_of_zeros(table: pd.DataFrame) -> None:
    """Warn if delays of 0 are probably those of signals that came too late to be given."""
    at_zero = table.loc[table["ssd"] == 0, "rt"].notna()
    if len(at_zero) >= FEWEST_AT_ZERO and at_zero.mean() > MOST_AT_ZERO:
        DataWarning.warn(
            f"{at_zero.sum()} of {len(at_zero)} stop trials with a delay of 0 have a response: the "
            "signal was probably not given because the response came first. restored_delays "
            "infers the delays from the staircases"
        )


def estimates_of(people: dict[str, StopTrials]) -> pd.DataFrame:
    """Return the estimates of every participant, one row each.

    Columns participant_id and the fields of ``StopEstimate``; ``refusal`` says why the guide
    accepts no estimate of a participant. It is "no responses on go trials" or "no stop trials"
    where no estimate can be computed.

    Warns
    -----
    UserWarning
        Once, if participants have fewer stop trials than the guide asks for.
    """
    rows, few = [], 0
    for who, trials in people.items():
        with collected(DataWarning) as caught:
            try:
                row = vars(estimate_ssrt(trials, checked=False))
            except InputError as error:
                kind = "no responses on go trials" if error.field == "rt_ms" else "no stop trials"
                row = {"refusal": kind}
        few += bool(caught)
        rows.append({"participant_id": who, **row})
    if few:
        said = f"{few} of {len(people)} participants have too few stop trials"
        DataWarning.warn(f"{said}: their estimates are unreliable, their mean is less so")
    return pd.DataFrame(rows)
