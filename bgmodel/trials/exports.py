"""Export of trial tables, and of choice and response-time data, for PyDDM and HSSM.

A choice forced by the deadline crossed no threshold, and counts as undecided here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.tables.columns import MISSING_RT
from bgmodel.trials.record import Trials
from circuits.errors import InputError, require

__all__ = ["MISSING_RT", "to_hssm", "to_pyddm"]

CONDITIONS = ("condition",)
"""Default conditions of a trial table."""


def to_pyddm(
    table: pd.DataFrame | Trials,
    *,
    upper: str | None = None,
    conditions: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return trials for ``pyddm.Sample.from_pandas_dataframe(table, "rt", "choice")``.

    Parameters
    ----------
    table : DataFrame or Trials
        As from ``tables.trial_table``, two alternatives; or as from ``tables.read_trials``.
    upper : str, optional
        Name of the response that counts as 1, the other being 0; by default 1 is correct and 0 an
        error. Not for choices, which are coded already.
    conditions : names, optional
        Columns to use as conditions, except those that are blank everywhere. By default
        "condition", or all conditions of choices.

    Returns
    -------
    DataFrame
        rt (seconds), choice (0 or 1; both NaN where undecided or forced), and the conditions; of
        choices also their strength, and participant_id if there are several participants.

    Raises
    ------
    ValueError
        If a column is absent, ``upper`` is not one of two responses or is given with choices, or
        it is unknown what is correct.
    """
    if isinstance(table, Trials):
        own = _own(table, upper, conditions)
        if len(table.people()) > 1:
            own = {"participant_id": table.participant, **own}
        coded = np.where(np.isnan(table.rt_s), np.nan, table.response)
        return pd.DataFrame({"rt": table.rt_s, "choice": coded, **own})
    names = CONDITIONS if conditions is None else conditions
    choice = _coded(table, upper, names)
    columns = {"rt": table["rt"].where(choice.notna()), "choice": choice}
    return pd.DataFrame(columns | _conditions(table, names))


def to_hssm(
    table: pd.DataFrame | Trials,
    *,
    upper: str | None = None,
    conditions: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return trials for ``hssm.HSSM(data=table)``.

    Parameters
    ----------
    table, upper, conditions :
        As for ``to_pyddm``.

    Returns
    -------
    DataFrame
        participant_id, trial, rt (seconds), response (1 or -1), and the conditions; of choices also
        their strength. For undecided or forced trials, or without a response, rt is -999, which
        HSSM treats as missing with ``missing_data=True``, and response is -1, which it then
        ignores.

    Raises
    ------
    ValueError
        As for ``to_pyddm``.
    """
    if isinstance(table, Trials):
        own = _own(table, upper, conditions)
        who = pd.Series(table.participant)
        columns = {
            "participant_id": who,
            "trial": who.groupby(who).cumcount(),
            "rt": np.where(np.isnan(table.rt_s), MISSING_RT, table.rt_s),
            "response": np.where(table.response == 1, 1, -1),
        }
        return pd.DataFrame(columns | own)
    names = CONDITIONS if conditions is None else conditions
    choice = _coded(table, upper, ("participant_id", "trial", *names))
    columns = {
        "participant_id": table["participant_id"],
        "trial": table["trial"],
        "rt": table["rt"].where(choice.notna(), MISSING_RT),
        "response": np.where(choice == 1, 1, -1),
    }
    return pd.DataFrame(columns | _conditions(table, names))


def _own(choices: Trials, upper: str | None, names: Sequence[str] | None) -> dict[str, Any]:
    """Return strength and conditions of choices as columns."""
    if upper is not None:
        raise InputError("choices already define which response is 1: leave upper out", "upper")
    there = [str(name) for name in choices.conditions]
    wanted = there if names is None else list(names)
    absent = [name for name in wanted if name not in there]
    require(not absent, "conditions", f"must be among {', '.join(there) or 'none'}", absent)
    strength = {} if choices.strength is None else {"strength": choices.strength}
    # A column of the same name would replace another.
    _check_free(wanted, "participant_id", "trial", "rt", "response", "choice", *strength)
    return strength | {name: choices.conditions[name].to_numpy() for name in wanted}


def _check_free(conditions: Sequence[str], *taken: str) -> None:
    """Raise ValueError for conditions named like another column of the result."""
    both = sorted({*taken} & {*conditions})
    if both:
        raise InputError(f"conditions must be other columns than {', '.join(both)}", "conditions")


def _conditions(table: pd.DataFrame, names: Sequence[str]) -> dict[str, pd.Series]:
    """Return the columns of conditions, except those that are blank everywhere."""
    return {name: table[name] for name in names if (_texts(table[name]) != "").any()}


def _coded(table: pd.DataFrame, upper: str | None, needed: Sequence[str]) -> pd.Series:
    """Return 1 or 0 for each trial, NaN if it met no threshold."""
    wanted = ("rt", "response", "correct", "undecided", "forced", *needed)
    absent = [name for name in wanted if name not in table]
    if absent:
        said = f"{', '.join(absent)}: {list(table.columns)}"
        raise InputError(f"the table of trials has no {said}", "columns")
    _check_free(needed, "rt", "response", "choice")
    met = ~(_truths(table["undecided"]) | _truths(table["forced"]))
    if upper is None:
        # With more than two alternatives, correct and wrong are still two.
        coded = pd.to_numeric(table["correct"], errors="coerce").astype(float)
        if coded[met].isna().any():
            raise InputError("it is unknown what is correct: name the response that is 1", "upper")
    else:
        response, names = _texts(table["response"]), set(_texts(table["response"])[met])
        if "stimulus" in table:
            names |= set(_texts(table["stimulus"])) - {""}
        one_of = f"must be one of two responses {sorted(names)}"
        require(len(names) <= 2 and upper in names, "upper", one_of, upper)
        coded = (response == upper).astype(float)
    return coded.where(met)


def _truths(column: pd.Series) -> pd.Series:
    """Return a column of True and False, also if given as text."""
    found = column.map({True: True, False: False, "True": True, "False": False})
    known = found.notna().all()
    require(known, column.name, "must hold True and False", column.unique()[:5])
    return found.astype(bool)


def _texts(column: pd.Series) -> pd.Series:
    """Return names as text; 1.0 becomes 1 (from columns with gaps), a missing value ''."""
    return column.map(
        lambda name: "" if pd.isna(name) else f"{name:g}" if isinstance(name, float) else str(name)
    )
