"""The reward of a decision: its time, and the cost of an error."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_positive, one_per_trial


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
