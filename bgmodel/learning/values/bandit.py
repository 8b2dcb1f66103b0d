"""A probabilistic two-armed bandit whose arms exchange their rewards, and its ideal learner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bgmodel.learning.values.learners import Learner, Number, check_option
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_finite, check_range, whole
from bgmodel.support.seeds import stream
from circuits.errors import InputError, require


@dataclass(frozen=True)
class Bandit:
    """Two arms with rewards of 0 or 1; the better arm is drawn at the start of a run."""

    better: float = 0.8  # probability of a reward
    worse: float = 0.2
    reverse_every: int | None = None  # trials between reversals
    hazard: float = 0.0  # probability of a reversal after a trial; excludes reverse_every

    def __post_init__(self) -> None:
        check_probabilities(self.better, self.worse)
        check_range(0, 1, hazard=self.hazard)
        if self.reverse_every is not None:
            whole("reverse_every", self.reverse_every, 1)
            if self.hazard:
                raise InputError.of(
                    "hazard", "must be 0 if the arms reverse every few trials", self.hazard
                )

    @property
    def mean_hazard(self) -> float:
        """Reversals per trial."""
        return self.hazard if self.reverse_every is None else 1 / self.reverse_every

    def draw(self, trials: int, runs: int, seed: int) -> Draws:
        """Return the random numbers of some runs, the same for every learner."""
        trials, runs = whole("trials", trials, 1), whole("runs", runs, 1)
        rngs = [stream(seed, "bandit", run) for run in range(runs)]
        first = np.array([rng.integers(2) for rng in rngs])
        uniform = np.stack([rng.random((trials, 3)) for rng in rngs], axis=1)
        if self.reverse_every is None:
            before = np.cumsum(uniform[:-1, :, 2] < self.hazard, axis=0)
            turned = np.concatenate([np.zeros((1, runs), dtype=np.intp), before])
        else:
            turned = (np.arange(trials) // self.reverse_every)[:, None]
        best = (first + turned) % 2
        return Draws(self, best, uniform[..., 0], uniform[..., 1])


@dataclass(frozen=True, eq=False)
class Draws:
    """What is random in some runs of a bandit, (trials, runs) each."""

    bandit: Bandit
    best: Integers  # the better arm, 0 or 1
    chance: Array  # uniform, from which choices are drawn
    luck: Array  # uniform, from which rewards are drawn

    def reward(self, trial: int, choice: Integers) -> Array:
        """Return the rewards of choices (runs,) in a trial, 0 or 1."""
        right = choice == self.best[trial]
        p = np.where(right, self.bandit.better, self.bandit.worse)
        return np.asarray(self.luck[trial] < p, dtype=np.float64)


def check_probabilities(better: float, worse: float) -> None:
    """Raise ValueError unless ``0 < worse < better < 1``."""
    check_finite(better=better, worse=worse)
    for name, p in (("better", better), ("worse", worse)):
        require(0 < p < 1, name, "must be between 0 and 1, both excluded", p)
    require(worse < better, "better", f"must exceed worse, {worse:g}", better)


@dataclass(frozen=True, eq=False, kw_only=True)
class IdealLearner(Learner):
    """The posterior that either arm is the better one, given all choices and rewards so far.

    It is a hidden Markov filter with the bandit's probabilities and hazard. A reward multiplies the
    posterior by its likelihood; then the arms are exchanged with probability ``hazard``. If
    ``better + worse = 1``, both arms tell equally much, so that choosing the likelier one in every
    trial is optimal where reversals occur with that hazard.
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
