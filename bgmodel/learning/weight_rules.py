"""Rules that change corticostriatal weights after a reward."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bgmodel.learning.critics import Trial, made
from bgmodel.support.checks import check_positive, check_range
from circuits.arrays import Array

MOST_NATS = 5.0
"""Largest weight of the Hebbian rule, nats; assumed, because its steps grow exponentially."""


@dataclass(frozen=True)
class Rule:
    """Base class: parameters, the weights that follow from them, and their change after a trial."""

    name: ClassVar[str] = ""
    critic: ClassVar[str] = "confidence"
    """Name of the default critic."""

    def start(self, shape: tuple[int, int, int]) -> Array:
        """Return parameters for weights of a shape (runs, hypotheses, units)."""
        return np.zeros(shape)

    def weights(self, parameters: Array) -> Array:
        """Return weights (runs, hypotheses, units), nats per unit of activity."""
        return parameters

    def change(self, parameters: Array, trial: Trial, error: Array) -> Array:
        """Return the change of parameters for a step size of 1, by default at the choice alone.

        ``error``, (runs,), is the reward less the critic's expectation.
        """
        return _outer(error[:, None] * _at_choice(trial), trial.eligibility)

    def bounded(self, parameters: Array) -> Array:
        """Return parameters clipped to the range that the rule allows."""
        return parameters


def _at_choice(trial: Trial) -> Array:
    """Return 1 for the chosen hypothesis and 0 for the others, (runs, hypotheses)."""
    return np.asarray(np.eye(trial.posterior.shape[1])[trial.choice])


def _outer(factor: Array, eligibility: Array) -> Array:
    """Return (runs, hypotheses, units) from (runs, hypotheses) and (runs, units)."""
    return np.asarray(factor[:, :, None] * eligibility[:, None, :])


@dataclass(frozen=True)
class ConfidenceRule(Rule):
    """The gradient of ``ln p(r | x, c)`` if a reward has the probability P_c.

    ``dw_c = error e`` for the choice, ``dw_i = -error P_i / (1 - P_c) e`` for the others. The
    exact log-likelihoods are a fixed point under any stopping rule, because stopping depends on
    the readings alone, and given those the choice is right with probability P_c. For two
    hypotheses this is logistic regression.
    """

    name: ClassVar[str] = "confidence"

    def change(self, parameters: Array, trial: Trial, error: Array) -> Array:
        """Return the change of all channels."""
        chosen = _at_choice(trial)
        others = trial.posterior * (1 - chosen)
        others /= np.maximum(others.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        return _outer(error[:, None] * (chosen - others), trial.eligibility)


@dataclass(frozen=True)
class ChosenRule(Rule):
    """The confidence rule in the chosen channel alone: eligibility, choice and dopamine."""

    name: ClassVar[str] = "chosen"


@dataclass(frozen=True)
class ReinforceRule(Rule):
    """REINFORCE (Williams 1992): ``dw_i = error (1[i = c] - P_i) e``."""

    name: ClassVar[str] = "reinforce"
    critic: ClassVar[str] = "mean"

    def change(self, parameters: Array, trial: Trial, error: Array) -> Array:
        """Return the change of all channels."""
        return _outer(error[:, None] * (_at_choice(trial) - trial.posterior), trial.eligibility)


@dataclass(frozen=True)
class Hebbian(Rule):
    """Reward-modulated Bayesian Hebb rule (Pfeiffer, Nessler, Douglas & Maass 2010).

    ``dw_c = e (1 + exp(-w_c))`` after a reward, ``-e (1 + exp(w_c))`` otherwise: each weight
    approaches the log odds of a reward given that its unit was active.
    """

    name: ClassVar[str] = "hebbian"

    def change(self, parameters: Array, trial: Trial, error: Array) -> Array:
        """Return the change of the chosen channel; the critic is not used."""
        w, reward = parameters, trial.reward[:, None, None]
        push = reward * (1 + np.exp(-w)) - (1 - reward) * (1 + np.exp(w))
        return np.asarray(push * _outer(_at_choice(trial), trial.eligibility))

    def bounded(self, parameters: Array) -> Array:
        """Return weights within MOST_NATS."""
        return np.clip(parameters, -MOST_NATS, MOST_NATS)


@dataclass(frozen=True)
class OpponentActor(Rule):
    """OpAL (Collins & Frank 2014): go and no-go weights that change in proportion to their size.

    ``dG_c = G_c error e`` and ``dN_c = -N_c error e``, neither below 0; at the choice
    ``w = (1 + rho) G - (1 - rho) N``, where rho is the level of dopamine.
    """

    name: ClassVar[str] = "opal"
    critic: ClassVar[str] = "mean"
    rho: float = 0.0
    """Dopamine at the choice, -1..1; 0 weighs go and no-go alike."""
    most: float = 20.0
    """Largest G and N; assumed, because growth in proportion to themselves has no limit."""

    def __post_init__(self) -> None:
        check_range(-1, 1, rho=self.rho)
        check_positive(most=self.most)

    def start(self, shape: tuple[int, int, int]) -> Array:
        """Return G and N, all 1: (2, runs, hypotheses, units)."""
        return np.ones((2, *shape))

    def weights(self, parameters: Array) -> Array:
        """Return ``(1 + rho) G - (1 - rho) N``."""
        return np.asarray((1 + self.rho) * parameters[0] - (1 - self.rho) * parameters[1])

    def change(self, parameters: Array, trial: Trial, error: Array) -> Array:
        """Return the changes of G and N of the chosen channel."""
        step = super().change(parameters, trial, error)
        return np.stack([parameters[0] * step, -parameters[1] * step])

    def bounded(self, parameters: Array) -> Array:
        """Return G and N within 0..most."""
        return np.clip(parameters, 0.0, self.most)


RULES: dict[str, Callable[[], Rule]] = {
    rule.name: rule for rule in (ConfidenceRule, ChosenRule, ReinforceRule, Hebbian, OpponentActor)
}
"""Rules by name, with their default options."""


def rule_of(rule: Rule | str) -> Rule:
    """Return a rule, given as such or by name; ValueError for an unknown name."""
    return rule if isinstance(rule, Rule) else made("rule", rule, RULES)
