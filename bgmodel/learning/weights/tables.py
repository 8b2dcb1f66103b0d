"""Features from a user's table, one row per reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from bgmodel.learning.weights.features import Features, check_learnable
from bgmodel.support.arrays import Array, Integers
from bgmodel.tables.columns import check_numeric, names_once
from bgmodel.tables.evidence import trials_from_table
from circuits.errors import InputError, require

PREFIX = "feature_"


def features_from_table(
    table: pd.DataFrame, *, step_ms: float, hypotheses: Sequence[str] | None = None
) -> Features:
    """Return the features of a user's table, one row per reading.

    Columns: ``trial``; ``step``, from 0 or 1 in each trial; ``truth``, a name; two or more
    ``feature_<name>``, activities of units; and optionally ``ll_<hypothesis>``, exact
    log-likelihoods for comparison. ``hypotheses`` are in the order of their channels, by default
    that of the ``ll_`` columns, or the names in ``truth``, sorted. A unit that is never active
    raises.
    """
    named = names_once(table.columns)
    units = [name for name in named if name.startswith(PREFIX) and name != PREFIX]
    if len(units) < 2 or "truth" not in named:
        must = "trial, step, truth and at least two feature_<name>"
        raise InputError(f"a table of features needs the columns {must}, got {named}", "columns")
    exact = [name for name in named if name.startswith("ll_")]
    truth = table["truth"].map(str)
    known = [name[3:] for name in exact] or sorted(set(truth))
    names = tuple(known if hypotheses is None else hypotheses)
    require(len(names) >= 2, "truth", "must name two hypotheses or more", list(names))
    same = "must be those of the ll_ columns, in their order"
    require(not exact or names == tuple(known), "hypotheses", same, names)
    # The reader of evidence checks trials, steps and truths, and restores their order.
    blank = {f"ll_{name}": 0.0 for name in names if not exact}
    read = trials_from_table(table[["trial", "step"]].assign(
        truth=truth, **{name: table[name] for name in exact}, **blank
    ), step_ms=step_ms)  # fmt: skip
    evidence = read.evidence
    place = _places(table)
    values = np.zeros((evidence.trials, evidence.steps, len(units)))
    values[place] = _activity(table, units)
    features = Features(
        values, np.asarray(evidence.truth), names, step_ms, evidence.lengths,
        evidence.log_likelihood if exact else None,
    )  # fmt: skip
    check_learnable(features)
    return features


def _places(table: pd.DataFrame) -> tuple[Integers, Integers]:
    """Return trial and position in the trial of each row, as the reader of evidence orders them."""
    trial = table.groupby("trial", sort=False).ngroup().to_numpy()
    step = pd.to_numeric(table["step"]).to_numpy(dtype=np.intp)
    return trial, step - step.min()


def _activity(table: pd.DataFrame, units: list[str]) -> Array:
    """Return the activity of units (rows, units); ValueError unless all are finite numbers."""
    for name in units:
        check_numeric(table[name])
    values = table[units].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    wrong = ~np.isfinite(values)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError(
            f"{units[column]} must be a finite number, got {table[units[column]].iloc[row]!r} in "
            f"row {row}",
            units[column],
        )
    return np.asarray(values)
