"""Maximum-likelihood parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.exact.algorithms import SENSITIVITY, SIDED, Model
from bgmodel.fitting.exact.responses import Grid, moments, responded
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.parameters import RESPONSE, ParameterSpace, freedom
from bgmodel.fitting.trials.design import Design
from bgmodel.support.arrays import Array, Truths
from circuits.errors import FitWarning

OPTIMUM_SEED = 24_101
"""Seed of the stochastic search."""
TOLERANCE_NATS = 0.01
"""Change of the log likelihood below which the search ends."""
POPULATION = 16
"""Number of points in a generation of the search."""
BEYOND, MOST_S = 1e-4, 60.0
"""Share of the responses that predictions may leave out, and their latest time, s."""
RESPONSES = tuple(each.name for each in RESPONSE)


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of a design's data under a model.

    Parameters
    ----------
    model : Model
        The model of decisions.
    design : Design
        Cells and trials.
    freedom : ParameterSpace
        The free parameters.
    """

    model: Model
    design: Design
    freedom: ParameterSpace

    def density(self, vector: Array) -> Array:
        """Return the density of responses (cells, 2, bins), 1/s, at a vector of the fit."""
        values = self.freedom.values(vector)
        # Trials whose strength favours response 0 are mirrored.
        for name in set(SIDED) & set(values):
            values[name] = values[name] * self.design.side
        grid = self.design.grid
        decided = self.model.decided(values, self.design.strength, grid)
        response = {name: values[name] for name in ("t0_s", "t0_sd_s", "lapse")}
        alternatives = self.design.observed.alternatives
        return responded(decided, grid, **response, alternatives=alternatives)

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats."""
        return self.design.observed.each(self.density(vector))

    def __call__(self, vector: Array) -> float:
        """Return the log likelihood of the data, nats; -inf outside the bounds."""
        return float(self.each(vector).sum()) if self.freedom.inside(vector) else -np.inf


def completed(likelihood: Likelihood, vector: Array) -> Likelihood:
    """Return a likelihood whose grid holds nearly all responses that are predicted at a vector.

    The grid of a fit ends soon after the slowest observed response. Predictions up to there would
    depend on how late that happened to be, and would be too fast.
    """
    observed = likelihood.design.observed
    ends_s = (observed.window_s[1], getattr(likelihood.model, "seconds", np.inf), MOST_S)
    most, first = int(min(ends_s) / observed.grid.width_s), observed.grid
    answered = _answered(likelihood, vector)
    while observed.deadline_s is None and observed.grid.bins < most:
        bins = min(2 * observed.grid.bins, most)
        observed = replace(observed, grid=Grid(bins, first.width_s, first.bins))
        wider = replace(likelihood, design=replace(likelihood.design, observed=observed))
        more = _answered(wider, vector)
        if (more - answered).max() < BEYOND:
            break
        likelihood, answered = wider, more
    return likelihood


def _answered(likelihood: Likelihood, vector: Array) -> Array:
    """Return the share of responses on the grid, (cells,)."""
    density = likelihood.density(vector)
    return np.asarray(density.sum(axis=(1, 2)) * likelihood.design.grid.width_s)


def likelihood_of(
    model: Model,
    design: Design,
    *,
    free: list[str] | None = None,
    fixed: dict[str, float] | None = None,
    vary: dict[str, str] | None = None,
    formulas: Sequence[Formula] = (),
    largest: float | None = None,
) -> Likelihood:
    """Return the likelihood of a design's data; arguments as for ``parameters.freedom``.

    ``formulas`` gives parameters that are linear in conditions of the design. Bounds and start of
    sensitivity are divided by the largest strength, by default that of the design, so that the
    drift has the same range in every unit of strength. Warns of responses that are later than the
    end of a model's simulated trials.
    """
    _warn_of_later(model, design)
    unit = design.strength.max() if largest is None else largest
    names = ("low", "high", "start")
    own = replace(SENSITIVITY, **{name: getattr(SENSITIVITY, name) / unit for name in names})
    known = [own if each.name == SENSITIVITY.name else each for each in model.parameters]
    cells = design.cells
    designs = {
        each.parameter: each.matrix(design.conditions, design.observed.cell, cells)
        for each in formulas
    }
    freed = freedom(
        known, design.conditions, cells, free=free, fixed=fixed, vary=vary, designs=designs
    )
    return Likelihood(model, design, freed)


def _warn_of_later(model: Model, design: Design) -> None:
    """Warn of responses after the end of a model's trials: they can only be lapses."""
    seconds = getattr(model, "seconds", np.inf)  # exact models have no end
    rt_s = design.observed.rt_s[np.isfinite(design.observed.rt_s)]
    later = int((rt_s > seconds).sum())
    if later:
        FitWarning.warn(
            f"{design.who}: {later} of {len(rt_s)} responses come after the {seconds:g} s "
            f"for which the circuit is simulated, the last at {rt_s.max():.3g} s: it cannot decide "
            "then, so they count as lapses. Simulate longer trials (seconds)"
        )


@dataclass(frozen=True)
class Optimum:
    """The maximum of the likelihood.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood.
    vector : array
        The numbers of the fit.
    log_likelihood : float
        Log likelihood at the maximum, nats.
    evaluations : int
        Number of evaluations of the search.
    """

    likelihood: Likelihood
    vector: Array
    log_likelihood: float
    evaluations: int

    @cached_property
    def density(self) -> Array:
        """Density of responses at the maximum, (cells, 2, bins), 1/s."""
        return self.likelihood.density(self.vector)

    @cached_property
    def complete(self) -> Optimum:
        """The same optimum on a grid for predictions; see ``completed``."""
        return replace(self, likelihood=completed(self.likelihood, self.vector))

    @property
    def values(self) -> dict[str, float]:
        """The numbers of the fit by name."""
        return dict(zip(self.likelihood.freedom.names, self.vector.tolist(), strict=True))

    @property
    def moments(self) -> dict[str, Array]:
        """Accuracy, mean and sd of each cell; see ``responses.moments``."""
        return moments(self.complete.density, self.complete.likelihood.design.grid)

    @property
    def at_bound(self) -> Truths:
        """Which numbers are at a bound of their range."""
        return self.likelihood.freedom.at_bound(self.vector)


def optimum(
    likelihood: Likelihood,
    *,
    starts: Sequence[Array] | None = None,
    seed: int = OPTIMUM_SEED,
    tell: Callable[[int, float], None] | None = None,
) -> Optimum:
    """Return the optimum, by CMA-ES (Hansen 2016) from several starts.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood to maximise.
    starts : sequence of array, optional
        Starting points; by default those of ``starts_of``.
    seed : int
        Seed of the search.
    tell : function, optional
        Called with the number of evaluations and the best log likelihood so far.
    """
    import cma

    low, high = likelihood.freedom.low, likelihood.freedom.high
    evaluations, best, value = 0, likelihood.freedom.start, -np.inf
    for number, first in enumerate(starts_of(likelihood) if starts is None else starts):
        first = np.clip(first, low, high)
        scale = _scales(likelihood, first)
        options = {
            "bounds": [(low / scale).tolist(), (high / scale).tolist()],
            # Its own numbers: those of numpy's global generator are shared by all threads.
            "randn": np.random.RandomState(seed + number).randn,
            "seed": np.nan,
            "popsize": POPULATION,
            "tolfun": TOLERANCE_NATS,
            "tolfunhist": TOLERANCE_NATS,
            "verbose": -9,
        }
        search = cma.CMAEvolutionStrategy((first / scale).tolist(), 1.0, options)
        while not search.stop():
            asked = search.ask()
            search.tell(asked, [-likelihood(np.clip(x * scale, low, high)) for x in asked])
            evaluations += len(asked)
            if tell is not None:
                tell(evaluations, max(value, -float(search.result.fbest)))
        if -search.result.fbest > value:
            value = -float(search.result.fbest)
            best = np.clip(np.asarray(search.result.xbest) * scale, low, high)
    return Optimum(likelihood, best, value, evaluations)


def starts_of(likelihood: Likelihood) -> list[Array]:
    """Return the starting points of a search, with the non-decision time from the fastest times.

    One start has parameters at their default values. The other has those that start at a bound in
    the middle of their range: a likelihood may have a maximum on either side.
    """
    freed = likelihood.freedom
    fastest = float(np.nanquantile(likelihood.design.observed.rt_s, 0.02))
    first = freed.start
    for k, each in enumerate(freed.moved):
        if each.parameter.name == "t0_s" and not each.effect:
            first[k] = np.clip(fastest - 0.05, freed.low[k], freed.high[k])
    inner = np.array([each.parameter.name not in RESPONSES for each in freed.moved])
    stuck = inner & ((first == freed.low) | (first == freed.high))
    if not stuck.any():
        return [first]
    return [first, np.where(stuck, (freed.low + freed.high) / 2, first)]


def _scales(likelihood: Likelihood, first: Array) -> Array:
    """Return the initial step of the search in each direction: about a sixth of the start."""
    width = likelihood.freedom.high - likelihood.freedom.low
    return np.asarray(np.clip(0.15 * np.abs(first), 0.02 * width, 0.2 * width))
