"""Trial tables, and choices and times of one's own, as PyDDM and HSSM read them.

A choice that the deadline forced crossed no threshold: for these it counts as undecided.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.tables.choices import Choices
from bgmodel.tables.columns import MISSING_RT
from circuits.errors import InputError, require

__all__ = ["MISSING_RT", "to_hssm", "to_pyddm"]

CONDITIONS = ("condition",)
"""Conditions of a trial table."""


def to_pyddm(
    table: pd.DataFrame | Choices,
    *,
    upper: str | None = None,
    conditions: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return trials as ``pyddm.Sample.from_pandas_dataframe(table, "rt", "choice")`` reads them.

    Parameters
    ----------
    table : DataFrame or Choices
        As from ``tables.trial_table``, two alternatives; or as from ``tables.read_choices``.
    upper : str, optional
        Name of the response that is 1, the other one is 0; 1 for correct and 0 for an error if left
        out. Choices are coded already.
    conditions : names, optional
        Columns that PyDDM shall take for conditions; those that are blank everywhere are left out.
        Unless given, "condition", or all conditions of choices.

    Returns
    -------
    DataFrame
        rt (seconds), choice (0 or 1; both NaN where undecided or forced), and the conditions; of
        choices also their strength, and participant_id where there are several participants.

    Raises
    ------
    ValueError
        If a column is absent, ``upper`` is none of two responses or given with choices, or nobody
        knows what is correct.
    """
    if isinstance(table, Choices):
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
    table: pd.DataFrame | Choices,
    *,
    upper: str | None = None,
    conditions: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return trials as ``hssm.HSSM(data=table)`` reads them.

    Parameters
    ----------
    table, upper, conditions :
        As for ``to_pyddm``.

    Returns
    -------
    DataFrame
        participant_id, trial, rt (seconds), response (1 or -1), and the conditions; of choices also
        their strength. Where undecided or forced, or without a response, rt is -999, which HSSM
        takes for missing with ``missing_data=True``, and response is -1, which it then does not
        read.

    Raises
    ------
    ValueError
        As ``to_pyddm``.
    """
    if isinstance(table, Choices):
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


def _own(choices: Choices, upper: str | None, names: Sequence[str] | None) -> dict[str, Any]:
    """Return strength and conditions of choices as columns."""
    if upper is not None:
        raise InputError("choices say already which response is 1: leave upper out", "upper")
    there = [str(name) for name in choices.conditions]
    wanted = there if names is None else list(names)
    absent = [name for name in wanted if name not in there]
    require(not absent, "conditions", f"must be among {', '.join(there) or 'none'}", absent)
    strength = {} if choices.strength is None else {"strength": choices.strength}
    # A column of the same name would take the place of another.
    _check_free(wanted, "participant_id", "trial", "rt", "response", "choice", *strength)
    return strength | {name: choices.conditions[name].to_numpy() for name in wanted}


def _check_free(conditions: Sequence[str], *taken: str) -> None:
    """Raise ValueError for conditions that are called as another column of the result."""
    both = sorted({*taken} & {*conditions})
    if both:
        raise InputError(f"conditions must be other columns than {', '.join(both)}", "conditions")


def _conditions(table: pd.DataFrame, names: Sequence[str]) -> dict[str, pd.Series]:
    """Return the columns of conditions; one that is blank everywhere is none."""
    return {name: table[name] for name in names if (_texts(table[name]) != "").any()}


def _coded(table: pd.DataFrame, upper: str | None, needed: Sequence[str]) -> pd.Series:
    """Return 1 or 0 of each trial, NaN where it met no threshold."""
    wanted = ("rt", "response", "correct", "undecided", "forced", *needed)
    absent = [name for name in wanted if name not in table]
    if absent:
        said = f"{', '.join(absent)}: {list(table.columns)}"
        raise InputError(f"the table of trials has no {said}", "columns")
    _check_free(needed, "rt", "response", "choice")
    met = ~(_truths(table["undecided"]) | _truths(table["forced"]))
    if upper is None:
        # Of more than two alternatives correct and wrong are still two.
        coded = pd.to_numeric(table["correct"], errors="coerce").astype(float)
        if coded[met].isna().any():
            raise InputError("nobody knows what is correct: name the response that is 1", "upper")
    else:
        response, names = _texts(table["response"]), set(_texts(table["response"])[met])
        if "stimulus" in table:
            names |= set(_texts(table["stimulus"])) - {""}
        one_of = f"must be one of two responses {sorted(names)}"
        require(len(names) <= 2 and upper in names, "upper", one_of, upper)
        coded = (response == upper).astype(float)
    return coded.where(met)


def _truths(column: pd.Series) -> pd.Series:
    """Return a column of true and false, be it written as text."""
    found = column.map({True: True, False: False, "True": True, "False": False})
    known = found.notna().all()
    require(known, column.name, "must hold True and False", column.unique()[:5])
    return found.astype(bool)


def _texts(column: pd.Series) -> pd.Series:
    """Return names as text; 1.0 is 1, as a column of numbers with a gap is read, and a gap ''."""
    return column.map(
        lambda name: "" if pd.isna(name) else f"{name:g}" if isinstance(name, float) else str(name)
    )
