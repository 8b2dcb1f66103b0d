"""A probabilistic two-armed bandit whose arms exchange their probabilities of reward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_finite, check_range, whole
from bgmodel.support.seeds import stream
from circuits.errors import InputError, require


@dataclass(frozen=True)
class Bandit:
    """Two arms with rewards of 0 or 1; the better arm is drawn at the start of a run.

    Parameters
    ----------
    better, worse : float
        Probabilities of a reward.
    reverse_every : int, optional
        Number of trials after which the arms are exchanged, again and again.
    hazard : float
        Probability that they are exchanged after a trial; only without ``reverse_every``.

    Raises
    ------
    ValueError
        If a probability is not between 0 and 1, the better arm is not better, or there are two
        kinds of reversals.
    """

    better: float = 0.8
    worse: float = 0.2
    reverse_every: int | None = None
    hazard: float = 0.0

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
        """Return the random numbers of some runs, the same for every learner.

        Parameters
        ----------
        trials, runs : int
            Number of trials of each run, and of runs.
        seed : int
            Each run has its own random numbers.
        """
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
    """What is random in some runs of a bandit.

    Parameters
    ----------
    bandit : Bandit
    best : int array (trials, runs)
        The better arm, 0 or 1.
    chance, luck : array (trials, runs)
        Uniform numbers from which choices and rewards are drawn.
    """

    bandit: Bandit
    best: Integers
    chance: Array
    luck: Array

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
