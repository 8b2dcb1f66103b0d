"""Models of choices and times of people who learn values: parameters, drifts, starting points.

Every model is a diffusion between two bounds. Its drift in a trial is ``scale (V_1 - V_0)`` with
the values learned from all earlier trials of the pair; the baseline model has one drift per pair.
Stickiness is a starting point towards the last choice of the same pair, a share of the bound. It
is not a shift of the drift: a tendency known before the evidence comes is a prior, which the
sequential test adds to its starting point, and learned values move the drift already, so that a
shift of the drift would be harder to tell from them than a start, which makes repetitions faster.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import expit, logit

from bgmodel.learning.values.learners import Confidence, Learner, LogitQ, Opal, QLearning
from bgmodel.learning.values.people import PairTrials
from bgmodel.support.arrays import Array
from circuits.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A parameter, the scale on which it is fitted, and its weak prior.

    Parameters
    ----------
    name : str
        Its name.
    scale : str
        "log" for positive numbers, "logit" for shares, "atanh" for -1..1, "identity" otherwise.
    median : float
        Median of the prior.
    sd : float
        Standard deviation of the prior, which is normal on that scale.
    """

    name: str
    scale: str
    median: float
    sd: float

    def natural(self, fitted: Array) -> Array:
        """Return values from those on the scale of the fit."""
        return np.asarray(SCALES[self.scale][1](fitted))

    def fitted(self, natural: float | Array) -> Array:
        """Return values on the scale of the fit."""
        return np.asarray(SCALES[self.scale][0](natural))


Map = Callable[[float | Array], Array]
SCALES: dict[str, tuple[Map, Map]] = {
    "log": (np.log, np.exp),
    "logit": (logit, expit),
    "atanh": (np.arctanh, np.tanh),
    "identity": (np.asarray, np.asarray),
}
"""Functions to the scale of a fit and back."""

BOUND = Parameter("bound", "log", 1.0, 0.5)
"""Half of the boundary separation, sqrt(s), for noise of unit variance per second."""
NON_DECISION = Parameter("non_decision_s", "log", 0.4, 0.5)
STICKINESS = Parameter("stickiness", "atanh", 0.0, 0.3)
"""Starting point towards the last choice, a share of the bound."""
COMMON = (BOUND, NON_DECISION, STICKINESS)


@dataclass(frozen=True, eq=False)
class ValueModel:
    """A model of choices and times.

    Parameters
    ----------
    name : str
        Its name.
    special : tuple of Parameter
        Its parameters in addition to bound, non-decision time and stickiness.
    learner : function or None
        Takes its special parameters by name, except scale; None for the baseline model, whose
        special parameters are the drifts of the pairs.
    """

    name: str
    special: tuple[Parameter, ...]
    learner: Callable[..., Learner] | None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, in the order of a fit."""
        return (*self.special, *COMMON)

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [each.name for each in self.parameters]

    def natural(self, fitted: Array) -> dict[str, Array]:
        """Return the parameters by name from an array (..., parameters) on the scale of a fit."""
        return {each.name: each.natural(fitted[..., k]) for k, each in enumerate(self.parameters)}

    def fitted(self, natural: dict[str, float]) -> Array:
        """Return parameters as an array on the scale of a fit."""
        return np.array([float(each.fitted(natural[each.name])) for each in self.parameters])

    def log_prior(self, fitted: Array) -> Array:
        """Return the logarithm of the prior density, up to a constant, (...)."""
        middle = np.array([float(each.fitted(each.median)) for each in self.parameters])
        spread = np.array([each.sd for each in self.parameters])
        return np.asarray(-0.5 * (((fitted - middle) / spread) ** 2).sum(axis=-1))

    def made(self, values: dict[str, Array]) -> Learner:
        """Return the learner with parameters that have shape (sets,) each."""
        if self.learner is None:
            raise InputError.of("model", "must have a learner", self.name)
        special = {each.name: values[each.name] for each in self.special if each.name != "scale"}
        return self.learner(**{name: value[:, None] for name, value in special.items()})

    def drifts(self, values: dict[str, Array], person: PairTrials) -> Array:
        """Return the drift of every trial given all earlier ones, (sets, trials), 1/sqrt(s).

        Parameters
        ----------
        values : dict
            Parameters by name, (sets,) each.
        person : PairTrials
            Choices and rewards.
        """
        if self.learner is None:
            return np.stack([values[each.name] for each in self.special], axis=-1)[:, person.pair]
        return np.asarray(
            values["scale"][:, None]
            * value_differences(self.made(values), person, len(values["scale"]))
        )


def value_differences(learner: Learner, person: PairTrials, sets: int) -> Array:
    """Return the value of the better item minus the other before every trial, (sets, trials)."""
    choice = person.by_pair(person.response)
    chosen = np.stack([1 - choice, choice], axis=-1)
    reward = person.by_pair(person.reward)
    state = learner.start((sets, len(person.names)))
    found = np.empty((len(choice), sets, len(person.names)))
    for k in range(len(choice)):
        values = learner.values(state)
        found[k] = values[..., 1] - values[..., 0]
        state = learner.learn(state, chosen[k], reward[k])
    return found[person.within, :, person.pair].T


def _scale(median: float) -> Parameter:
    """Return the drift per unit of the difference of values, 1/sqrt(s)."""
    return Parameter("scale", "log", median, 1.0)


def _share(name: str, median: float = 0.2) -> Parameter:
    return Parameter(name, "logit", median, 1.5)


def _nats(name: str) -> Parameter:
    return Parameter(name, "log", 0.3, 1.0)


def _remembered(kind: type[Confidence] | type[Opal]) -> Callable[..., Learner]:
    """Return a learner that forgets nothing: the pairs of people do not reverse."""
    return partial(kind, decay=0.0)


RATES = ("rate", "rate_minus")
MODELS: dict[str, ValueModel] = {
    model.name: model
    for model in (
        ValueModel(
            "no learning",
            tuple(Parameter(f"drift_{k}", "identity", 0.0, 2.0) for k in range(3)),
            None,
        ),
        ValueModel("q", (_share("rate"), _scale(2.0)), QLearning),
        ValueModel("q, two rates", (*map(_share, RATES), _scale(2.0)), QLearning),
        ValueModel("logit q", (_share("rate"), _scale(0.7)), LogitQ),
        ValueModel("confidence", (_nats("rate"), _scale(0.7)), _remembered(Confidence)),
        ValueModel(
            "confidence, two rates", (*map(_nats, RATES), _scale(0.7)), _remembered(Confidence)
        ),
        ValueModel("opal", (_share("critic_rate"), _share("rate"), _scale(1.0)), _remembered(Opal)),
    )
}
"""Models by name; priors are stated in ``special`` and ``COMMON``."""


def model_of(given: ValueModel | str) -> ValueModel:
    """Return a model, given as such or by name; ValueError for an unknown name."""
    if isinstance(given, ValueModel):
        return given
    if given not in MODELS:
        raise InputError.of("model", f"must be one of {'; '.join(MODELS)}", given)
    return MODELS[given]
