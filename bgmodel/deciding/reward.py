"""The reward of a decision, and counts of correct and forced choices at many thresholds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.deciding.readout import check_early_and_late
from bgmodel.deciding.trace import Trace, check_ended, lowest, of_test, ready, sorted_levels
from bgmodel.support.checks import (
    check_flag,
    check_positive,
    checked_truth,
    known_truth,
    one_per_trial,
)
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers
from circuits.errors import require


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


def tally(
    trace: Trace, truth: Integers | None, thresholds: npt.ArrayLike, *, checked: bool = True
) -> Tally:
    """Count correct and forced choices at each threshold, (K,) nats, without single decisions.

    Responses are forced at the deadline; ``checked`` is that of ``first_crossing``.
    """
    from bgmodel.deciding.crossing import ROUNDING, tally_all

    check_flag("checked", checked)
    require(np.ndim(thresholds) == 1, "thresholds", "must be (K,)", np.shape(thresholds))
    known = known_truth(truth)
    out, first, ends, numbers = ready(trace)
    truth = checked_truth(known, len(out), out.shape[2])
    order, level = sorted_levels(thresholds, out.shape[2])
    if checked and trace.readout is not None:
        trace.readout.check(thresholds)
    ended = np.isnan(out[np.arange(len(out)), ends - 1, 0])
    if ended.any():
        check_ended(out, ends, ended & ~(lowest(out) <= level.min()))
    steps_at = np.maximum(trace.time_ms - trace.onset_ms, 0.0) / trace.step_ms
    correct, steps, forced = tally_all(out, truth, first, level[0], steps_at, ends, numbers)
    if checked:
        before = np.sort(lowest(out[:, :first])) if first else np.zeros(0)
        early = np.searchsorted(before, level[0] - ROUNDING, side="right")
        check_early_and_late(forced, early, len(out), level[0], forced=True, of_test=of_test(trace))
    back = np.argsort(order[0])
    return Tally(len(out), correct[back], steps[back], forced[back])
