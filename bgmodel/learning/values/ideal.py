"""The ideal learner of a bandit: a hidden Markov filter that knows its probabilities and hazard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bgmodel.learning.values.bandit import Bandit, check_probabilities
from bgmodel.learning.values.learners import Learner, Number, check_option
from bgmodel.support.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class IdealLearner(Learner):
    """The posterior that either arm is the better one, given all choices and rewards so far.

    A reward multiplies the posterior by its likelihood; then the arms are exchanged with
    probability ``hazard``. If ``better + worse = 1``, both arms tell equally much, so that choosing
    the likelier one in every trial is optimal where reversals occur with that hazard.
    """

    name: ClassVar[str] = "ideal"
    better: float = 0.8
    worse: float = 0.2
    hazard: float = 0.02
    beta: Number = np.inf

    def __post_init__(self) -> None:
        check_probabilities(self.better, self.worse)
        check_option("hazard", self.hazard, 0.0, 1.0)

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return posteriors of 0.5."""
        return np.full((1, *shape, 2), 0.5)

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Return the posteriors for the next trial."""
        if_better = np.where(chosen > 0, self.better, self.worse)  # if arm i is the better one
        r = reward[..., None]
        joint = state[0] * np.where(r > 0, if_better, 1 - if_better)
        posterior = joint / joint.sum(axis=-1, keepdims=True)
        return np.asarray(posterior + self.hazard * (1 - 2 * posterior))[None]


def ideal_of(bandit: Bandit) -> IdealLearner:
    """Return the ideal learner of a bandit; reversals at fixed times enter by their mean hazard."""
    hazard = bandit.mean_hazard
    return IdealLearner(better=bandit.better, worse=bandit.worse, hazard=hazard)
