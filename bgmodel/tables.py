"""Trial tables: what other tools of the field read, and a user's own evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from bgmodel.decision import Decision
from bgmodel.evidence import Evidence


def trial_table(
    decision: Decision,
    evidence: Evidence,
    *,
    seed: int | None = None,
    model: str,
    participant_id: str = "model",
    condition: str = "",
    names: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return one row a trial, as other tools of the field read it.

    Columns: participant_id, trial, rt (seconds from onset; NaN where undecided), response and
    stimulus (names of hypotheses, empty where there is none), correct (1, 0, or NA without truth),
    undecided, forced, premature, steps, condition, seed, model.
    """
    if decision.choice.ndim != 1:
        raise ValueError(
            f"a trial table holds one threshold, got decisions of shape {decision.choice.shape}"
        )
    labels = np.array([*(names or map(str, range(evidence.hypotheses))), ""], dtype=object)
    truth = evidence.truth
    known = truth is not None
    return pd.DataFrame(
        {
            "participant_id": participant_id,
            "trial": np.arange(evidence.trials),
            "rt": decision.time_ms / 1000,
            "response": labels[decision.choice],
            "stimulus": labels[truth] if known else "",
            "correct": pd.array(
                (decision.choice == truth).astype(int) if known else [None] * evidence.trials,
                dtype="Int8",
            ),
            "undecided": decision.choice < 0,
            "forced": decision.forced,
            "premature": decision.premature,
            "steps": decision.steps,
            "condition": condition,
            "seed": seed,
            "model": model,
        }
    )


def evidence_from_table(
    table: pd.DataFrame,
    *,
    prior: Sequence[float] | None = None,
    onset_ms: float = 0.0,
    step_ms: float = 1.0,
) -> tuple[Evidence, list[str]]:
    """Return the evidence in a user's table, and the names of its hypotheses.

    Parameters
    ----------
    table : DataFrame
        One row a reading: ``trial``, ``step`` and a column ``ll_<name>`` for each hypothesis,
        holding ``log p(reading | hypothesis)`` in nats; optionally ``truth``, a hypothesis's name.
        Every trial has the same number of readings; rows may come in any order.
    prior, onset_ms, step_ms :
        As in ``Evidence``.

    Raises
    ------
    ValueError
        If columns are absent, trials are unequal in length, a step is there twice, a value is no
        finite number, or a truth is none of the hypotheses.
    """
    columns = [name for name in table.columns if str(name).startswith("ll_")]
    absent = [name for name in ("trial", "step") if name not in table.columns]
    if absent or len(columns) < 2:
        raise ValueError(
            "an evidence table needs the columns trial, step and at least two ll_<hypothesis>, "
            f"got {list(table.columns)}"
        )
    if len(table) == 0:
        raise ValueError("an evidence table needs at least one trial, got 0 rows")
    table = table.sort_values(["trial", "step"], kind="stable")
    twice = table[table.duplicated(["trial", "step"])]
    if len(twice):
        raise ValueError(f"trial {twice['trial'].iloc[0]} has step {twice['step'].iloc[0]} twice")
    lengths = table.groupby("trial").size()
    if lengths.nunique() != 1:
        raise ValueError(
            "every trial must have the same number of readings, got "
            f"{lengths.min()} to {lengths.max()}: cut them, or fill up with readings that say "
            "nothing, all ll_ equal"
        )
    names = [name[3:] for name in columns]
    shape = (len(lengths), int(lengths.iloc[0]), len(names))
    values = _numbers(table, columns).reshape(shape)
    truth = _truth_of(table, names) if "truth" in table.columns else None
    prior_array = None if prior is None else np.asarray(prior, dtype=np.float64)
    return Evidence(values, truth, prior_array, onset_ms, step_ms), names  # type: ignore[arg-type]


def _numbers(table: pd.DataFrame, columns: list[str]) -> np.ndarray:
    values = table[columns].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    wrong = ~np.isfinite(values)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        trial, step, value = (table[name].iloc[row] for name in ("trial", "step", columns[column]))
        raise ValueError(
            f"{columns[column]} must be a finite number, got {value!s} at trial {trial}, step "
            f"{step} ({wrong.sum()} such values)"
        )
    return values


def _truth_of(table: pd.DataFrame, names: list[str]) -> np.ndarray:
    per_trial = table.groupby("trial")["truth"].agg(["first", "nunique"])
    unknown = set(per_trial["first"].astype(str)) - set(names)
    if unknown or (per_trial["nunique"] != 1).any():
        raise ValueError(
            f"truth must be one of {names} and the same in all rows of a trial, "
            f"got {sorted(unknown) or 'several in one trial'}"
        )
    return np.array([names.index(str(name)) for name in per_trial["first"]])
