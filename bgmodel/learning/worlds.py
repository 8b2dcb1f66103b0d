"""Environments of a learner, which map actions to rewards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import crossing_of_each
from bgmodel.deciding.reward import reward, reward_of
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.sprt import Sprt
from bgmodel.learning.reinforce import Environment
from bgmodel.support.arrays import Array, Integers, Reals, Truths
from bgmodel.support.checks import check_positive
from circuits.errors import require


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
