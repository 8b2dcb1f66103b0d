"""The reward of a decision, and counts of correct and forced choices at many thresholds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.support.checks import (
    check_positive,
    one_per_trial,
)
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers


def reward_of(error: npt.ArrayLike, steps: npt.ArrayLike, xi: float) -> Array:
    """Return ``xi W - T`` in readings, W = -1 for errors, of single trials or of means."""
    check_positive(xi=xi)
    rewards: Array = -xi * np.asarray(error) - np.asarray(steps)
    return rewards


def reward(decision: Decision, truth: Integers, xi: float) -> Array:
    """Return the reward of every trial, ``r = xi W - T`` (Burguete, Griffith & Lepora 2023).

    An omission is an error, and its T is the number of readings of the whole trial.
    """
    truth = one_per_trial("truth", truth, decision.choice.shape[-1])
    latest = np.where(np.isnan(decision.steps), decision.deadline_ms / decision.step_ms, 0)
    return reward_of(decision.choice != truth, np.fmax(decision.steps, latest), xi)


@dataclass(frozen=True, repr=False)
class Tally(Facts):
    """Sums over trials for each of K thresholds: trials is an int, the others are arrays (K,)."""

    trials: int
    correct: npt.NDArray[np.int64]
    steps: Array
    forced: npt.NDArray[np.int64]

    def facts(self) -> dict[str, str]:
        """Return trials, thresholds, accuracy and mean time."""
        return {
            "trials": f"{self.trials}",
            "thresholds": f"{len(self.correct)}",
            "accuracy": span(self.accuracy),
            "mean_steps": span(self.mean_steps),
            "forced": span(self.forced, ".0f"),
        }

    def __add__(self, other: Tally) -> Tally:
        """Pool two sets of trials."""
        return Tally(
            self.trials + other.trials,
            self.correct + other.correct,
            self.steps + other.steps,
            self.forced + other.forced,
        )

    @property
    def accuracy(self) -> Array:
        """Proportion correct, (K,)."""
        return self.correct / self.trials

    @property
    def mean_steps(self) -> Array:
        """Mean decision time in readings, (K,)."""
        return self.steps / self.trials
