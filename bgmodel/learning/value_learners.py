"""Learners of the values of two actions, from the reward of the chosen one; trials of people.

A state is an array (parts, ..., 2): what is learned of either arm, in any number of learners side
by side. Options are numbers, or arrays that broadcast with (...), one number per learner. Where
options were tuned, it was for reversals every 50 trials at probabilities of 0.8 and 0.2, by
``benchmarks.tuning.values``. People learn pairs of items, one pair at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from bgmodel.learning.critics import made
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.errors import InputError, require

Number = float | Array
"""An option: one for all learners, or one for each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ValueLearner:
    """Base class: what is learned, and the values on which choices depend.

    The probability of choosing arm 1 is ``expit(beta (V_1 - V_0))``.
    """

    name: ClassVar[str] = ""
    limits: ClassVar[dict[str, tuple[float, float]]] = {}
    """Range of each option."""
    beta: Number = 1.0
    """Inverse temperature of choices; infinite if the larger value is always chosen."""

    def __post_init__(self) -> None:
        for field in fields(self):
            low, high = self.limits.get(field.name, (0.0, np.inf))
            check_option(field.name, getattr(self, field.name), low, high)

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return the state before the first trial: parts, the shape, and 2 arms."""
        raise NotImplementedError

    def values(self, state: Array) -> Array:
        """Return the value of either arm, (..., 2)."""
        return np.asarray(state[0])

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Return the state (parts, ..., 2) after a trial; ``chosen`` is 1 for the chosen arm."""
        raise NotImplementedError

    def probability(self, state: Array) -> Array:
        """Return the probability of choosing arm 1, (...)."""
        values = self.values(state)
        ahead = values[..., 1] - values[..., 0]
        with np.errstate(invalid="ignore"):  # an infinite beta times 0
            return np.where(ahead == 0, 0.5, expit(self.beta * ahead))


@dataclass(frozen=True, eq=False, kw_only=True)
class QLearning(ValueLearner):
    """``Q_c`` moves towards the reward by a share of the error (Rescorla & Wagner 1972)."""

    name: ClassVar[str] = "q"
    limits: ClassVar[dict[str, tuple[float, float]]] = {"rate": (0.0, 1.0), "rate_minus": (0, 1)}
    rate: Number = 0.9
    """Learning rate; that of positive errors if there are two."""
    rate_minus: Number | None = None
    """Learning rate of negative errors; by default the same."""
    beta: Number = 40.0

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return values of 0.5."""
        return np.full((1, *shape, 2), 0.5)

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Move the value of the chosen arm."""
        error = reward[..., None] - state
        return np.asarray(state + _rates(self, error) * chosen * error)


@dataclass(frozen=True, eq=False, kw_only=True)
class QBoth(QLearning):
    """Q learning that moves the value of the other arm towards ``1 - r`` as well."""

    name: ClassVar[str] = "q-both"
    rate: Number = 0.2
    beta: Number = np.inf

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Move both values."""
        r = reward[..., None]
        error = np.where(chosen > 0, r, 1 - r) - state
        return np.asarray(state + _rates(self, error) * error)


@dataclass(frozen=True, eq=False, kw_only=True)
class LogitQ(QLearning):
    """Q learning whose choices depend on the log-odds of a reward, ``logit Q``."""

    name: ClassVar[str] = "logit-q"
    margin: float = 0.01
    """Q is clipped to between this and 1 minus this."""
    beta: Number = np.inf

    def values(self, state: Array) -> Array:
        """Return ``logit Q``."""
        return np.asarray(logit(np.clip(state[0], self.margin, 1 - self.margin)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Confidence(ValueLearner):
    """The confidence rule: the error is the reward minus that expected from confidence.

    It is ``low + (high - low) P_c`` with ``P_c = softmax(w)_c``; weights move apart by the error.
    With ``low`` and ``high`` those of the bandit, the exact log-odds are a fixed point.
    """

    name: ClassVar[str] = "confidence"
    limits: ClassVar[dict[str, tuple[float, float]]] = {
        "decay": (0.0, 1.0), "low": (0.0, 1.0), "high": (0.0, 1.0)
    }  # fmt: skip
    rate: Number = 0.25
    """Nats per unit of error; that of positive errors if there are two."""
    rate_minus: Number | None = None
    """The same for negative errors."""
    low: Number = 0.0
    """Reward expected at a confidence of 0."""
    high: Number = 1.0
    """Reward expected at a confidence of 1."""
    decay: Number = 0.1
    """Share of the weights that is forgotten in each trial."""
    beta: Number = np.inf

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return weights of 0 nats."""
        return np.zeros((1, *shape, 2))

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Move the weights of both arms, in opposite directions."""
        side = 2 * chosen - 1
        confidence = expit((side * state[0]).sum(axis=-1))
        error = (reward - self.low - (self.high - self.low) * confidence)[..., None]
        return np.asarray(_kept(self, state) + _rates(self, error) * side * error)


@dataclass(frozen=True, eq=False, kw_only=True)
class Opal(ValueLearner):
    """OpAL (Collins & Frank 2014): go and no-go weights that learn in proportion to themselves.

    ``dG_c = rate G_c error``, ``dN_c = -rate N_c error``; the value is ``(1 + rho) G - (1 - rho)
    N``.
    """

    name: ClassVar[str] = "opal"
    limits: ClassVar[dict[str, tuple[float, float]]] = {
        "rate": (0.0, 1.0), "critic_rate": (0.0, 1.0), "decay": (0.0, 1.0), "rho": (-1.0, 1.0)
    }  # fmt: skip
    rate: Number = 1.0
    """Learning rate of G and N."""
    critic_rate: Number = 0.0
    """Learning rate of the critic."""
    decay: Number = 0.2
    """Share of the distance of G and N from 1 that is forgotten in each trial."""
    rho: Number = 0.0
    """Dopamine at the choice; 0 weighs G and N alike."""
    most: float = 20.0
    """Largest G and N; assumed, because growth in proportion to themselves has no limit."""
    beta: Number = 40.0

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return G and N of 1, and a critic of 0.5."""
        return np.stack([np.ones((*shape, 2)), np.ones((*shape, 2)), np.full((*shape, 2), 0.5)])

    def values(self, state: Array) -> Array:
        """Return ``(1 + rho) G - (1 - rho) N``."""
        rho = np.asarray(self.rho)[..., None]
        return np.asarray((1 + rho) * state[0] - (1 - rho) * state[1])

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Move G and N of the chosen arm, and the critic."""
        error = reward[..., None] - state[2]
        step = np.asarray(self.rate)[..., None] * chosen * error
        kept = 1 + (1 - np.asarray(self.decay)[..., None]) * (state[:2] - 1)
        actor = np.clip(kept + state[:2] * np.stack([step, -step]), 0.0, self.most)
        critic = state[2] + np.asarray(self.critic_rate)[..., None] * error
        return np.concatenate([actor, critic[None]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Reinforce(ValueLearner):
    """REINFORCE (Williams 1992): ``dw_i = rate (r - mean) (1[i = c] - P_i)``, P = softmax(w)."""

    name: ClassVar[str] = "reinforce"
    limits: ClassVar[dict[str, tuple[float, float]]] = {
        "mean_rate": (0.0, 1.0), "decay": (0.0, 1.0), "beta": (1.0, 1.0)
    }  # fmt: skip
    rate: Number = 4.0
    """Step size."""
    mean_rate: Number = 0.0
    """Learning rate of the mean reward, the baseline."""
    decay: Number = 0.1
    """Share of the weights that is forgotten in each trial; without it the policy becomes certain,
    and then learns nothing from a reversal."""

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return weights of 0 and a mean of 0.5."""
        return np.stack([np.zeros((*shape, 2)), np.full((*shape, 2), 0.5)])

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Move both weights along the gradient of the expected reward, and the mean."""
        weights, mean = state
        p = self.probability(state)
        policy = np.stack([1 - p, p], axis=-1)
        error = reward[..., None] - mean
        step = np.asarray(self.rate)[..., None] * error * (chosen - policy)
        return np.stack(
            [_kept(self, weights) + step, mean + np.asarray(self.mean_rate)[..., None] * error]
        )


LEARNERS: dict[str, Callable[[], ValueLearner]] = {
    one.name: one for one in (QLearning, QBoth, LogitQ, Confidence, Opal, Reinforce)
}
"""Learners by name, with their default options."""


def learner_of(learner: ValueLearner | str) -> ValueLearner:
    """Return a learner, given as such or by name; ValueError for an unknown name."""
    return learner if isinstance(learner, ValueLearner) else made("learner", learner, LEARNERS)


def check_option(name: str, value: Any, low: float, high: float) -> None:
    """Raise ValueError unless all numbers of an option are within a range; None is allowed."""
    if value is None:
        return
    try:
        numbers: npt.NDArray[np.float64] = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError.of(name, "must be a number", value) from None
    if not ((numbers >= low) & (numbers <= high)).all():
        raise InputError.of(name, f"must be within {low:g}..{high:g}", value)


def _rates(learner: QLearning | Confidence, error: Array) -> Array:
    plus = np.asarray(learner.rate)[..., None]
    if learner.rate_minus is None:
        return plus
    return np.where(error > 0, plus, np.asarray(learner.rate_minus)[..., None])


def _kept(learner: Confidence | Reinforce, state: Array) -> Array:
    return np.asarray((1 - np.asarray(learner.decay)[..., None]) * state)


@dataclass(frozen=True, eq=False)
class Pairs:
    """The trials of one person by pair, from which values are learned; see ``pairs_of``."""

    names: tuple[str, ...]
    pair: Integers  # (trials,), index of the pair
    within: Integers  # (trials,), number within the pair, from 0
    chosen: Array  # (longest, pairs, 2), 1 if chosen; the better item is the second
    reward: Array  # (longest, pairs), 0 after the last trial of a pair
    last_choice: Array  # (trials,), last choice of the same pair: 1 or -1; 0 before the first


@lru_cache(maxsize=256)
def pairs_of(trials: Trials) -> Pairs:
    """Return the trials of one person by pair, in the order of presentation."""
    who, columns = trials.people(), trials.conditions
    require(len(who) == 1, "participant", "must be one person, who learns", ", ".join(who))
    for name in ("response", "reward"):
        codes = np.unique(np.asarray(getattr(trials, name), dtype=np.float64))
        require(np.isin(codes, (0, 1)).all(), name, "must be 0 or 1 in every trial", codes)
    require("pair" in columns, "pair", "must be a condition of the trials", list(columns))
    require(
        not trials.timed or (trials.rt_s > 0).all(),
        "rt",
        "must be above 0 s in every trial",
        trials.rt_s.min(),
    )
    names, pair = np.unique(columns["pair"].to_numpy(dtype=str), return_inverse=True)
    counts = np.bincount(pair)
    must = "must have two trials or more in every pair: values are learned from earlier ones"
    require(counts.min() > 1, "pair", must, names[counts < 2].tolist())
    within = np.empty(trials.trials, dtype=np.intp)
    for k, count in enumerate(counts):
        within[pair == k] = np.arange(count)
    better, reward = np.zeros((2, counts.max(), len(names)))
    better[within, pair], reward[within, pair] = trials.response, trials.reward
    before = np.concatenate([np.zeros((1, len(names))), 2 * better[:-1] - 1])
    chosen = np.stack([1 - better, better], axis=-1)
    return Pairs(tuple(names.tolist()), pair, within, chosen, reward, before[within, pair])
