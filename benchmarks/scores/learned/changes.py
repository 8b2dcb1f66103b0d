"""Labels that are exchanged and a sensor that drifts while weights are learned.

Learning continues after the change, and the weights from before it are scored on the same
readings as a control.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from benchmarks.scores.learned.tasks import RUNS, SCORING_SEED, Taught, each_run, gratings
from bgmodel.learning.weights.drift import DriftingSensor
from bgmodel.learning.weights.features import FeatureSource
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.learning.weights.learn import learn_weights
from bgmodel.learning.weights.learned import LearnedWeights

BEGINS, TRIALS, BIN = 3000, 8000, 50
"""Trial of the change, number of trials, and trials behind a point."""
NEAR = 0.02
"""Recovered: within this of the proportion correct before the change, some 2 standard errors."""


@dataclass(frozen=True)
class Change:
    """A change in the middle of learning: of the labels, or of how the sensor reads a tap."""

    labels: bool = False
    scale: float = 1.0
    shift_deg: float = 0.0
    lasts: int = 0

    def source(self) -> FeatureSource:
        """Return gratings of 2 mm that are read through the changing sensor."""
        pool = gratings()[0]
        if self.labels:
            return pool
        return DriftingSensor(pool, self.scale, self.shift_deg, BEGINS, self.lasts)


CHANGES = {
    "none": Change(),
    "labels exchanged": Change(labels=True),
    "40 degrees at once": Change(shift_deg=40.0),
    "40 degrees over 2000 trials": Change(shift_deg=40.0, lasts=2000),
    "readings doubled": Change(scale=2.0),
    "readings halved": Change(scale=0.5),
}
"""Changes by name."""


def changed(name: str, fast: bool) -> pd.DataFrame:
    """Return the proportion correct over trials, and scores of weights before and after."""
    change = CHANGES[name]
    learned = learn_weights(
        change.source(), seed=SCORING_SEED, runs=RUNS,
        feedback=Feedback(reversal=BEGINS if change.labels else None),
        learner=WeightLearner(trials=BEGINS + 250 if fast else TRIALS, half_trials=np.inf),
    )  # fmt: skip
    course = learned.course
    assert course is not None
    bins = course.correct.shape[1] // BIN
    found = pd.DataFrame({"change": name, "trial": np.arange(bins) * BIN, "begins": BEGINS})
    for what, values in (("correct", course.correct), ("readings", course.readings)):
        each = values[:, : bins * BIN].reshape(RUNS, bins, BIN).mean(axis=2)
        found[what] = each.mean(axis=0)
        found[f"{what}_se"] = each.std(axis=0, ddof=1) / np.sqrt(RUNS)
    pool, held_out = gratings()
    task = Taught(pool, held_out.drifted(change.scale, change.shift_deg))
    for kept, weights in (("learning", learned), ("frozen", learned.after(BEGINS, 0.25))):
        scored = each_run(_for_new_labels(weights, change), task, name)
        found = found.assign(**{f"{kept}_{k}": v for k, v in scored.items()})
    return found


def _for_new_labels(learned: LearnedWeights, change: Change) -> LearnedWeights:
    """Return weights as held-out trials with exchanged labels see them, if labels change."""
    return replace(learned, weights=learned.weights[:, ::-1]) if change.labels else learned


def summaries(changes: pd.DataFrame) -> pd.DataFrame:
    """Return each change's effect, and the trials after which it has been compensated."""
    rows = []
    for name, part in changes.groupby("change", sort=False):
        since = part["trial"].to_numpy() - BEGINS
        correct = part["correct"].to_numpy()
        before = correct[(since >= -1000) & (since < 0)].mean()
        lowest = correct[since >= 0].min()
        near = since[(since >= 0) & (correct >= before - NEAR)]
        scores = part.filter(regex="^(learning|frozen)_").iloc[0]
        recovered = near[0] if len(near) else np.nan
        known = {"change": name, "before": before, "lowest": lowest, "recovered_after": recovered}
        rows.append(known | dict(scores))
    return pd.DataFrame(rows)
