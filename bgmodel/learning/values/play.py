"""Learners that play a bandit, and their regret relative to that of the ideal learner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bgmodel.learning.values.bandit import Bandit, Draws
from bgmodel.learning.values.learners import Learner, learner_of
from bgmodel.support.arrays import Array, Integers, Truths
from circuits.errors import require

Chooser = Callable[[Array, int], tuple[Integers, Array]]
"""Takes the values (runs, 2) and the number of the trial; returns choices and times, ms."""


@dataclass(frozen=True, eq=False)
class Played:
    """Trials of several runs of one learner, (trials, runs) each."""

    draws: Draws
    choice: Integers  # chosen arm, 0 or 1
    reward: Array  # 0 or 1
    difference: Array  # value of the better arm minus the other, before the choice
    time_ms: Array  # NaN if choices take no time

    @property
    def correct(self) -> Truths:
        """Whether the better arm was chosen, (trials, runs)."""
        return np.asarray(self.choice == self.draws.best)

    @property
    def regret(self) -> Array:
        """Expected rewards forgone in each run, (runs,)."""
        lost = self.draws.bandit.better - self.draws.bandit.worse
        return np.asarray(lost * (~self.correct).sum(axis=0))


def play(
    learner: Learner | str,
    bandit: Bandit,
    *,
    trials: int = 1000,
    runs: int = 400,
    seed: int,
    chooser: Chooser | None = None,
) -> Played:
    """Let several runs of a learner play a bandit.

    The draws of the bandit depend on the seed alone, so that learners can be compared in pairs.
    Without a chooser, choices are drawn from the learner's probabilities.
    """
    learner, draws = learner_of(learner), bandit.draw(trials, runs, seed)
    state, every = learner.start((runs,)), np.arange(runs)
    choice = np.empty(draws.best.shape, np.int8)
    reward, difference = np.empty(choice.shape), np.empty(choice.shape)
    time_ms = np.full(choice.shape, np.nan)
    for k in range(trials):
        values = learner.values(state)
        best = draws.best[k]
        difference[k] = values[every, best] - values[every, 1 - best]
        if chooser is None:
            choice[k] = draws.chance[k] < learner.probability(state)
        else:
            choice[k], time_ms[k] = chooser(values, k)
        reward[k] = draws.reward(k, choice[k])
        state = learner.learn(state, np.eye(2)[choice[k]], reward[k])
    return Played(draws, choice, reward, difference, time_ms)


def relative_regret(played: Played, reference: Played) -> tuple[float, float]:
    """Return mean regret over that of a reference on the same draws, and its standard error.

    The error is that of a ratio of means over paired runs (delta method).
    """
    ours, other = played.regret, reference.regret
    same = "must have as many runs as the other"
    require(len(ours) == len(other), "reference", same, len(other))
    require(other.sum() > 0, "reference", "must have some regret", 0.0)
    ratio = ours.mean() / other.mean()
    error = (ours - ratio * other).std(ddof=1) / np.sqrt(len(ours)) / other.mean()
    return float(ratio), float(error)
