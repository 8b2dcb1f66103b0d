"""Models of choices and times of people who learn values: parameters, drifts, starting points.

Every model is a diffusion between two bounds. Its drift in a trial is ``scale (V_1 - V_0)`` with
the values learned from all earlier trials of the pair; the baseline model has one drift per pair.
Stickiness is a starting point towards the last choice of the same pair, a share of the bound: a
tendency known before the evidence comes is a prior. Lapses are independent of the evidence.

Noise has unit variance per second, bounds are at +-A and the start at z; see
``bgmodel.fitting.passage``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from bgmodel.fitting.design import design_of
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.likelihood import TrialLikelihood, likelihood_of
from bgmodel.fitting.parameters import SCALES, Parameter
from bgmodel.fitting.passage import standard_at_rest
from bgmodel.fitting.responses import EVERY_TIME
from bgmodel.learning.value_learners import (
    Confidence,
    LogitQ,
    Opal,
    Pairs,
    QLearning,
    ValueLearner,
    pairs_of,
)
from bgmodel.support.checks import whole
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.errors import InputError, require

LAPSES = 0.02
"""Share of lapses; assumed, so that a single odd response moves no parameter."""
LONGEST_S = 6.0
"""Their times are uniform up to this, and both responses equally frequent."""
LAPSE_DENSITY = LAPSES / (2 * LONGEST_S)
"""Their density, 1/s."""
TERMS = 4
"""Terms of the series of the density, whose error is then below 1e-9."""
MOST_SHIFT = 500.0
"""Largest logarithm of the ratio of the densities with and without drift; beyond, both vanish."""
GRID = np.concatenate([np.geomspace(0.002, 0.1, 120)[:-1], np.geomspace(0.1, 12.0, 280)])
"""Times from which simulated ones are interpolated, in units of A^2."""


def log_density(
    rt_s: Array, response: Integers, drift: Array, bound: Array, start: Array, t0_s: Array
) -> Array:
    """Return the log density of responses (0 or 1) at times rt_s, 1/s; arguments broadcast."""
    side = 2.0 * response - 1
    since = np.maximum(rt_s - t0_s, 1e-4)
    away = (bound - side * start) / (2 * bound)
    at_rest = standard_at_rest(away, since / (2 * bound) ** 2, TERMS) / (2 * bound) ** 2
    shift = drift * (side * bound - start) - drift**2 * since / 2
    density = np.where(rt_s > t0_s, at_rest * np.exp(np.minimum(shift, MOST_SHIFT)), 0.0)
    return np.asarray(np.log((1 - LAPSES) * density + LAPSE_DENSITY))


def choice_probability(drift: Array, bound: Array, start: Array) -> Array:
    """Return the probability of response 1, lapses included; arguments broadcast."""
    v = np.where(np.abs(drift) < 1e-6, 1e-6, drift)
    p = np.expm1(-2 * v * (bound + start)) / np.expm1(-4 * v * bound)
    return np.asarray((1 - LAPSES) * p + LAPSES / 2)


def draw(
    drift: Array, bound: Array, start: Array, t0_s: Array, uniform: Array
) -> tuple[Integers, Array]:
    """Draw responses and times, s, (trials,) each, from ``uniform`` (4, trials)."""
    p = (choice_probability(drift, bound, start) - LAPSES / 2) / (1 - LAPSES)
    response = (uniform[0] < p).astype(int)
    side = 2.0 * response - 1
    grid = GRID[:, None] * bound**2
    away = (bound - side * start) / (2 * bound)
    density = standard_at_rest(away, grid / (2 * bound) ** 2, TERMS)
    density = density * np.exp(-(drift**2) * grid / 2)
    mass = (density[1:] + density[:-1]) / 2 * np.diff(grid, axis=0)
    share = np.concatenate([np.zeros((1, len(drift))), np.cumsum(mass, axis=0)])
    share /= share[-1]
    times = np.array([np.interp(u, share[:, k], grid[:, k]) for k, u in enumerate(uniform[1])])
    lapse = uniform[2] < LAPSES
    rt_s = np.where(lapse, LONGEST_S * uniform[3], t0_s + times)
    return np.where(lapse, uniform[0] < 0.5, response).astype(int), np.asarray(rt_s)


FURTHEST = 5.0
"""Distance of the ends of a parameter's range from its prior median, in sd of the prior."""
STARTS = ((-1.0, 0.2), (1.0, 0.01), (1.0, 0.2), (0.0, 0.05))
"""Starting points: special parameters, sd of the prior from its median, and the quantile of times
of which the non-decision time is ``SHARE``: a single fast response may create a local maximum.
"""
SHARE = 0.8


def _parameter(name: str, scale: str, median: float, sd: float, about: str) -> Parameter:
    """Return a parameter with a weak prior, normal on its scale."""
    to, back = SCALES[scale]
    low, high = back(to(np.array(median)) + FURTHEST * sd * np.array([-1.0, 1.0]))
    return Parameter(
        name, float(low), float(high), median, about, scale=scale, prior=(median, sd)
    )  # fmt: skip


COMMON = (
    _parameter("bound", "log", 1.0, 0.5, "half of the boundary separation, sqrt(s)"),
    _parameter("t0_s", "log", 0.4, 0.5, "non-decision time"),
    _parameter("stickiness", "atanh", 0.0, 0.3, "start towards the last choice, share of bound"),
)
"""Parameters of all models, for noise of unit variance per second."""


@dataclass(frozen=True, eq=False)
class ValueModel:
    """A ``fitting.likelihood.TrialModel`` of the choices and times of a person who learns."""

    name: str
    special: tuple[Parameter, ...]  # in addition to bound, non-decision time and stickiness
    # Takes its special parameters by name, except scale; each must have one value over all
    # trials. None is the baseline model, whose special parameter is the drift.
    learner: Callable[..., ValueLearner] | None
    stacks = True
    threshold_name = "bound"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters."""
        return (*self.special, *COMMON)

    def made(self, values: Mapping[str, Array]) -> ValueLearner:
        """Return learners with parameters (..., trials), which are the same in all trials."""
        if self.learner is None:
            raise InputError.of("model", "must have a learner", self.name)
        special = {each.name: values[each.name] for each in self.special if each.name != "scale"}
        for name, value in special.items():
            if (value != value[..., :1]).any():
                must = "must have one value over all trials: it is a property of the learner"
                raise InputError.of(name, must, np.unique(value)[:3])
        return self.learner(**{name: value[..., :1] for name, value in special.items()})

    def diffusion(self, trials: Trials, values: Mapping[str, Array]) -> tuple[Array, ...]:
        """Return drift, bound, start and t0_s in each trial, given all earlier ones."""
        pairs, bound = pairs_of(trials), values["bound"]
        if self.learner is None:
            drift = values["drift"]
        else:
            shape = bound.shape[:-1]
            drift = values["scale"] * value_differences(self.made(values), pairs, shape)
        return drift, bound, values["stickiness"] * bound * pairs.last_choice, values["t0_s"]

    def log_density(self, trials: Trials, values: Mapping[str, Array]) -> Array:
        """Return the log density of each trial, (..., trials), nats; see ``diffusion``."""
        made = self.diffusion(trials, values)
        if trials.timed:
            return log_density(trials.rt_s, trials.response, *made)
        p = choice_probability(*made[:3])
        return np.asarray(np.log(np.where(trials.response == 1, p, 1 - p)))

    def simulate(
        self, trials: Trials, values: Mapping[str, Array], rng: np.random.Generator
    ) -> Trials:
        """Return new responses and times, each given the trials before it in the table."""
        drift, bound, start, t0_s = self.diffusion(trials, values)
        response, rt_s = draw(drift, bound, start, t0_s, rng.random((4, trials.trials)))
        rt_s = rt_s if trials.timed else np.full(trials.trials, np.nan)
        return replace(trials, response=response.astype(np.int8), rt_s=rt_s)


def value_differences(learner: ValueLearner, pairs: Pairs, shape: tuple[int, ...]) -> Array:
    """Return the value of the better item minus the other before every trial, (..., trials)."""
    state = learner.start((*shape, len(pairs.names)))
    differences = np.empty((len(pairs.reward), *shape, len(pairs.names)))
    for k, (chosen, reward) in enumerate(zip(pairs.chosen, pairs.reward, strict=True)):
        values = learner.values(state)
        differences[k] = values[..., 1] - values[..., 0]
        state = learner.learn(state, chosen, reward)
    return np.moveaxis(differences[pairs.within, ..., pairs.pair], 0, -1)


@dataclass(frozen=True)
class ValueLikelihood(TrialLikelihood):
    """The likelihood of the trials of a person who learns; see ``likelihood``."""

    model: ValueModel

    def density(self, vector: Array) -> Array:
        """Return the density of responses (cells, 2, bins), 1/s: the mean over trials of a cell."""
        made, grid = self.model.diffusion(self.trials, self.values(vector)), self.design.grid
        times_s, sides = grid.middles_s[:, None], np.arange(2)[:, None, None]
        if self.trials.timed:
            each = np.exp(log_density(times_s, sides, *made))
            each -= LAPSE_DENSITY * (times_s > LONGEST_S)
        else:
            p, first = choice_probability(*made[:3]), (times_s < grid.width_s) / grid.width_s
            each = np.stack([1 - p, p])[:, None] * first
        if self.kept is not None:
            each = each[..., self.kept]
        cell = self.design.observed.cell
        return np.stack([each[..., cell == k].mean(axis=-1) for k in range(self.design.cells)])

    def simulated(self, vector: Array, rng: np.random.Generator) -> Trials:
        """Return all trials of the person with new responses, times and rewards.

        The person learns from the new ones. An item is rewarded at a constant rate, estimated from
        the given trials: (rewards + 1) / (choices + 2).
        """
        pair, made, values = pairs_of(self.trials).pair, self.trials, self.values(vector)
        item = 2 * pair + made.response
        rate = (np.bincount(item, made.reward, 2 * pair.max() + 2) + 1) / (
            np.bincount(item, minlength=2 * pair.max() + 2) + 2
        )
        uniform = rng.random(made.trials)
        while True:  # at most once per trial of a pair, since each depends on earlier ones only
            new = self.model.simulate(made, values, deepcopy(rng))
            rewarded = uniform < rate[2 * pair + new.response]
            new = replace(new, reward=rewarded.astype(np.float64))
            if new.checksum == made.checksum:
                return made
            made = new

    def starts(self) -> list[Array]:
        """Return starting points of a search; see ``STARTS``."""
        special, starts = {each.name for each in self.model.special}, []
        for away, quantile in STARTS:
            at, t0_s = (
                self.freedom.start,
                SHARE * np.quantile(np.nan_to_num(self.design.observed.rt_s), quantile),
            )
            for k, each in enumerate(self.freedom.moved):
                parameter = each.parameter
                if parameter.name == "t0_s" and not each.effect:
                    at[k] = np.clip(t0_s, parameter.low, parameter.high)
                elif parameter.name in special and parameter.prior and not each.effect:
                    at[k] = parameter.natural(parameter.scaled(at[k]) + away * parameter.prior[1])
            starts.append(at)
        return starts


def likelihood(
    model: ValueModel | str,
    trials: Trials,
    *,
    free: list[str] | None = None,
    fixed: dict[str, float] | None = None,
    vary: dict[str, str] | None = None,
    formulas: Sequence[Formula] = (),
) -> ValueLikelihood:
    """Return the likelihood of one person's choices and times under a model of value learning."""
    model, vary = model_of(model), dict(vary or {})
    pairs_of(trials)
    if model.learner is None:
        vary = {"drift": "pair"} | vary
    named = [column.partition("/")[0] for column in vary.values()]
    named += [column for each in formulas for column in each.columns]
    design = design_of(trials, sorted({"pair", *named}), rt_window=EVERY_TIME)
    choices = likelihood_of(model, design, free=free, fixed=fixed, vary=vary, formulas=formulas)
    return ValueLikelihood(model, design, choices.freedom, design.observed.cell)


def _scale(median: float) -> Parameter:
    return _parameter("scale", "log", median, 1.0, "drift per unit of value, 1/sqrt(s)")


def _share(name: str, median: float = 0.2) -> Parameter:
    return _parameter(name, "logit", median, 1.5, "learning rate")


def _nats(name: str) -> Parameter:
    return _parameter(name, "log", 0.3, 1.0, "learning rate, nats")


def _remembered(kind: type[Confidence] | type[Opal]) -> Callable[..., ValueLearner]:
    return partial(kind, decay=0.0)


RATES = ("rate", "rate_minus")
MODELS: dict[str, ValueModel] = {
    model.name: model
    for model in (
        ValueModel(
            "no learning",
            (_parameter("drift", "identity", 0.0, 2.0, "drift of a pair, 1/sqrt(s)"),),
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


def model_of(model: ValueModel | str) -> ValueModel:
    """Return a model, given as such or by name; ValueError for an unknown name."""
    if isinstance(model, ValueModel):
        return model
    if model not in MODELS:
        raise InputError.of("model", f"must be one of {'; '.join(MODELS)}", model)
    return MODELS[model]


PAIRS = (("AB", 0.8, 0.2), ("CD", 0.7, 0.3), ("EF", 0.6, 0.4))
"""Pairs with the probabilities of a reward of both items, as in the built-in set."""


def simulated(
    model: ValueModel | str, values: Mapping[str, Array], *, trials: int = 60, seed: int
) -> Trials:
    """Return trials of simulated people, with parameters (people,), who learn three pairs."""
    model, trials = model_of(model), whole("trials", trials, 2)
    better, worse = (np.array([each[k] for each in PAIRS]) for k in (1, 2))
    names = {each.name for each in model.parameters}
    require(names == set(values), "values", f"must be {', '.join(sorted(names))}", list(values))
    columns = {name: np.asarray(each, dtype=np.float64)[:, None] for name, each in values.items()}
    learner, people = model.made(columns), len(columns["bound"])
    rngs = [stream(seed, "person", k) for k in range(people)]
    uniform = np.stack([rng.random((trials, 5, len(PAIRS))) for rng in rngs], axis=2)
    state, last = learner.start((people, len(PAIRS))), np.zeros((people, len(PAIRS)))
    response = np.empty((people, trials, len(PAIRS)), dtype=np.int8)
    rt_s, reward = np.empty(response.shape), np.empty(response.shape)
    for k in range(trials):
        learned = learner.values(state)
        drift = columns["scale"] * (learned[..., 1] - learned[..., 0])
        start = columns["stickiness"] * columns["bound"] * last
        chosen, rt_s[:, k] = _drawn(columns, drift, start, uniform[k, :4])
        response[:, k], reward[:, k] = chosen, uniform[k, 4] < np.where(chosen == 1, better, worse)
        state = learner.learn(state, np.stack([1 - chosen, chosen], axis=-1), reward[:, k])
        last = np.asarray(2.0 * chosen - 1)
    pair = np.tile([name for name, *_ in PAIRS], people * trials)
    who = np.repeat(np.arange(people), trials * len(PAIRS)).astype(str)
    held = pd.DataFrame({"pair": pair})
    answers = rt_s.ravel(), response.ravel()
    return Trials(who, *answers, None, held, source="simulated", reward=reward.ravel())


def _drawn(
    values: dict[str, Array], drift: Array, start: Array, uniform: Array
) -> tuple[Integers, Array]:
    shape = drift.shape
    of_all = [np.broadcast_to(values[name], shape).ravel() for name in ("bound", "t0_s")]
    chosen, rt_s = draw(drift.ravel(), of_all[0], start.ravel(), of_all[1], uniform.reshape(4, -1))
    return chosen.reshape(shape), rt_s.reshape(shape)
