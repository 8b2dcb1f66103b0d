"""Learning the gap from reward: the reward, exhaustive search, REINFORCE with baseline, regret."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bgmodel.decision import Decision, Tally, Trace, crossing_of_each, tally
from bgmodel.evidence import Evidence
from bgmodel.sprt import Sprt, threshold_from_gap

FloatArray = npt.NDArray[np.float64]
DELTA_RANGE = (0.0, 8.0)


def reward(decision: Decision, truth: npt.NDArray[np.integer], xi: float) -> FloatArray:
    """Return ``r = xi W - T`` of every trial (Burguete, Griffith & Lepora 2023).

    W is -1 for an error (an omission is one) and 0 otherwise; T is the number of readings, which
    for an omission is that of the whole trial.
    """
    _check_xi(xi)
    wrong = decision.choice != truth
    steps = np.where(np.isnan(decision.steps), decision.deadline_ms / decision.step_ms, 0)
    return -xi * wrong - np.fmax(decision.steps, steps)


def mean_reward(counts: Tally, xi: float) -> FloatArray:
    """Return the mean reward a trial for each threshold of a tally, (K,)."""
    _check_xi(xi)
    return -xi * (1 - counts.accuracy) - counts.mean_steps


def exhaustive_search(evidence: Evidence | Iterable[Evidence], deltas: npt.ArrayLike) -> Tally:
    """Try every gap on every trial.

    Parameters
    ----------
    evidence : Evidence, or an iterable of blocks of it
        Two hypotheses.  Large sets are cut into blocks that stay in a processor's cache.
    deltas : array (K,), nats
        Gaps to try; one pass serves all.

    Returns
    -------
    Tally
        Whose ``accuracy``, ``mean_steps`` and ``mean_reward`` have one entry a gap.
    """
    thresholds = threshold_from_gap(np.atleast_1d(deltas))
    total: Tally | None = None
    for block in [evidence] if isinstance(evidence, Evidence) else evidence:
        for start in range(0, block.trials, BLOCK):
            part = block[start : start + BLOCK]
            counts = tally(Sprt().run(part), part.truth, thresholds)
            total = counts if total is None else total + counts
    if total is None:
        raise ValueError("exhaustive search needs at least one trial, got none")
    return total


BLOCK = 4096


class Policy(Protocol):
    """A distribution over gaps with parameters, for several independent runs at once."""

    pace: float
    """How many times the learner's step size suits the parameters."""

    def start(self, runs: int, delta: float) -> FloatArray:
        """Return parameters (runs, p) whose mean gap is ``delta``."""
        ...

    def sample(
        self, parameters: FloatArray, noise: FloatArray, episode: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return gaps (runs,) and the gradient of log probability (runs, p)."""
        ...

    def mean(self, parameters: FloatArray) -> FloatArray:
        """Return the mean gap of each run, (runs,)."""
        ...

    def bounded(self, parameters: FloatArray) -> FloatArray:
        """Return parameters held within the range that the policy allows."""
        ...

    @property
    def noise(self) -> int:
        """How many standard normal numbers a sample takes."""
        ...


@dataclass(frozen=True)
class GaussianPolicy:
    """``delta ~ N(mu, sd)``, played within ``DELTA_RANGE`` (Williams 1992).

    Exploration starts wide, where the slope of a flat reward shows best, and narrows.
    """

    sd_nats: float = 2.0
    """Exploration at the start, sd of the gap, nats; assumed (not printed)."""
    last_sd_nats: float = 0.4
    """Exploration in the end, nats; assumed."""
    half_episodes: float = 2_000.0
    """Trials after which half of the way from the first to the last sd is gone; assumed."""
    noise = 1
    pace = 1.0

    def sd(self, episode: int) -> float:
        """Return the exploration in a trial, nats."""
        wide = self.sd_nats - self.last_sd_nats
        return self.last_sd_nats + wide / (1 + episode / self.half_episodes)

    def start(self, runs: int, delta: float) -> FloatArray:
        """Return mu (runs, 1)."""
        return np.full((runs, 1), float(delta))

    def sample(
        self, parameters: FloatArray, noise: FloatArray, episode: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return gaps (runs,) and d log p / d mu (runs, 1)."""
        sd = self.sd(episode)
        return np.clip(parameters[:, 0] + sd * noise[:, 0], *DELTA_RANGE), noise / sd

    def mean(self, parameters: FloatArray) -> FloatArray:
        """Return mu (runs,)."""
        return parameters[:, 0]

    def bounded(self, parameters: FloatArray) -> FloatArray:
        """Hold mu within ``DELTA_RANGE``."""
        return np.clip(parameters, *DELTA_RANGE)


@dataclass(frozen=True)
class BernoulliPolicy:
    """A gap coded by stochastic binary units: ``delta = sum_j s_j y_j`` (Lepora 2016).

    ``y_j`` is 1 with probability ``logistic(w_j)`` and the ``s_j`` fall as powers of two, so that
    all units on give the top of ``DELTA_RANGE``.
    """

    units: int = 8
    """Number of units; assumed."""
    saturation: float = 4.0
    """Largest |w_j|, so that no unit ever stops exploring; assumed."""

    # The gap moves by s_j p (1 - p), less than one, for each unit of w.
    pace = 8.0

    @property
    def noise(self) -> int:
        """One number a unit."""
        return self.units

    @property
    def sizes(self) -> FloatArray:
        """``s_j`` (units,), nats."""
        powers = 0.5 ** np.arange(1, self.units + 1)
        return DELTA_RANGE[1] * powers / powers.sum()

    def start(self, runs: int, delta: float) -> FloatArray:
        """Return w (runs, units), all equal, with mean gap ``delta``."""
        p = np.clip(delta / DELTA_RANGE[1], 1e-9, 1 - 1e-9)
        return self.bounded(np.full((runs, self.units), np.log(p / (1 - p))))

    def sample(
        self, parameters: FloatArray, noise: FloatArray, episode: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return gaps (runs,) and ``y_j - p_j`` (runs, units)."""
        from scipy.special import expit, ndtr

        p = expit(parameters)
        y = ndtr(noise) < p
        return y @ self.sizes, y - p

    def mean(self, parameters: FloatArray) -> FloatArray:
        """Return ``sum_j s_j p_j`` (runs,)."""
        from scipy.special import expit

        return expit(parameters) @ self.sizes

    def bounded(self, parameters: FloatArray) -> FloatArray:
        """Hold every w within the saturation."""
        return np.clip(parameters, -self.saturation, self.saturation)


@dataclass(frozen=True)
class Learner:
    """REINFORCE with baseline (Williams 1992; Sutton & Barto 2018, section 13.4)."""

    episodes: int = 40_000
    """Trials of learning; assumed (not printed)."""
    rate: float = 0.04
    """Step size at the start, on the prediction error as a share of the baseline; assumed (not
    printed)."""
    half_episodes: float = 1_000.0
    """Trials after which the step size has halved, rate / (1 + k / half); assumed."""
    baseline_rate: float = 0.01
    """Share of each reward in the running baseline; its inverse is the number of trials that only
    measure the baseline before learning starts; assumed."""
    last: int = 500
    """The learned value is the mean of so many last trials; Burguete, Griffith & Lepora 2023."""

    def __post_init__(self) -> None:
        if not self.episodes >= self.last >= 1:
            raise ValueError(
                f"episodes must be at least last ({self.last}) >= 1, got {self.episodes}"
            )
        for name in ("rate", "half_episodes", "baseline_rate"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be > 0, got {getattr(self, name)}")


@dataclass(frozen=True)
class Learned:
    """What learning did: arrays (runs, episodes) of gap, mean gap, reward, prediction error.

    ``delta`` (runs,) is the learned value.  The prediction error, reward minus its learned
    baseline, is what dopamine is taken to report.
    """

    gap: FloatArray
    mean_gap: FloatArray
    reward: FloatArray
    prediction_error: FloatArray
    delta: FloatArray


Environment = Callable[[int, FloatArray], FloatArray]


def learn(
    environment: Environment,
    start_delta: npt.ArrayLike,
    *,
    rngs: list[np.random.Generator],
    policy: Policy | None = None,
    learner: Learner | None = None,
) -> Learned:
    """Learn the gap in several independent runs, side by side.

    Parameters
    ----------
    environment : callable
        ``environment(episode, gaps (runs,)) -> rewards (runs,)``; see ``trials_of``.
    start_delta : float, nats
        Mean gap at the start.
    rngs : list of numpy.random.Generator
        One a run, for its exploration alone: a run's course does not depend on its neighbours.
    policy, learner :
        What explores, and how it learns.

    Raises
    ------
    ValueError
        If a reward is not finite.
    """
    policy, learner = policy or GaussianPolicy(), learner or Learner()
    runs, episodes = len(rngs), learner.episodes
    noise = np.stack([rng.standard_normal((episodes, policy.noise)) for rng in rngs], axis=1)
    parameters = policy.start(runs, float(np.asarray(start_delta)))
    gap, mean_gap, rewards, errors = (np.empty((runs, episodes)) for _ in range(4))
    baseline = np.zeros(runs)
    for k in range(episodes):
        mean_gap[:, k] = policy.mean(parameters)
        gap[:, k], gradient = policy.sample(parameters, noise[k], k)
        r = environment(k, gap[:, k])
        if not np.isfinite(r).all():
            raise ValueError(f"a reward must be finite, got {r[~np.isfinite(r)][0]} in episode {k}")
        error = r - baseline if k else np.zeros(runs)
        scale = baseline  # of earlier trials alone, so that the gradient stays unbiased
        baseline = baseline + max(learner.baseline_rate, 1 / (k + 1)) * (r - baseline)
        if k * learner.baseline_rate >= 1:
            rate = policy.pace * learner.rate / (1 + k / learner.half_episodes)
            share = error / np.maximum(np.abs(scale), 1.0)  # a reading is the least a trial costs
            parameters = policy.bounded(parameters + rate * share[:, None] * gradient)
        rewards[:, k], errors[:, k] = r, error
    return Learned(gap, mean_gap, rewards, errors, mean_gap[:, -learner.last :].mean(axis=1))


def trials_of(
    draws: Sequence[Callable[[int], Evidence]], xi: float, block: int = 500
) -> Environment:
    """Return an environment whose run i decides the trials of ``draws[i]``.

    Parameters
    ----------
    draws : list of callables
        ``draws[i](trials)`` returns the next trials of run i, from that run's own generator.
    xi : float
        Cost of an error in readings.
    block : int
        How many trials are drawn at a time.
    """
    _check_xi(xi)
    out: list[npt.NDArray] = []
    truth: list[npt.NDArray] = []
    traces: list[Trace] = []

    def rewards(episode: int, gaps: FloatArray) -> FloatArray:
        if episode % block == 0:
            parts = [draw(block) for draw in draws]
            traces[:] = [Sprt().run(part) for part in parts]
            out[:] = [np.stack([trace.out_nats for trace in traces], axis=1)]
            truth[:] = [np.stack([part.truth for part in parts], axis=1)]  # type: ignore[misc]
        now = episode % block
        trace = replace(traces[0], out_nats=out[0][now])
        decision = crossing_of_each(trace, threshold_from_gap(gaps))
        return reward(decision, truth[0][now], xi)

    return rewards


def smoothed(curve: FloatArray, window: int) -> FloatArray:
    """Return the running mean of the last axis over ``window`` trials, shorter at the start."""
    if window < 1:
        raise ValueError(f"window must be >= 1, got {window}")
    total = np.cumsum(np.insert(curve, 0, 0.0, axis=-1), axis=-1)
    end = np.arange(1, curve.shape[-1] + 1)
    begin = np.maximum(end - window, 0)
    return (total[..., end] - total[..., begin]) / (end - begin)


def _check_xi(xi: float) -> None:
    if not (np.isfinite(xi) and xi > 0):
        raise ValueError(f"xi must be > 0 readings, got {xi}")
