"""Tasks on which weights are learned and scored, shared by the scores of weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel import stream
from bgmodel.learning.weights.features import Features, FeatureSource
from bgmodel.learning.weights.learned import LearnedWeights
from bgmodel.learning.weights.sources import PoissonFeatures, PooledFeatures, tap_features
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import Orientations, SameDifferent, Task

SCORING_SEED = 45_006
"""Step sizes were tuned on seed 1; seed 101 was seen while critics were chosen."""
RUNS = 12
"""Independent learners."""
ACCURACY = 0.9
"""Proportion correct at which times are compared."""
TESTED = 4_000
"""Held-out trials on which the weights of a run are scored."""


@dataclass(frozen=True)
class Taught:
    """A task: the readings for learning, and others for scoring."""

    learned: FeatureSource
    scored: FeatureSource
    held_out: int | None = None
    """Fewest held-out readings of a hypothesis; None where readings are drawn afresh."""

    def test(self, name: str) -> Features:
        """Return held-out trials."""
        return self.scored.draw(TESTED, rng=stream(SCORING_SEED, "scored", name))


def of_taps(task: Task, t_max: int) -> Taught:
    """Return a task with decoded taps."""
    learned, scored = tap_features(held_out_taps(), task, t_max=t_max)
    return Taught(learned, scored, min(len(part) for part in scored.readings))


def of_cells(channels: int) -> Taught:
    """Return a task with Poisson cells whose mean input is removed."""
    cells = PoissonFeatures(channels=channels, centred=True, t_max=60)
    return Taught(cells, cells)


MADE: dict[str, Callable[[], Taught]] = {
    "2 mm": lambda: of_taps(SameDifferent(2.0), 40),
    "1.5 mm": lambda: of_taps(SameDifferent(1.5), 100),
    "Poisson cells, N = 4": lambda: of_cells(4),
    "4 orientations, 2 mm": lambda: of_taps(Orientations(4, 2.0), 40),
    "8 orientations, 2 mm": lambda: of_taps(Orientations(8, 2.0), 40),
}
"""Tasks by name."""
TRIALS = dict(zip(MADE, (10_000, 30_000, 10_000, 10_000, 30_000), strict=True))
"""Number of trials of learning, by task."""


@cache
def task_of(name: str) -> Taught:
    """Return a task by name."""
    return MADE[name]()


def gratings(**options: Any) -> tuple[PooledFeatures, PooledFeatures]:
    """Return gratings of 2 mm, for learning and for scoring."""
    return tap_features(held_out_taps(), SameDifferent(2.0), **options)


def each_run(
    learned: LearnedWeights, task: Taught, name: str, *, stn: bool = True
) -> dict[str, Any]:
    """Return slope, r and relative time, each a mean over runs with its standard error.

    Every run is scored on held-out trials of its own, so that the standard error includes theirs.
    """
    found: dict[str, list[float]] = {"slope": [], "r": [], "relative_time": []}
    for run in range(learned.runs):
        test = task.test(f"{name} {run}")
        one = replace(learned, weights=learned.weights[run : run + 1])
        calibration = one.calibration(test)
        found["slope"].append(float(calibration.slope[0]))
        found["r"].append(float(calibration.r[0]))
        found["relative_time"].append(float(one.relative_time(test, ACCURACY, stn=stn)[0]))
    return {k: v for name, values in found.items() for k, v in mean_se(name, values).items()}


def mean_se(name: str, values: npt.ArrayLike) -> dict[str, float]:
    """Return the mean over runs and its standard error, as NAME and NAME_se; NaN if one is NaN."""
    each = np.asarray(values, dtype=np.float64)
    error = each.std(ddof=1) / np.sqrt(len(each)) if len(each) > 1 else np.nan
    return {name: float(each.mean()), f"{name}_se": float(error)}
