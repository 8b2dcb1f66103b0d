"""The likelihood of one person's trials under a model, for every search and sampler.

Models come in three kinds. A model of decisions gives the distribution of decision times in each
cell of a design (``algorithms.Model``): its responses follow with a non-decision time and lapses,
and trials are counted in bins. A model of trials (``TrialModel``) gives the density of each trial,
which may depend on all trials before it, and simulates trials. A model of known evidence or of
recorded cells makes its own likelihood (``OwnModel``). Optimum, posterior, hierarchy, comparison
and misfit are the same for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from bgmodel.fitting.algorithms import SENSITIVITY, SIDED, Model
from bgmodel.fitting.design import Design, mirrored
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.parameters import ADDED, RESPONSE, Parameter, ParameterSpace, freedom
from bgmodel.fitting.responses import TINY, Grid, responded
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.errors import FitWarning, InputError, require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

BEYOND, MOST_S = 1e-4, 60.0
"""Share of the responses that predictions may leave out, and their latest time, s."""
RESPONSES = tuple(each.name for each in RESPONSE)
STEP, ROUNDING = 0.02, 1e-12
"""Step of the derivatives of densities, as a share of a parameter's value or of its range; changes
of a probability below ``ROUNDING`` count as 0."""
SCORE_STEP = 1e-3
"""Step of the derivatives of single trials' log densities, likewise."""
REPLICAS, REPLICAS_SEED = 200, 71_001
"""Simulated copies of the trials from which predictions of a model of trials are made."""


@runtime_checkable
class TrialModel(Protocol):
    """A model that gives the density of each trial, and simulates trials.

    Every name that ``values`` holds is a parameter; a value is given for each trial, so that
    conditions may change it. A model with an attribute ``stacks`` that is true takes values
    (..., trials) too, of several vectors side by side.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, with their ranges."""

    def log_density(self, trials: Trials, values: Mapping[str, Array]) -> Array:
        """Return each trial's log density given those before it, nats (of 1/s if timed)."""

    def simulate(
        self, trials: Trials, values: Mapping[str, Array], rng: np.random.Generator
    ) -> Trials:
        """Return as many new trials, with the same strengths and conditions."""


@runtime_checkable
class OwnModel(Protocol):
    """A model that makes its own likelihood, such as one on known evidence."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, with their ranges."""

    def likelihood(self, design: Design, freedom: ParameterSpace) -> Likelihood:
        """Return the likelihood of a design's trials."""


AnyModel = Model | TrialModel | OwnModel
Peak = tuple["Likelihood", Array]
"""A likelihood, and where it is highest."""


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of one person's trials under a model."""

    model: Any
    design: Design
    freedom: ParameterSpace
    rough: ClassVar[bool] = False
    """Whether it has steps, as with simulated trials, so that no search may follow its slope."""
    scored: ClassVar[bool] = False
    """Whether ``scores`` costs less than differences of ``each``, so that a search uses it."""
    sized: ClassVar[tuple[str, ...]] = ()
    """Parameters that can't be near 0: a fit says if the data hardly identify them."""

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats, at a vector of the fit."""
        raise NotImplementedError

    def many(self, vectors: Array) -> Array:
        """Return ``each`` at several vectors, (vectors, trials)."""
        return np.array([self.each(vector) for vector in vectors])

    def unbiased(self, vector: Array) -> Array:
        """Return ``each`` without the bias of simulated runs, where there is one."""
        return self.each(vector)

    def cautions(self) -> list[str]:
        """Return what makes a fit to these trials doubtful, as sentences."""
        return []

    def density(self, vector: Array) -> Array:
        """Return the predicted density of responses (cells, 2, bins), 1/s."""
        raise NotImplementedError

    def draw(
        self, cells: Mapping[str, pd.DataFrame], peaks: Mapping[str, Peak], title: str
    ) -> Figure:
        """Draw the cells of each fit and its optimum, by name; see ``Fit.plot``."""
        from bgmodel.fitting.quantiles import draw_fits

        return draw_fits(dict(cells), title)

    def __call__(self, vector: Array) -> float:
        """Return the log likelihood of the data, nats; -inf outside the bounds."""
        return float(self.each(vector).sum()) if self.freedom.inside(vector) else -np.inf

    def height(self, vector: Array) -> float:
        """Return the quantity that a fit maximises: log likelihood plus log prior."""
        nats = self(vector)
        return nats + self.freedom.log_prior(vector) if np.isfinite(nats) else nats

    def heights(self, vectors: Array) -> Array:
        """Return ``height`` at several vectors, (vectors,), from one call of ``many``."""
        inside = np.array([self.freedom.inside(vector) for vector in vectors])
        heights = np.full(len(vectors), -np.inf)
        if inside.any():
            prior = [self.freedom.log_prior(vector) for vector in vectors[inside]]
            heights[inside] = self.many(vectors[inside]).sum(axis=1) + prior
        return heights

    @property
    def groups(self) -> Integers:
        """Group of each trial: those left out of a fit are taken evenly from all groups."""
        return self.design.observed.cell

    def part(self, trials: Array | Integers) -> Self:
        """Return the likelihood of a subset of the trials."""
        return replace(self, design=self.design.part(trials))

    def without_parts(self) -> list[Self]:
        """Return it without each part of the model's simulated trials; empty if it is exact."""
        return []

    def drawn(self, vector: Array, rng: np.random.Generator) -> tuple[Array, Integers]:
        """Return times, s, and responses of new trials in place of the observed ones."""
        return self.design.observed.drawn(self.density(vector), rng)

    def simulated(self, vector: Array, rng: np.random.Generator) -> Trials:
        """Return all trials of the person with new responses and times."""
        trials = self.design.choices
        if trials is None:
            raise InputError("trials are simulated for a design with its choices", "design")
        rt_s, response = self.drawn(vector, rng)
        return replace(trials, rt_s=rt_s, response=mirrored(trials, response).astype(np.int8))

    def complete(self, vector: Array) -> Self:
        """Return the likelihood on a grid that holds nearly all responses predicted at a vector.

        On a grid that ends at the slowest observed response, predictions would depend on how late
        that response happened to be.
        """
        seen = self.design.observed
        ends_s = (seen.window_s[1], getattr(self.model, "seconds", np.inf), MOST_S)
        most, first = int(min(ends_s) / seen.grid.width_s), seen.grid
        likelihood, answered = self, self._answered(vector)
        while seen.deadline_s is None and seen.grid.bins < most:
            bins = min(2 * seen.grid.bins, most)
            seen = replace(seen, grid=Grid(bins, first.width_s, first.bins))
            wider = replace(likelihood, design=replace(likelihood.design, observed=seen))
            more = wider._answered(vector)
            if (more - answered).max() < BEYOND:
                break
            likelihood, answered = wider, more
        return likelihood

    def _answered(self, vector: Array) -> Array:
        """Return the share of responses on the grid, (cells,)."""
        return np.asarray(self.density(vector).sum(axis=(1, 2)) * self.design.grid.width_s)

    def starts(self) -> list[Array]:
        """Return the starting points of a search, with t0_s from fast responses.

        A second one has parameters that start at a bound in the middle of their range.
        """
        freed, times_s = self.freedom, self.design.observed.rt_s
        first = freed.start
        for k, each in enumerate(freed.moved):
            if each.parameter.name == "t0_s" and not each.effect and np.isfinite(times_s).any():
                fastest = float(np.nanquantile(times_s, 0.02))
                first[k] = np.clip(fastest - 0.05, freed.low[k], freed.high[k])
        inner = np.array([each.parameter.name not in RESPONSES for each in freed.moved])
        stuck = inner & ((first == freed.low) | (first == freed.high))
        if not stuck.any():
            return [first]
        return [first, np.where(stuck, (freed.low + freed.high) / 2, first)]

    def with_scores(self, vector: Array) -> tuple[Array, Array]:
        """Return ``each`` and ``scores`` at once, where that costs less."""
        return self.each(vector), self.scores(vector)

    def scores(self, vector: Array) -> Array:
        """Return the derivative of each trial's log likelihood, (trials, parameters)."""
        low, high = self.freedom.low, self.freedom.high
        least = np.where(self.freedom.by_factors, 0.0, (high - low) / 100)
        steps = np.diag(SCORE_STEP * np.maximum(np.abs(vector), least))
        above, below = np.minimum(vector + steps, high), np.maximum(vector - steps, low)
        apart = self.many(above) - self.many(below)
        width = np.diag(above) - np.diag(below)
        return np.asarray((apart / np.where(width > 0, width, 1.0)[:, None]).T)

    def information(self, vector: Array) -> tuple[Array, tuple[str, ...]]:
        """Return the information on the numbers, and the names of those without effect."""
        scores = self.scores(vector)
        still = ~(scores != 0).any(axis=0)
        return scores.T @ scores, tuple(np.array(self.freedom.names)[still].tolist())


@dataclass(frozen=True)
class BinnedLikelihood(Likelihood):
    """The likelihood under a model of decisions, from densities of responses in bins of time."""

    model: Model
    rough: ClassVar[bool] = True

    def density(self, vector: Array) -> Array:
        """Return the density of responses (cells, 2, bins), 1/s, at a vector of the fit."""
        values = self.freedom.values(vector)
        # Trials whose strength favours response 0 are mirrored.
        for name in set(SIDED) & set(values):
            values[name] = values[name] * self.design.side
        grid = self.design.grid
        decided = self.model.decided(values, self.design.strength, grid)
        if not self.design.timed:
            # Some may decide after the end of the grid: choices are those of all others.
            made, decided = decided.sum(axis=2), np.zeros(decided.shape)
            decided[:, :, 0] = made / np.maximum(made.sum(axis=1, keepdims=True), TINY)
        response = {name: values[name] for name in ("t0_s", "t0_sd_s", "lapse")}
        alternatives = self.design.observed.alternatives
        every = responded(decided, grid, **response, alternatives=alternatives)
        return self.design.observed.recorded(every)

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats."""
        return self.design.observed.each(self.density(vector))

    def without_parts(self) -> list[Self]:
        """Return it without each part of the model's simulated trials; empty if it is exact."""
        return [replace(self, model=model) for model in self.model.left_out()]

    def information(self, vector: Array) -> tuple[Array, tuple[str, ...]]:
        """Return the expected information, which depends on the design and not on the data.

        Products of derivatives are of one half of a circuit's trials with the other, since squares
        would count their error as information.
        """
        halves = self.model.halves()
        unsplit = len({id(each) for each in halves}) == 1
        first = replace(self, model=halves[0])._changes(vector)
        second = first if unsplit else replace(self, model=halves[1])._changes(vector)
        weight = self.design.trials[:, None] / np.maximum(self._masses(vector), 1e-12)
        information = np.einsum("icb,cb,jcb->ij", first, weight, second)
        symmetric = (information + information.T) / 2
        # Negative information means an error as large as the quantity.
        unknown = np.diag(symmetric) <= 0
        symmetric[unknown], symmetric[:, unknown] = 0.0, 0.0
        still = ~(first != 0).any(axis=(1, 2))
        return symmetric, tuple(np.array(self.freedom.names)[still].tolist())

    def _changes(self, vector: Array) -> Array:
        low, high = self.freedom.low, self.freedom.high
        whole = {each.name: each.high - each.low for each in self.freedom.parameters}
        changes = []
        for k, each in enumerate(self.freedom.moved):
            size, reach = abs(vector[k]), high[k] - low[k]
            if k in self._far.values():
                size, reach = min(size, whole[each.parameter.name]), whole[each.parameter.name]
            step = STEP * max(size, 0.1 * reach)
            above, below = vector.copy(), vector.copy()
            above[k], below[k] = min(vector[k] + step, high[k]), max(vector[k] - step, low[k])
            step = (above[k] - below[k]) / 2
            if k in self._far:
                # About its mean, since far from it a slope changes everything.
                above[self._far[k]] -= step * each.weights.mean()
                below[self._far[k]] += step * each.weights.mean()
            apart = self._masses(above) - self._masses(below)
            apart[np.abs(apart) < ROUNDING] = 0.0
            changes.append(apart / (2 * step))
        for k, intercept in self._far.items():
            changes[k] += self.freedom.moved[k].weights.mean() * changes[intercept]
        return np.array(changes)

    @cached_property
    def _far(self) -> dict[int, int]:
        """Places of slopes over covariates far from 0, with the places of their intercepts."""
        moved = self.freedom.moved
        return {
            k: i
            for k, each in enumerate(moved)
            for i, other in enumerate(moved)
            if other.parameter.name == each.parameter.name
            and other.effect
            and (other.weights == 1).all()
            and abs(each.weights.mean()) > max(1.0, each.weights.std()) > 0
            and np.ptp(each.weights)
        }

    def _masses(self, vector: Array) -> Array:
        """Return the probability of each outcome, (cells, outcomes): bins of both, and none."""
        density = self.density(vector)
        mass = density.reshape(len(density), -1) * self.design.grid.width_s
        missing = np.maximum(1 - mass.sum(axis=1, keepdims=True), 1e-9)
        return np.concatenate([mass, missing], axis=1)


@dataclass(frozen=True)
class TrialLikelihood(Likelihood):
    """The likelihood under a model of trials."""

    model: TrialModel
    cell: Integers  # (all trials,), the cell of each
    # Which trials count, all by default; densities follow from all of them.
    kept: Integers | None = None

    def part(self, trials: Array | Integers) -> Self:
        """Return the likelihood of a subset of the trials, given all of them."""
        kept = np.arange(len(self.cell)) if self.kept is None else self.kept
        return replace(self, design=self.design.part(trials), kept=kept[trials])

    @property
    def trials(self) -> Trials:
        """All trials of the person."""
        if self.design.choices is None:
            raise InputError("a model of trials needs a design with its choices", "design")
        return self.design.choices

    def values(self, vector: Array) -> dict[str, Array]:
        """Return each parameter in every trial, (all trials,)."""
        return {name: each[self.cell] for name, each in self.freedom.values(vector).items()}

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats."""
        return self._checked(self.values(vector), (len(self.cell),))

    def many(self, vectors: Array) -> Array:
        """Return ``each`` at several vectors, of all at once if the model can."""
        if not getattr(self.model, "stacks", False):
            return super().many(vectors)
        every = [self.values(vector) for vector in vectors]
        stacked = {name: np.stack([one[name] for one in every]) for name in every[0]}
        return self._checked(stacked, (len(vectors), len(self.cell)))

    def _checked(self, values: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
        """Return the model's log densities of the trials that count, (..., trials)."""
        densities = np.asarray(self.model.log_density(self.trials, values), dtype=np.float64)
        if densities.shape != shape or np.isnan(densities).any():
            must = f"must return {len(self.cell)} numbers, one per trial"
            raise InputError.of("log_density", must, densities[..., :3])
        # A trial that the model rules out counts as one of the least probability.
        floored: Array = np.maximum(densities, np.log(TINY))
        return floored if self.kept is None else floored[..., self.kept]

    def drawn(self, vector: Array, rng: np.random.Generator) -> tuple[Array, Integers]:
        """Return times, s, and responses of new trials in place of the observed ones."""
        made = self.model.simulate(self.trials, self.values(vector), rng)
        response, rt_s = mirrored(made), made.rt_s
        return (rt_s, response) if self.kept is None else (rt_s[self.kept], response[self.kept])

    def simulated(self, vector: Array, rng: np.random.Generator) -> Trials:
        """Return all trials of the person with new responses and times."""
        return self.model.simulate(self.trials, self.values(vector), rng)

    def density(self, vector: Array) -> Array:
        """Return the predicted density of responses, from ``REPLICAS`` copies of the trials."""
        seen, grid = self.design.observed, self.design.grid
        count = np.zeros((self.design.cells, 2, grid.bins))
        for replica in range(REPLICAS):
            rt_s, response = self.drawn(vector, stream(REPLICAS_SEED, "replica", replica))
            # A response without a time counts in the first bin.
            late = np.nan_to_num(rt_s, posinf=grid.bins * grid.width_s) / grid.width_s
            bins = np.minimum(late, grid.bins).astype(np.int64)
            made = (response >= 0) & (bins < grid.bins)
            np.add.at(count, (seen.cell[made], response[made], bins[made]), 1)
        return np.asarray(count / (REPLICAS * self.design.trials[:, None, None] * grid.width_s))


def identity_of(model: AnyModel) -> dict[str, Any]:
    """Return all that the predictions of a model depend on, for provenance."""
    if hasattr(model, "identity"):
        return dict(model.identity())
    return {"model": getattr(model, "name", type(model).__name__)}


def likelihood_of(
    model: AnyModel,
    design: Design,
    *,
    free: list[str] | None = None,
    fixed: dict[str, float] | None = None,
    vary: dict[str, str] | None = None,
    formulas: Sequence[Formula] = (),
    largest: float | None = None,
) -> Likelihood:
    """Return the likelihood of a design's data; arguments as for ``parameters.freedom``.

    The range of sensitivity is divided by the ``largest`` strength. Warns of responses later than a
    model's simulated trials.
    """
    _warn_of_later(model, design)
    unit = design.strength.max() if largest is None else largest
    names = ("low", "high", "start")
    scaled = replace(SENSITIVITY, **{name: getattr(SENSITIVITY, name) / unit for name in names})
    known = [scaled if each is SENSITIVITY else each for each in model.parameters]
    if not design.timed:
        known = _without_times(model, known, [*(free or ()), *(vary or ()),
                                              *(each.parameter for each in formulas)])  # fmt: skip
    cells = design.cells
    designs = {
        each.parameter: each.matrix(design.conditions, design.observed.cell, cells)
        for each in formulas
    }
    freed = freedom(
        known, design.conditions, cells, free=free, fixed=fixed, vary=vary, designs=designs
    )
    if isinstance(model, TrialModel):
        return TrialLikelihood(model, design, freed, design.observed.cell)
    if isinstance(model, OwnModel):
        return model.likelihood(design, freed)
    return BinnedLikelihood(model, design, freed)


def _without_times(
    model: AnyModel, known: Sequence[Parameter], named: Sequence[str]
) -> list[Parameter]:
    """Return the parameters; those that choices without times leave open are fixed by default."""
    late = {RESPONSE[0].name, RESPONSE[1].name}
    for name in (each.removeprefix(ADDED) for each in named):
        must = "must be left out: it has no effect on choices without times"
        require(name not in late, name, must, name)
    kept = {each.name for each in known} - late - {getattr(model, "threshold_name", "")}
    if not isinstance(model, (TrialModel, OwnModel)):
        kept = {SENSITIVITY.name, RESPONSE[2].name}
    return [each if each.name in kept else replace(each, free=False) for each in known]


def _warn_of_later(model: AnyModel, design: Design) -> None:
    seconds = getattr(model, "seconds", np.inf)  # exact models have no end
    rt_s = design.observed.rt_s[np.isfinite(design.observed.rt_s)]
    later = int((rt_s > seconds).sum())
    if later:
        FitWarning.warn(
            f"{design.who}: {later} of {len(rt_s)} responses come after the {seconds:g} s "
            f"for which the circuit is simulated, the last at {rt_s.max():.3g} s: it cannot decide "
            "then, so they count as lapses. Simulate longer trials (seconds)"
        )
