"""Learning from reward: search, REINFORCE with a baseline and a policy, and environments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import crossing_of_each
from bgmodel.deciding.reward import Tally, reward, reward_of
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.sprt import Sprt, tally_sprt
from bgmodel.support.checks import check_positive
from circuits.arrays import Array, Integers, Reals, Truths
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd

# Range of gaps, nats (that of the paper's exhaustive search).
SEPARATIONS = (0.0, 8.0)


@dataclass(frozen=True)
class GaussianPolicy:
    """``x ~ N(mu, sd)``, clipped to bounds (Williams 1992): a gap, or a level of dopamine.

    Exploration starts wide, to detect the slope of a flat reward, and narrows.
    """

    bounds: tuple[float, float] = SEPARATIONS
    """Lowest and highest action."""
    first_share: float = 0.25
    """Initial exploration, sd as a share of the range; assumed (not printed in the paper)."""
    last_share: float = 0.05
    """Final exploration, sd as a share of the range; assumed."""
    half_episodes: float = 2_000.0
    """Trials after which the sd is half-way between its first and last value; assumed."""

    def __post_init__(self) -> None:
        if not -np.inf < self.bounds[0] < self.bounds[1] < np.inf:
            raise InputError.of("bounds", "must rise", self.bounds)
        check_positive(first_share=self.first_share, last_share=self.last_share)
        require(self.half_episodes > 0, "half_episodes", "must be > 0", self.half_episodes)

    @property
    def pace(self) -> float:
        """Factor on the step, which suits bounds 8 nats apart: the ratio of ranges, squared."""
        return ((self.bounds[1] - self.bounds[0]) / (SEPARATIONS[1] - SEPARATIONS[0])) ** 2

    def sd(self, episode: int) -> float:
        """Return the exploration (sd) in a trial, in the unit of actions."""
        wide = self.first_share - self.last_share
        share = self.last_share + wide / (1 + episode / self.half_episodes)
        return share * (self.bounds[1] - self.bounds[0])

    def sample(self, mean: Array, noise: Array, episode: int) -> tuple[Array, Array]:
        """Return actions, (runs,), and d log p / d mu."""
        sd = self.sd(episode)
        return np.clip(mean + sd * noise, *self.bounds), noise / sd


def exhaustive_search(evidence: Evidence | Iterable[Evidence], separations: npt.ArrayLike) -> Tally:
    """Count decisions at every gap, (K,) nats, on every trial of two hypotheses, in one pass."""
    thresholds = Sprt.threshold(np.atleast_1d(separations))
    total: Tally | None = None
    for block in [evidence] if isinstance(evidence, Evidence) else evidence:
        counts = tally_sprt(block, thresholds)
        total = counts if total is None else total + counts
    if total is None:
        raise InputError("exhaustive search needs at least one trial, got none", "evidence")
    return total


@dataclass(frozen=True)
class Learner:
    """REINFORCE with a baseline (Williams 1992; Sutton & Barto 2018, section 13.4)."""

    episodes: int = 40_000
    """Number of trials of learning; assumed (not printed in the paper)."""
    rate: float = 0.04
    """Initial step size, for the prediction error as a share of the baseline; assumed (not printed
    in the paper)."""
    half_episodes: float = 1_000.0
    """Trials after which the step size has halved, rate / (1 + k / half); assumed. With inf it
    stays constant, as required in a changing environment."""
    baseline_rate: float = 0.01
    """Weight of each reward in the running baseline; its inverse is the number of initial trials
    that only measure the baseline, before learning starts; assumed."""
    last: int = 500
    """Number of last trials whose mean is the learned value; Burguete, Griffith & Lepora 2023."""

    def __post_init__(self) -> None:
        fits = self.episodes >= self.last >= 1
        require(
            fits,
            "episodes",
            f"must be at least last, {self.last} trials, whose mean is learned",
            self.episodes,
        )
        check_positive(rate=self.rate, baseline_rate=self.baseline_rate)
        slow = 1 / self.episodes
        must = f"must be above {slow:.3g}, or no trial is left to learn from, and at most 1"
        require(slow < self.baseline_rate <= 1, "baseline_rate", must, self.baseline_rate)
        require(self.half_episodes > 0, "half_episodes", "must be > 0", self.half_episodes)


@dataclass(frozen=True)
class Learned:
    """The course of learning in several runs; actions are gaps or levels of dopamine."""

    played: Array  # (runs, episodes), nats or level
    mean_played: Array  # (runs, episodes), before exploration; the tonic level
    reward: Array  # (runs, episodes), readings
    prediction_error: Array  # (runs, episodes), reward minus its baseline: phasic dopamine
    learned: Array  # (runs,), mean_played over the last trials

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per trial and run; ``dopamine`` is the prediction error."""
        import pandas as pd

        runs, episodes = self.played.shape
        columns = {
            "run": np.repeat(np.arange(runs), episodes),
            "episode": np.tile(np.arange(episodes), runs),
            "mean": self.mean_played.ravel(),
            "played": self.played.ravel(),
            "reward": self.reward.ravel(),
            "dopamine": self.prediction_error.ravel(),
        }
        return pd.DataFrame(columns)


Environment = Callable[[int, Array], Array]


def learn(
    environment: Environment,
    start: npt.ArrayLike,
    *,
    rngs: list[np.random.Generator],
    policy: GaussianPolicy | None = None,
    learner: Learner | None = None,
) -> Learned:
    """Learn a gap (nats) or a level of dopamine in several independent runs in parallel.

    ``environment(episode, played (runs,))`` returns rewards, (runs,): see ``trials_of`` and
    ``LevelOutcomes``. Each run has its own generator, so that runs are independent. Raises
    ValueError if a value is not finite.
    """
    policy, learner = policy or GaussianPolicy(), learner or Learner()
    runs, episodes = len(rngs), learner.episodes
    noise = np.stack([rng.standard_normal(episodes) for rng in rngs], axis=1)
    mu = np.broadcast_to(np.asarray(start, float), runs)
    played, mean, rewards, errors = (np.empty((runs, episodes)) for _ in range(4))
    baseline = np.zeros(runs)
    for k in range(episodes):
        mean[:, k] = mu
        played[:, k], gradient = policy.sample(mu, noise[k], k)
        r = environment(k, played[:, k])
        if not (np.isfinite(r).all() and np.isfinite(mu).all()):
            what = "a reward" if not np.isfinite(r).all() else "a learned value"
            raise ValueError(f"{what} is not finite in episode {k}")
        error = r - baseline if k else np.zeros(runs)
        scale = baseline  # from earlier trials only, so that the gradient stays unbiased
        baseline = baseline + max(learner.baseline_rate, 1 / (k + 1)) * (r - baseline)
        share = error / np.maximum(np.abs(scale), 1.0)  # a trial costs at least one reading
        if k * learner.baseline_rate >= 1:
            rate = policy.pace * learner.rate / (1 + k / learner.half_episodes)
            mu = np.clip(mu + rate * share * gradient, *policy.bounds)
        rewards[:, k], errors[:, k] = r, error
    return Learned(played, mean, rewards, errors, mean[:, -learner.last :].mean(axis=1))


def smoothed(curve: Array, window: int) -> Array:
    """Return the running mean of the last axis over ``window`` trials, shorter at the start."""
    require(window >= 1, "window", "must be >= 1", window)
    total = np.cumsum(np.insert(curve, 0, 0.0, axis=-1), axis=-1)
    end = np.arange(1, curve.shape[-1] + 1)
    begin = np.maximum(end - window, 0)
    return np.asarray((total[..., end] - total[..., begin]) / (end - begin))


def trials_of(
    draws: Sequence[Callable[[int], Evidence]], xi: float, block: int = 1000
) -> Environment:
    """Return an environment whose run i decides trials that ``draws[i](trials)`` returns.

    Trials are drawn ``block`` at a time, by the generator of their run.
    """
    check_positive(xi=xi)
    drawn = -1
    out: list[Reals] = []
    truth: list[Integers] = []
    ends: list[Integers] = []
    traces: list[Trace] = []

    def rewards(episode: int, gaps: Array) -> Array:
        nonlocal drawn
        if episode // block != drawn:
            drawn = episode // block
            parts = [draw(block) for draw in draws]
            traces[:] = [Sprt().run(part) for part in parts]
            out[:] = [np.stack([trace.out_nats for trace in traces], axis=1)]
            truth[:] = [np.stack([part.truth for part in parts], axis=1)]  # type: ignore[misc]
            ends[:] = [np.stack([part.readings for part in parts], axis=1) + 1]
        now = episode % block
        # The same trial of every run: its number is that of the episode.
        numbers = np.full(len(draws), episode)
        trace = replace(traces[0], out_nats=out[0][now], ends=ends[0][now], numbers=numbers)
        decision = crossing_of_each(trace, Sprt.threshold(gaps), checked=False)
        return reward(decision, truth[0][now], xi)

    return rewards


@dataclass(frozen=True)
class LevelOutcomes:
    """Outcomes of a circuit's decisions at each level of dopamine, on the same trials."""

    levels: Array  # (K,), increasing
    correct: Truths  # (K, trials)
    steps: Array  # (K, trials), readings, all latencies included
    forced: Array  # (K,), share decided by the deadline

    def __post_init__(self) -> None:
        shape = (len(self.levels), self.correct.shape[-1])
        for name, values in (("correct", self.correct), ("steps", self.steps)):
            require(values.shape == shape, name, f"must be {shape}", values.shape)
        require(np.all(np.diff(self.levels) > 0), "levels", "must rise", self.levels)

    @classmethod
    def of(cls, swept: Tradeoff, evidence: Evidence) -> LevelOutcomes:
        """Return the outcomes of decisions, given the truth."""
        truth = needed_truth(evidence)
        same = f"must be of {swept.trials} trials, as the decisions"
        require(evidence.trials == swept.trials, "evidence", same, evidence.trials)
        steps = np.maximum(swept.time_ms, 0.0) / evidence.step_ms
        correct = swept.choice == truth
        forced = swept.forced.mean(axis=1)
        return cls(swept.settings[::-1], correct[::-1], steps[::-1], forced[::-1])

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.correct.shape[-1])

    def rewards(self, xi: float) -> Array:
        """Return ``r = xi W - T`` of each level and trial, (K, trials)."""
        return reward_of(~self.correct, self.steps, xi)

    def expected(self, level: npt.ArrayLike, xi: float) -> Array:
        """Return the mean reward at levels, interpolated linearly; NaN outside their range."""
        means: Array = self.rewards(xi).mean(axis=1)
        asked = np.asarray(level, dtype=np.float64)
        return np.interp(asked, self.levels, means, left=np.nan, right=np.nan)

    def best(self, xi: float) -> tuple[float, float]:
        """Return the level with the highest mean reward, and that reward, by exhaustive search."""
        means: Array = self.rewards(xi).mean(axis=1)
        return float(self.levels[means.argmax()]), float(means.max())

    def regrets(self, level: float, xi: float, weights: Array) -> Array:
        """Return a level's excess cost over the best per resample (row of weights), per cent."""
        means = weights @ self.rewards(xi).T / weights.sum(axis=1, keepdims=True)
        place = np.interp(level, self.levels, np.arange(len(self.levels)))
        low = min(int(place), max(len(self.levels) - 2, 0))
        high = min(low + 1, len(self.levels) - 1)
        mean = (1 - place + low) * means[:, low] + (place - low) * means[:, high]
        best = means.max(axis=1)
        return np.asarray(100 * (best - mean) / np.abs(best))

    def at_edge(self, xi: float) -> str:
        """Return "lower" or "upper" if the best level is the first or the last, otherwise ""."""
        best = int(self.rewards(xi).mean(axis=1).argmax())
        return {0: "lower", len(self.levels) - 1: "upper"}.get(best, "")

    def unresolved(self, xi: float, weights: Array) -> float:
        """Return the regret to be expected from choosing the best level on this number of trials.

        Each row of weights (resamples, trials) represents other trials, whose best level is scored
        on these: the regret, as a share of the least cost, is averaged over rows. Learning from
        these trials, however long, is no better.
        """
        rewards = self.rewards(xi)
        means = rewards.mean(axis=1)
        chosen = (weights @ rewards.T).argmax(axis=1)
        return float((means.max() - means[chosen]).mean() / abs(means.max()))

    def environment(self, xi: float, rngs: Sequence[np.random.Generator]) -> Environment:
        """Return the environment of a learner: maps levels, one per run, to rewards.

        Each run samples from the simulated trials. A level between two simulated ones is randomly
        replaced by one of them, such that the mean reward is linear in between.
        """
        table = self.rewards(xi)
        count, trials = table.shape
        where = np.arange(count, dtype=np.float64)

        def rewards(episode: int, played: Array) -> Array:
            place = np.interp(played, self.levels, where)
            chance = np.array([rng.random(2) for rng in rngs])
            row = np.minimum(np.floor(place + chance[:, 0]).astype(np.intp), count - 1)
            return np.asarray(table[row, (chance[:, 1] * trials).astype(np.intp)])

        return rewards
