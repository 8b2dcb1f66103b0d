"""Stop-signal trials of people: the set that ships, your own tables, and BIDS events."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.stopping.estimates import estimate_ssrt
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array, Truths
from bgmodel.support.checks import path_of
from bgmodel.tables.cautions import LEAST_RIGHT, people_and_times, warn_of_twins
from bgmodel.tables.columns import code, delays, names_of, silent
from bgmodel.tables.foreign import named
from bgmodel.tables.shipped import STOP_SET, shipped_table
from bgmodel.tables.text_files import read_rows
from bgmodel.trials.events import is_events, read_events
from circuits.errors import DataWarning, InputError, collected, require, within

SHIPPED = STOP_SET
"""126 healthy adults, UCLA Consortium for Neuropsychiatric Phenomics (Poldrack et al. 2016)."""
COLUMNS = ("participant_id", "rt", "ssd", "stimulus", "response")
MOST_AT_ZERO, FEWEST_AT_ZERO = 0.9, 5
"""If there are at least 5 stop trials with a delay of 0, and more than 0.9 of them have a response,
these delays are probably missing."""


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
        empty without a response, ssd in go trials; without participant_id all trials belong to one,
        "all". A response is correct where a column ``correct`` is 1 rather than 0, or else where
        ``stimulus`` and ``response`` are equal, if there are these columns. A folder, or a
        file that ends in ``_events.tsv``, holds BIDS events: see ``bgmodel.trials.events``. By
        default the set that ships.
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
    name, table = _table(table, columns or {})
    try:
        who, rt_s = people_and_times(table, ["rt", "ssd"], ["ssd"])
        ssd_s, correct = delays(table["ssd"]), _correct(table, rt_s)
        warn_of_twins(who, rt_s, np.isnan(ssd_s).astype(np.int8))
        people = {}
        for each in np.unique(who).tolist():
            own = who == each
            right = None if correct is None else correct[own]
            try:
                people[each] = StopTrials(1000 * rt_s[own], 1000 * ssd_s[own], right)
            except InputError as error:
                raise within(f"participant {each}", error, "table") from None
    except ValueError as error:
        raise within(name, error, "table") from None
    if not restore:
        _warn_of_zeros(rt_s, ssd_s)
    return people


def _table(
    table: pd.DataFrame | str | Path, columns: Mapping[str, str]
) -> tuple[str, pd.DataFrame]:
    """Return the name and the rows of a table, of the set that ships, or of BIDS events."""
    if isinstance(table, str) and table == SHIPPED:
        return table, shipped_table(SHIPPED)[0]
    if isinstance(table, pd.DataFrame):
        name, rows = "a table", table.reset_index(drop=True)
    else:
        path = path_of(table, "table")
        if is_events(path):
            return path.name, read_events(path, columns)
        name, rows = path.name, read_rows(path).reset_index(drop=True)
    unknown = sorted({*columns} - {*COLUMNS})
    require(not unknown, "columns", f"must name columns of {', '.join(COLUMNS)}", unknown)
    return name, named(rows, {ours: (ours, theirs) for ours, theirs in columns.items()})


def _correct(table: pd.DataFrame, rt_s: Array) -> Truths | None:
    """Return which responses are correct; None if the table does not say which are right."""
    if "correct" in table:
        return np.asarray(code(table["correct"]) == 1)
    if not {"stimulus", "response"} <= set(table):
        return None
    stimulus, response = (names_of(table[name]) for name in ("stimulus", "response"))
    correct = np.asarray(stimulus == response) & ~silent(table[["rt", "response"]])
    answered = np.isfinite(rt_s)
    share = float(correct[answered].mean()) if answered.any() else 1.0
    if share < LEAST_RIGHT:
        DataWarning.warn(
            f"{share:.0%} of responses are correct, equal to the stimulus: are both columns in "
            f"the same words? Responses are {_some(response[answered])}, stimuli {_some(stimulus)}"
        )
    return correct


def _some(names: npt.NDArray[np.object_]) -> str:
    return ", ".join(sorted({str(name) for name in names})[:4])


def _warn_of_zeros(rt_s: Array, ssd_s: Array) -> None:
    """Warn if delays of 0 are probably those of signals that came too late to be given."""
    at_zero = np.isfinite(rt_s[ssd_s == 0])
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
