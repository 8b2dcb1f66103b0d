"""Options of learners of values for a bandit with reversals, tuned on a seed that scores nothing.

Every combination of a grid is played, and that with the least regret is printed:
``python -m benchmarks.tuning.values``.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from bgmodel.learning.bandit import Bandit, ideal_of, play, relative_regret
from bgmodel.learning.value_learners import (
    Confidence,
    LogitQ,
    Opal,
    QBoth,
    QLearning,
    Reinforce,
    ValueLearner,
)

TUNING_SEED = 45_001
"""Seed of all tuning."""
RUNS = 200
CHOICES = (5.0, 10.0, 20.0, 40.0, np.inf)
"""Inverse temperatures."""
RATES = (0.2, 0.3, 0.4, 0.6, 0.8, 0.9)
GRIDS: dict[str, tuple[type[ValueLearner], dict[str, tuple[Any, ...]]]] = {
    "q-both": (QBoth, {"rate": (0.1, 0.15, *RATES[:3]), "beta": CHOICES}),
    "q": (QLearning, {"rate": RATES, "beta": CHOICES}),
    "logit-q": (LogitQ, {"rate": RATES, "beta": (1.0, 1.5, 3.0, *CHOICES)}),
    "confidence": (
        Confidence,
        {"rate": (0.25, 0.35, 0.5, 0.7, 1.0), "decay": (0.0, 0.02, 0.05, 0.1), "beta": CHOICES},
    ),
    "opal": (
        Opal,
        {
            "rate": (0.6, 0.8, 1.0),
            "critic_rate": (0.0, 0.02),
            "decay": (0.1, 0.2, 0.3),
            "beta": CHOICES,
        },
    ),
    "reinforce": (
        Reinforce,
        {
            "rate": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0),
            "mean_rate": (0.0, 0.02, 0.1),
            "decay": (0.0, 0.02, 0.05, 0.1, 0.2),
        },
    ),
}  # fmt: skip
"""Learners, and the values of each option that are tried."""


def grids(bandit: Bandit) -> Iterator[tuple[str, type[ValueLearner], dict[str, tuple[Any, ...]]]]:
    """Yield learners with their grids; the affine critic expects the rewards of the bandit."""
    for name, (kind, grid) in GRIDS.items():
        yield name, kind, grid
        if kind is Confidence:
            affine = {"low": (bandit.worse,), "high": (bandit.better,)}
            yield "confidence, affine", kind, grid | affine


def tuned(bandit: Bandit) -> dict[str, tuple[float, dict[str, Any]]]:
    """Return the least relative regret of each learner, and the options that have it."""
    ideal = play(ideal_of(bandit), bandit, runs=RUNS, seed=TUNING_SEED)
    best = {}
    for name, kind, grid in grids(bandit):
        tried = []
        for values in product(*grid.values()):
            options = dict(zip(grid, values, strict=True))
            played = play(kind(**options), bandit, runs=RUNS, seed=TUNING_SEED)
            tried.append((relative_regret(played, ideal)[0], options))
        best[name] = min(tried, key=lambda one: one[0])
    return best


def main() -> None:
    """Print the best options for each bandit."""
    for better in (0.8, 0.7):
        bandit = Bandit(better, round(1 - better, 1), reverse_every=50)
        for name, (regret, options) in tuned(bandit).items():
            print(f"{better:g}: {name:20} {regret:.3f} {options}", flush=True)


if __name__ == "__main__":
    main()
