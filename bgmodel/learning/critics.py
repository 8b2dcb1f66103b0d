"""Critics: the reward that a learner of weights expects when it has chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeVar

import numpy as np

from bgmodel.support.checks import check_range
from circuits.arrays import Array, Integers
from circuits.errors import InputError

Made = TypeVar("Made")


@dataclass(frozen=True)
class Trial:
    """One trial of every learner, as critics and rules see it."""

    eligibility: Array  # (runs, units), trace of the features up to the decision
    choice: Integers  # (runs,)
    posterior: Array  # (runs, hypotheses), softmax of the drive by the readings up to the decision
    read_out: Array  # (runs,), posterior of the choice by noisy OUT, exp(-OUT_c)
    reward: Array  # (runs,), 1 for a correct choice and 0 for an error

    def of_choice(self, values: Array) -> Array:
        """Return the value of the chosen hypothesis (runs,) from (runs, hypotheses)."""
        return np.asarray(values[np.arange(len(self.choice)), self.choice])


@dataclass(frozen=True)
class Critic:
    """Base class: expected reward, and what is learned about it."""

    name: ClassVar[str] = ""

    def start(self, runs: int) -> Array:
        """Return the learned parameters, (runs, p)."""
        return np.zeros((runs, 0))

    def expected(self, state: Array, trial: Trial) -> Array:
        """Return the expected reward, (runs,)."""
        raise NotImplementedError

    def learn(self, state: Array, trial: Trial, error: Array) -> Array:
        """Return the state after a trial; the error is the reward less what was expected."""
        return state


@dataclass(frozen=True)
class RunningMean(Critic):
    """The running mean of rewards, whatever the confidence: a scalar baseline."""

    name: ClassVar[str] = "mean"
    rate: float = 0.01
    """Weight of each reward."""

    def __post_init__(self) -> None:
        check_range(0, 1, rate=self.rate)

    def start(self, runs: int) -> Array:
        """Return the mean, 0, and the number of rewards."""
        return np.zeros((runs, 2))

    def expected(self, state: Array, trial: Trial) -> Array:
        """Return the mean reward of earlier trials."""
        return state[:, 0]

    def learn(self, state: Array, trial: Trial, error: Array) -> Array:
        """Move the mean towards the reward; the first rewards count equally."""
        count = state[:, 1] + 1
        rate = np.maximum(self.rate, 1 / count)
        surprise = trial.reward - state[:, 0]
        return np.stack([state[:, 0] + rate * surprise, count], axis=1)


@dataclass(frozen=True)
class ConfidenceCritic(Critic):
    """The posterior of the choice, P_c: the probability of a reward if the weights are exact."""

    name: ClassVar[str] = "confidence"

    def expected(self, state: Array, trial: Trial) -> Array:
        """Return P_c."""
        return trial.of_choice(trial.posterior)


@dataclass(frozen=True)
class ReadOutConfidence(Critic):
    """P_c as read from the output of the circuit, SNr, up to the highest that it can express.

    Beyond that, confidences cannot be told apart. The expected reward is then the running mean of
    rewards in such trials, because it would be too low at the limit itself, and weights would grow.
    """

    name: ClassVar[str] = "read-out"
    ceiling: float = 0.947
    """Highest posterior; that of the default circuit, ``exp(-readable_nats[0])``."""
    rate: float = 0.01
    """Weight of each reward in the running mean; 0 keeps it at the ceiling."""

    def __post_init__(self) -> None:
        check_range(0, 1, ceiling=self.ceiling, rate=self.rate)

    def start(self, runs: int) -> Array:
        """Return the mean reward beyond the ceiling, the ceiling itself, (runs, 1)."""
        return np.full((runs, 1), self.ceiling)

    def expected(self, state: Array, trial: Trial) -> Array:
        """Return ``exp(-OUT_c)``, or the mean reward beyond the ceiling."""
        return np.where(trial.read_out < self.ceiling, trial.read_out, state[:, 0])

    def learn(self, state: Array, trial: Trial, error: Array) -> Array:
        """Move the mean reward beyond the ceiling."""
        beyond = trial.read_out >= self.ceiling
        return np.asarray(state + (self.rate * beyond * error)[:, None])


CRITICS: dict[str, Callable[[], Critic]] = {
    critic.name: critic for critic in (RunningMean, ConfidenceCritic, ReadOutConfidence)
}
"""Critics by name, with their default options."""


def critic_of(critic: Critic | str) -> Critic:
    """Return a critic, given as such or by name; ValueError for an unknown name."""
    return critic if isinstance(critic, Critic) else made("critic", critic, CRITICS)


def made(field: str, name: str, known: Mapping[str, Callable[[], Made]]) -> Made:
    """Return the record of a name, with its default options; ValueError for an unknown name."""
    if not isinstance(name, str) or name not in known:
        raise InputError.of(field, f"must be one of {', '.join(known)}", name)
    return known[name]()
