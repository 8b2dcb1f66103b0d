"""Trial tables as PyDDM and HSSM read them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

MISSING_RT = -999.0
"""What HSSM takes for the time of a response that never came."""


def to_pyddm(
    table: pd.DataFrame, *, upper: str | None = None, conditions: Sequence[str] = ("condition",)
) -> pd.DataFrame:
    """Return trials as ``pyddm.Sample.from_pandas_dataframe(table, "rt", "choice")`` reads them.

    Parameters
    ----------
    table : DataFrame
        As from ``tables.trial_table``, two alternatives.
    upper : str, optional
        Name of the response that is 1, the other one is 0; 1 for correct and 0 for an error if left
        out.
    conditions : names
        Columns that PyDDM shall take for conditions.

    Returns
    -------
    DataFrame
        rt (seconds), choice (0 or 1; both NaN where undecided), and the conditions.

    Raises
    ------
    ValueError
        If a column is absent, ``upper`` is none of two responses, or nobody knows what is correct.
    """
    choice = _coded(table, upper, conditions)
    columns = {"rt": table["rt"].where(choice.notna()), "choice": choice}
    return pd.DataFrame(columns | {name: table[name] for name in conditions})


def to_hssm(
    table: pd.DataFrame, *, upper: str | None = None, conditions: Sequence[str] = ("condition",)
) -> pd.DataFrame:
    """Return trials as ``hssm.HSSM(data=table)`` reads them.

    Parameters
    ----------
    table, upper, conditions :
        As for ``to_pyddm``.

    Returns
    -------
    DataFrame
        participant_id, trial, rt (seconds), response (1 or -1), and the conditions. Where undecided
        rt is -999, which HSSM takes for missing with ``missing_data=True``, and response is -1,
        which it then does not read.

    Raises
    ------
    ValueError
        As ``to_pyddm``.
    """
    choice = _coded(table, upper, ("participant_id", "trial", *conditions))
    columns = {
        "participant_id": table["participant_id"],
        "trial": table["trial"],
        "rt": table["rt"].where(choice.notna(), MISSING_RT),
        "response": np.where(choice == 1, 1, -1),
    }
    return pd.DataFrame(columns | {name: table[name] for name in conditions})


def _coded(table: pd.DataFrame, upper: str | None, needed: Sequence[str]) -> pd.Series:
    """Return 1 or 0 of each trial, NaN where undecided."""
    absent = [c for c in ("rt", "response", "correct", "undecided", *needed) if c not in table]
    if absent:
        raise ValueError(f"the table of trials has no {', '.join(absent)}: {list(table.columns)}")
    decided = ~table["undecided"].astype(bool)
    given = sorted(set(table["response"][decided].astype(str)))
    stated = sorted(set(table["stimulus"].astype(str)) - {""}) if "stimulus" in table else []
    names = sorted({*given, *stated})
    if upper is None:
        # Of more than two alternatives correct and wrong are still two.
        if table["correct"].isna().any():
            raise ValueError("nobody knows what is correct: name the response that is 1 (upper)")
        coded = table["correct"].astype(float)
    else:
        if len(names) > 2 or upper not in names:
            raise ValueError(f"upper must be one of two responses, got {upper!r} of {names}")
        coded = (table["response"].astype(str) == upper).astype(float)
    return coded.where(decided)
