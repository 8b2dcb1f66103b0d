"""Learning from reward: exhaustive search of gaps, and REINFORCE with baseline."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Tally
from bgmodel.evidence import Evidence
from bgmodel.integrators.sprt import sprt_threshold_from_gap, tally_sprt
from bgmodel.learning.policies import GaussianPolicy, Policy
from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_finite, check_positive
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd


def exhaustive_search(evidence: Evidence | Iterable[Evidence], deltas: npt.ArrayLike) -> Tally:
    """Try every gap on every trial.

    Parameters
    ----------
    evidence : Evidence, or an iterable of blocks of it
        Two hypotheses.
    deltas : array (K,), nats
        Gaps to try; one pass serves all.

    Returns
    -------
    Tally
        Whose ``accuracy``, ``mean_steps`` and ``mean_reward`` have one entry a gap.
    """
    thresholds = sprt_threshold_from_gap(np.atleast_1d(deltas))
    total: Tally | None = None
    for block in [evidence] if isinstance(evidence, Evidence) else evidence:
        counts = tally_sprt(block, thresholds)
        total = counts if total is None else total + counts
    if total is None:
        raise InputError("exhaustive search needs at least one trial, got none", "evidence")
    return total


@dataclass(frozen=True)
class Learner:
    """REINFORCE with baseline (Williams 1992; Sutton & Barto 2018, section 13.4)."""

    episodes: int = 40_000
    """Trials of learning; assumed (not printed)."""
    rate: float = 0.04
    """Step size at the start, on the prediction error as a share of the baseline; assumed (not
    printed)."""
    half_episodes: float = 1_000.0
    """Trials after which the step size has halved, rate / (1 + k / half); assumed. With inf it
    never falls: what a world that changes asks for."""
    baseline_rate: float = 0.01
    """Share of each reward in the running baseline; its inverse is the number of trials that only
    measure the baseline before learning starts; assumed."""
    carried: float = 0.0
    """How far the last trial's error, as a share of the baseline, carries what is played in the
    next, in sd of exploration: dopamine that has not gone yet; assumed."""
    last: int = 500
    """The learned value is the mean of so many last trials; Burguete, Griffith & Lepora 2023."""

    def __post_init__(self) -> None:
        fits = self.episodes >= self.last >= 1
        require(fits, "episodes", f"must be at least last ({self.last}) >= 1", self.episodes)
        check_positive(rate=self.rate, baseline_rate=self.baseline_rate)
        require(self.half_episodes > 0, "half_episodes", "must be > 0", self.half_episodes)
        check_finite(carried=self.carried)


@dataclass(frozen=True)
class Learned:
    """The course of learning in several runs: what is played is a gap or a level of dopamine.

    Parameters
    ----------
    played : array (runs, episodes)
        Gap (nats) or level in each trial.
    mean_played : array (runs, episodes)
        Its mean before exploration; of levels the tonic level.
    reward : array (runs, episodes), readings
        Reward of each trial.
    prediction_error : array (runs, episodes), readings
        Reward minus its learned baseline: what phasic dopamine is taken to report.
    learned : array (runs,)
        The learned gap or level: ``mean_played`` over the last trials.
    """

    played: Array
    mean_played: Array
    reward: Array
    prediction_error: Array
    learned: Array


def course(learned: Learned, *, mean: str, played: str, error: str) -> pd.DataFrame:
    """Return every trial of every run, one row each: run, episode, and what was learned from.

    Parameters
    ----------
    learned : Learned
        The course.
    mean, played, error : str
        What the columns of ``mean_played``, ``played`` and ``prediction_error`` are called; that of
        the reward is "reward".
    """
    import pandas as pd

    runs, episodes = learned.played.shape
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(runs), episodes),
            "episode": np.tile(np.arange(episodes), runs),
            mean: learned.mean_played.ravel(),
            played: learned.played.ravel(),
            "reward": learned.reward.ravel(),
            error: learned.prediction_error.ravel(),
        }
    )


class LearningStopped(ValueError):
    """Learning that cannot go on; ``learned`` is what it had reached."""

    def __init__(self, message: str, learned: Learned) -> None:
        super().__init__(message)
        self.learned = learned


Environment = Callable[[int, Array], Array]


def learn(
    environment: Environment,
    start: npt.ArrayLike,
    *,
    rngs: list[np.random.Generator],
    policy: Policy | None = None,
    learner: Learner | None = None,
) -> Learned:
    """Learn a gap or a level of dopamine in several independent runs, side by side.

    Parameters
    ----------
    environment : callable
        ``environment(episode, played (runs,)) -> rewards (runs,)``; see ``trials_of``, which is
        played by gaps, and ``LevelOutcomes`` for a circuit, which is played by levels.
    start : float
        Mean of what is played at the start: a gap (nats) or a level of dopamine.
    rngs : list of numpy.random.Generator
        One a run, for its exploration alone: a run's course does not depend on its neighbours.
    policy, learner :
        What explores, and how it learns.

    Raises
    ------
    LearningStopped
        If a reward is not finite, or what is learned runs away.
    """
    policy, learner = policy or GaussianPolicy(), learner or Learner()
    runs, episodes = len(rngs), learner.episodes
    noise = np.stack([rng.standard_normal((episodes, policy.noise)) for rng in rngs], axis=1)
    parameters = policy.start(runs, float(np.asarray(start)))
    played, mean, rewards, errors = (np.empty((runs, episodes)) for _ in range(4))
    baseline, share = np.zeros(runs), np.zeros(runs)
    for k in range(episodes):
        mean[:, k] = policy.mean(parameters)
        # What is carried over is no exploration: it gets no credit.
        carried = learner.carried * share[:, None]
        played[:, k], _ = policy.sample(parameters, noise[k] + carried, k)
        _, gradient = policy.sample(parameters, noise[k], k)
        r = environment(k, played[:, k])
        if not (np.isfinite(r).all() and np.isfinite(parameters).all()):
            what = "a reward" if not np.isfinite(r).all() else "what is learned"
            last = mean[:, max(k - 1, 0)]
            done = Learned(played[:, :k], mean[:, :k], rewards[:, :k], errors[:, :k], last)
            raise LearningStopped(f"{what} is not finite in episode {k}", done)
        error = r - baseline if k else np.zeros(runs)
        scale = baseline  # of earlier trials alone, so that the gradient stays unbiased
        baseline = baseline + max(learner.baseline_rate, 1 / (k + 1)) * (r - baseline)
        share = error / np.maximum(np.abs(scale), 1.0)  # a reading is the least a trial costs
        if k * learner.baseline_rate >= 1:
            rate = policy.pace * learner.rate / (1 + k / learner.half_episodes)
            parameters = policy.bounded(parameters + rate * share[:, None] * gradient)
        rewards[:, k], errors[:, k] = r, error
    return Learned(played, mean, rewards, errors, mean[:, -learner.last :].mean(axis=1))


def smoothed(curve: Array, window: int) -> Array:
    """Return the running mean of the last axis over ``window`` trials, shorter at the start."""
    require(window >= 1, "window", "must be >= 1", window)
    total = np.cumsum(np.insert(curve, 0, 0.0, axis=-1), axis=-1)
    end = np.arange(1, curve.shape[-1] + 1)
    begin = np.maximum(end - window, 0)
    return np.asarray((total[..., end] - total[..., begin]) / (end - begin))
