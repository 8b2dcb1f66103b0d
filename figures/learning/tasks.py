"""Tasks on which weights are learned and scored, shared by the scores of weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel import stream
from bgmodel.learning.feature_sources import (
    FeatureSource,
    PoissonFeatures,
    PooledFeatures,
    tap_features,
)
from bgmodel.learning.features import Features
from bgmodel.learning.learned_weights import LearnedWeights
from bgmodel.tactile.source import FOLDS, Tactile, held_out_taps
from bgmodel.tactile.task import Orientation, SameDifferent

SCORING_SEED = 45_006
"""Step sizes were tuned on seed 1; seed 101 was seen while critics were chosen."""
RUNS = 12
"""Independent learners."""
ACCURACY = 0.9
"""Proportion correct at which times are compared."""
TESTED = 4_000
"""Held-out trials on which the weights of a run are scored."""


@dataclass(frozen=True)
class TaskReadings:
    """A task: the readings for learning, and others for scoring."""

    learned: FeatureSource
    scored: FeatureSource
    held_out: int | None = None
    """Fewest held-out readings of a hypothesis; None where readings are drawn afresh."""

    def test(self, name: str) -> Features:
        """Return held-out trials."""
        return self.scored.draw(TESTED, rng=stream(SCORING_SEED, "scored", name))


def of_taps(task: Tactile, t_max: int, fold: int = 0) -> TaskReadings:
    """Return a task with decoded taps, one sixth of which scores."""
    learned, scored = tap_features(held_out_taps(), task, t_max=t_max, fold=fold)
    return TaskReadings(learned, scored, min(len(part) for part in scored.readings))


def of_cells(channels: int) -> TaskReadings:
    """Return a task with Poisson cells whose mean input is removed."""
    cells = PoissonFeatures(channels=channels, centred=True, t_max=60)
    return TaskReadings(cells, cells)


def of_orientations(count: int) -> list[TaskReadings]:
    """Return a task with few taps per class, each sixth of which scores in turn."""
    return [of_taps(Orientation(count, 2.0), 40, fold) for fold in range(FOLDS)]


MADE: dict[str, Callable[[], list[TaskReadings]]] = {
    "2 mm": lambda: [of_taps(SameDifferent(2.0), 40)],
    "1.5 mm": lambda: [of_taps(SameDifferent(1.5), 100)],
    "Poisson cells, N = 4": lambda: [of_cells(4)],
    "4 orientations, 2 mm": lambda: of_orientations(4),
    "8 orientations, 2 mm": lambda: of_orientations(8),
}
"""Tasks by name: the runs are divided among the parts of each."""
TRIALS = dict(zip(MADE, (10_000, 30_000, 10_000, 10_000, 10_000), strict=True))
"""Number of trials of learning, by task."""


@cache
def parts_of(name: str) -> list[TaskReadings]:
    """Return the parts of a task by name."""
    return MADE[name]()


def gratings(**options: Any) -> tuple[PooledFeatures, PooledFeatures]:
    """Return gratings of 2 mm, for learning and for scoring."""
    return tap_features(held_out_taps(), SameDifferent(2.0), **options)


MEASURES = ["slope", "r", "relative_time"]


def scores(learned: LearnedWeights, task: TaskReadings, name: str, **known: object) -> pd.DataFrame:
    """Return slope, r and relative time of each run, each on other held-out trials."""
    rows = []
    for run in range(learned.runs):
        test = task.test(f"{name} {run}")
        one = replace(learned, weights=learned.weights[run : run + 1])
        calibration = one.calibration(test)
        time = one.relative_time(test, ACCURACY)
        rows.append([calibration.slope[0], calibration.r[0], time[0]])
    return pd.DataFrame(rows, columns=MEASURES).assign(**known)


def each_run(learned: LearnedWeights, task: TaskReadings, name: str) -> dict[str, float]:
    """Return mean slope, r and relative time over runs, with standard errors.

    Every run is scored on other held-out trials, so that the standard error includes theirs.
    """
    table = scores(learned, task, name)
    return {k: v for one in MEASURES for k, v in mean_se(one, table[one]).items()}


def mean_se(name: str, values: npt.ArrayLike) -> dict[str, float]:
    """Return the mean over runs and its standard error, as NAME and NAME_se; NaN if one is NaN."""
    each = np.asarray(values, dtype=np.float64)
    error = each.std(ddof=1) / np.sqrt(len(each)) if len(each) > 1 else np.nan
    return {name: float(each.mean()), f"{name}_se": float(error)}
