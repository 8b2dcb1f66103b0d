"""Evidence with names of its hypotheses, and tables of the decisions on it, one row per trial."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.decision import Decision
from bgmodel.evidence import Evidence, check_evidence
from circuits.arrays import Truths
from circuits.errors import require

if TYPE_CHECKING:
    import pandas as pd

RESULT = ("rt", "response", "stimulus", "correct", "undecided", "forced", "premature", "steps",
          "condition", "seed", "model", "anticipatory")  # fmt: skip
"""Columns of results: a user's column of the same name is renamed to ``given_<name>``."""


def _no_columns() -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame()


@dataclass(frozen=True)
class NamedEvidence:
    """Evidence, the names of its hypotheses, and further columns of a table."""

    evidence: Evidence  # Trial k is the k-th to appear in the table.
    names: list[str]
    # One row per trial; ``row`` is the table's first row of the trial, from 0.
    columns: pd.DataFrame = field(default_factory=_no_columns)
    # Columns left out because they change within a trial.
    varying: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        count = check_evidence(self.evidence).hypotheses
        require(len(self.names) == count, "names", f"must be of {count} hypotheses", self.names)

    def where(self, chosen: Truths) -> NamedEvidence:
        """Return a subset of the trials."""
        columns = self.columns[chosen].reset_index(drop=True) if len(self.columns) else self.columns
        return replace(self, evidence=self.evidence[chosen], columns=columns)

    def summary(self) -> str:
        """Return one sentence: trials, readings, hypotheses, and columns left out."""
        few, many = self.evidence.readings.min(), self.evidence.readings.max()
        readings = f"{few}" if few == many else f"{few} to {many}"
        left = f"; columns that change within a trial are left out: {', '.join(self.varying)}"
        return (
            f"read {self.evidence.trials} trials of {readings} readings, hypotheses "
            f"{', '.join(self.names)}{left if self.varying else ''}"
        )


def trial_table(
    decision: Decision,
    trials: NamedEvidence,
    *,
    seed: int | None = None,
    model: str,
    condition: str = "",
) -> pd.DataFrame:
    """Return one row per trial: decisions at one threshold, in the format of other tools.

    ``rt`` is in s from onset, NaN if undecided; ``correct`` is 1, 0 or NA; ``steps`` counts
    readings used. Columns of a user's table with one of these names become ``given_<name>``.
    """
    import pandas as pd

    is_trials = isinstance(trials, NamedEvidence)
    require(is_trials, "trials", "must be NamedEvidence(evidence, names)", type(trials).__name__)
    shape = decision.choice.shape
    require(len(shape) == 1, "decision", "must be at one threshold, (trials,)", shape)
    evidence = trials.evidence
    require(
        shape == (evidence.trials,), "trials", f"must be {shape[0]}, as decisions", evidence.trials
    )
    labels = np.array([*trials.names, ""], dtype=object)
    truth = evidence.truth
    known = truth is not None
    correct = np.full(evidence.trials, None, dtype=object)
    if truth is not None:
        decided = decision.choice >= 0
        correct[decided] = (decision.choice == truth)[decided].astype(int)
    table = pd.DataFrame(
        {
            "participant_id": "model",
            "trial": evidence.trial_numbers,
            "rt": decision.time_ms / 1000,
            "response": labels[decision.choice],
            "stimulus": labels[truth] if known else "",
            "correct": pd.array(correct, dtype="Int8"),
            "undecided": decision.choice < 0,
            "forced": decision.forced,
            "premature": decision.premature,
            "steps": np.minimum(decision.steps, evidence.readings),
            "condition": condition,
            "seed": seed,
            "model": model,
        }
    )
    for name in trials.columns:
        ours = name in RESULT and (name != "condition" or condition != "")
        table[f"given_{name}" if ours else name] = trials.columns[name].array
    return table
