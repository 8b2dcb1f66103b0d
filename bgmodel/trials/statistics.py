"""Accuracy and times of choices, in each condition."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bgmodel.trials.record import Trials

QUANTILES = (0.1, 0.5, 0.9)


def statistics(choices: Trials) -> pd.DataFrame:
    """Return accuracy and times of each participant in each condition.

    Parameters
    ----------
    choices : Trials
        The trials.

    Returns
    -------
    DataFrame
        One row per participant, condition and size of the strength: participant_id, the
        conditions, strength (absolute value, if given), trials, missing (trials without a
        response), accuracy (proportion correct, as in ``Trials.correct``; NaN if unknown),
        mean_s, sd_s, q10_s, q50_s and q90_s: mean, standard deviation
        and quantiles of the times of all responses, s.
    """
    table = pd.DataFrame({"participant_id": choices.participant}).join(choices.conditions)
    if choices.strength is not None:
        table["strength"] = np.abs(choices.strength)
    keys = list(table.columns)
    table = table.assign(_time=choices.rt_s, _right=choices.correct, _none=choices.response < 0)
    rows = [
        dict(zip(keys, key, strict=True)) | _row(part)
        for key, part in table.groupby(keys, sort=True)
    ]
    return pd.DataFrame(rows)


def _row(trials: pd.DataFrame) -> dict[str, float]:
    """Return the numbers of one cell of the table."""
    times, quantiles = trials["_time"].dropna(), trials["_time"].quantile(QUANTILES)
    return {
        "trials": len(trials),
        "missing": int(trials["_none"].sum()),
        "accuracy": trials["_right"].mean(),
        "mean_s": times.mean(),
        "sd_s": times.std(),
        **{f"q{100 * q:.0f}_s": quantiles[q] for q in QUANTILES},
    }
