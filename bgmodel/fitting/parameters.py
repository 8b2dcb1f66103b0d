"""Parameters of a model, which of them are free in a fit, and over which conditions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bgmodel.bootstrap import Z95
from bgmodel.fitting.formulas import ranged
from circuits.arrays import Array, Integers, Truths
from circuits.errors import InputError, require

ADDED = "+"
"""Before the name of a free parameter: in addition to those that are free by default."""
MOST_TOLD = 12
"""Largest number of priors that are listed in a text."""
AT_BOUND = 1e-3
"""A number of a fit counts as at a bound within this share of its range."""
Map = Callable[[Array], Array]


SCALES: dict[str, tuple[Map, Map]] = {
    "identity": (lambda x: np.asarray(x, float), lambda x: np.asarray(x, float)),
    "log": (np.log, np.exp),
    "logit": (lambda x: np.log(x) - np.log1p(-x), lambda x: 1 / (1 + np.exp(-x))),
    "atanh": (np.arctanh, np.tanh),
}
"""Functions to the scale of a parameter and back: positive numbers that differ by factors are
searched by their logarithm, shares by their logit, numbers between -1 and 1 by their arctanh."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that can be free in a fit.

    Parameters
    ----------
    name : str
        Name, with its unit.
    low, high : float
        Its bounds.
    start : float
        Default value, and start of a fit.
    about : str
        Description.
    free : bool
        Whether it is free by default.
    scale : str
        The scale on which it is searched, a name in ``SCALES``.
    prior : (float, float), optional
        Median and, on that scale, standard deviation of a Gaussian prior; see ``within``. A
        hierarchical fit puts the distribution of the group in its place.
    shared : bool
        Whether people in a hierarchy share one value by default, as where the trials of one person
        hardly determine it.
    """

    name: str
    low: float
    high: float
    start: float
    about: str = ""
    free: bool = True
    scale: str = "identity"
    prior: tuple[float, float] | None = None
    shared: bool = False

    def __post_init__(self) -> None:
        require(self.scale in SCALES, "scale", f"must be one of {', '.join(SCALES)}", self.scale)
        numbers = (self.low, self.start, self.high)
        if not (all(map(math.isfinite, numbers)) and self.low <= self.start <= self.high):
            raise InputError(
                f"{self.name}: low <= start <= high must hold and be finite: {numbers}", "start"
            )
        ends = {"log": (0.0, math.inf), "logit": (0.0, 1.0), "atanh": (-1.0, 1.0)}
        first, last = ends.get(self.scale, (-math.inf, math.inf))
        must = f"must lie within {first:g} to {last:g}, ends excluded, on the scale {self.scale}"
        require(first < self.low and self.high < last, self.name, must, (self.low, self.high))
        median, sd = self.prior or (self.start, 1.0)
        good = self.low <= median <= self.high and 0 < sd < math.inf
        require(good, "prior", "must be a median in the range, and an sd above 0", self.prior)

    def natural(self, scaled: Array | float) -> Array:
        """Return values from those on the scale."""
        return np.asarray(SCALES[self.scale][1](np.asarray(scaled, float)))

    def scaled(self, natural: Array | float) -> Array:
        """Return values on the scale."""
        return np.asarray(SCALES[self.scale][0](np.asarray(natural, float)))

    def within(self, low: float, high: float) -> Parameter:
        """Return it with the prior of which the central 95 % are an interval within its range."""
        if not self.low <= low < high <= self.high:
            must = f"must be an interval within {self.low:.4g} to {self.high:.4g}"
            raise InputError.of("prior", f"of {self.name} {must}", (low, high))
        first, last = float(self.scaled(low)), float(self.scaled(high))
        median = float(self.natural((first + last) / 2))
        return replace(self, prior=(median, (last - first) / (2 * Z95)))

    @property
    def interval(self) -> tuple[float, float] | None:
        """Central 95 % of the prior, before it is cut at the ends of the range."""
        if self.prior is None:
            return None
        middle, half = float(self.scaled(self.prior[0])), Z95 * self.prior[1]
        return float(self.natural(middle - half)), float(self.natural(middle + half))


RESPONSE = (
    Parameter("t0_s", 0.05, 1.5, 0.3, "mean non-decision time"),
    Parameter("t0_sd_s", 0.01, 0.3, 0.05, "its standard deviation from trial to trial"),
    Parameter("lapse", 0.001, 0.2, 0.01, "share of trials that are lapses", scale="log"),
)
"""Parameters of responses, the same for every model."""


@dataclass(frozen=True)
class FreeParameter:
    """One number of a fit: a parameter in some cells of a design, or a coefficient of a formula."""

    name: str  # ``t0_s``, ``t0_s[stimulation=on]`` or ``t0_s[stimulation[T.on]]``.
    parameter: Parameter  # The parameter, with the bounds and the start of this number.
    # (cells,), the factor of the number in each; where a parameter has only 0, it keeps its
    # default.
    weights: Array
    # Whether it is a difference or a slope: no cell has this number as its value.
    effect: bool = False
    # Whether its prior was stated for this fit: in a hierarchy it is that of the median person.
    stated: bool = False


@dataclass(frozen=True)
class _Sum:
    name: str
    places: Integers
    design: Array
    low: float
    high: float
    bounded: bool

    @cached_property
    def applies(self) -> Truths:
        """Whether any number has a weight in a cell, (cells,)."""
        return np.asarray(self.design.any(axis=0))

    @cached_property
    def everywhere(self) -> bool:
        """Whether it applies in every cell."""
        return bool(self.applies.all())

    def value(self, vector: Array) -> Array:
        """Return the sum in each cell, (cells,)."""
        return np.asarray(vector[self.places] @ self.design)


@dataclass(frozen=True)
class ParameterSpace:
    """The free numbers of a fit, and their mapping to the parameters of every cell."""

    parameters: tuple[Parameter, ...]
    moved: tuple[FreeParameter, ...]
    cells: int

    @property
    def names(self) -> list[str]:
        """Names of the numbers of a fit."""
        return [each.name for each in self.moved]

    @cached_property
    def _scales(self) -> list[str]:
        """The scale of each number; differences and slopes are not transformed."""
        return ["identity" if each.effect else each.parameter.scale for each in self.moved]

    @cached_property
    def by_factors(self) -> Truths:
        """Which numbers differ by factors, (numbers,): their scale is logarithmic."""
        return np.array([scale in ("log", "logit") for scale in self._scales])

    @cached_property
    def rescaled(self) -> Truths:
        """Which numbers have a scale other than their own, (numbers,)."""
        return np.array([scale != "identity" for scale in self._scales])

    def to_scale(self, vector: Array) -> Array:
        """Return values of parameters (numbers,) on the scales of the search."""
        return np.array([SCALES[s][0](x) for s, x in zip(self._scales, vector, strict=True)])

    def from_scale(self, scaled: Array) -> Array:
        """Return values of parameters (numbers,) from those on the scales of the search."""
        return np.array([SCALES[s][1](x) for s, x in zip(self._scales, scaled, strict=True)])

    def scale_rate(self, vector: Array) -> Array:
        """Return the change of each number by its scale, (numbers,)."""
        scaled = self.to_scale(vector)
        change = (self.from_scale(scaled + 1e-6) - self.from_scale(scaled - 1e-6)) / 2e-6
        return np.where(self.rescaled, change, 1.0)

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Central 95 % of the priors, by the names of the numbers that have one."""
        every = {each.name: each.parameter.interval for each in self.moved}
        return {name: interval for name, interval in every.items() if interval is not None}

    @property
    def stated(self) -> dict[str, tuple[float, float]]:
        """Those of ``priors`` that were stated for this fit."""
        named = {each.name for each in self.moved if each.stated}
        return {name: interval for name, interval in self.priors.items() if name in named}

    def with_priors(self, intervals: Mapping[str, tuple[float, float]]) -> ParameterSpace:
        """Return it with priors of numbers, or of all values of a parameter, by ``within``."""
        moved = list(self.moved)
        for name in sorted(intervals, key=lambda name: "[" in name):  # the more special one last
            places = [k for k, each in enumerate(moved) if each.name == name
                      or (each.parameter.name == name and not each.effect)]  # fmt: skip
            require(places, "prior", f"must be of a fitted number: {', '.join(self.names)}", name)
            for k in places:
                own = moved[k].parameter.within(*intervals[name])
                moved[k] = replace(moved[k], parameter=own, stated=True)
        return replace(self, moved=tuple(moved))

    @cached_property
    def _priors(self) -> tuple[Integers, Array, Array]:
        """Places, medians and standard deviations, on the scale, of the numbers with a prior."""
        pairs = [(k, each.parameter) for k, each in enumerate(self.moved)
                 if each.parameter.prior is not None]  # fmt: skip
        priors = [
            (float(p.scaled(p.prior[0])), p.prior[1]) for _, p in pairs if p.prior is not None
        ]
        medians, spreads = np.reshape(priors, (-1, 2)).T
        return np.array([k for k, _ in pairs], dtype=np.int64), medians, spreads

    def log_prior(self, vector: Array) -> float:
        """Return the log prior density on the scale, up to a constant; 0 without priors."""
        places, medians, spreads = self._priors
        if not len(places):
            return 0.0
        return float(-0.5 * (((self.to_scale(vector)[places] - medians) / spreads) ** 2).sum())

    def prior_slope(self, vector: Array) -> tuple[Array, Array]:
        """Return the slope of the log prior by each number, and its precision, (numbers,)."""
        places, medians, spreads = self._priors
        slope, precision = np.zeros((2, len(vector)))
        if len(places):
            change = self._scale_change(vector)
            away = self.to_scale(vector)[places] - medians
            slope[places] = -away / spreads**2 * change[places]
            precision[places] = (change[places] / spreads) ** 2
        return slope, precision

    def log_slope(self, vector: Array) -> float:
        """Return the log density, in their own units, of priors that are flat on the scale."""
        places, *_ = self._priors
        return (
            float(np.log(np.abs(self._scale_change(vector)[places])).sum()) if len(places) else 0.0
        )

    def _scale_change(self, vector: Array) -> Array:
        """Return the change of the scale of each number by the number, (numbers,)."""
        step = 1e-6 * np.maximum(np.abs(vector), 1e-3)
        return np.asarray(
            (self.to_scale(vector + step) - self.to_scale(vector - step)) / (2 * step)
        )

    @property
    def low(self) -> Array:
        """Lower bounds."""
        return np.array([each.parameter.low for each in self.moved])

    @property
    def high(self) -> Array:
        """Upper bounds."""
        return np.array([each.parameter.high for each in self.moved])

    @property
    def start(self) -> Array:
        """Start of a fit."""
        return np.array([each.parameter.start for each in self.moved])

    def started(self, guesses: Mapping[str, float]) -> Array:
        """Return a start with these values, in all cells, of parameters whose default isn't 0."""
        start = self.start
        for k, each in enumerate(self.moved):
            of = next(one for one in self.parameters if one.name == each.parameter.name)
            if of.name in guesses:
                value = float(np.clip(guesses[of.name], of.low, of.high))
                value *= start[k] / of.start if each.effect else 1.0
                start[k] = np.clip(value, each.parameter.low, each.parameter.high)
        return start

    def at_bound(self, vector: Array) -> Truths:
        """Return which numbers are at a bound, as are coefficients of a parameter at one."""
        bounds, width = np.stack([self.low, self.high]), AT_BOUND * (self.high - self.low)
        # Ranges of numbers that differ by factors are far wider than likely values.
        least = np.where(self.by_factors, AT_BOUND * (np.abs(bounds) + width), width)
        away = np.array([vector - bounds[0], bounds[1] - vector])
        at_bound = np.asarray((away < least).any(axis=0))
        for each in self._sums:
            if each.bounded:
                value, close = each.value(vector), AT_BOUND * (each.high - each.low)
                ends = (value - each.low < close) | (each.high - value < close)
                at_bound[each.places] |= (each.design[:, ends] != 0).any(axis=1)
        return at_bound

    def inside(self, vector: Array) -> bool:
        """Return whether numbers, and the parameter in every cell, are within their bounds."""
        if not ((vector >= self.low) & (vector <= self.high)).all():
            return False
        for each in self._sums:
            if each.bounded:
                value, rounding = each.value(vector), 1e-9 * (each.high - each.low)
                if not ((value > each.low - rounding) & (value < each.high + rounding)).all():
                    return False
        return True

    @cached_property
    def _sums(self) -> list[_Sum]:
        """The parameters that have free numbers."""
        sums = []
        for each in self.parameters:
            places = [k for k, one in enumerate(self.moved) if one.parameter.name == each.name]
            if places:
                design = np.array([self.moved[k].weights for k in places], float)
                effects = any(self.moved[k].effect for k in places)
                sums.append(_Sum(each.name, np.array(places), design, each.low, each.high, effects))
        return sums

    @property
    def held(self) -> dict[str, float]:
        """Values of the parameters that are fixed in some or all cells."""
        free = {each.name for each in self._sums if each.everywhere}
        return {p.name: p.start for p in self.parameters if p.name not in free}

    def values(self, vector: Array) -> dict[str, Array]:
        """Return each parameter in every cell, (cells,); formulas are limited to its range."""
        values = {name: start.copy() for name, start in self._starts.items()}
        for each in self._sums:
            value = each.value(vector)
            if each.bounded:
                value = np.clip(value, each.low, each.high)
            if not each.everywhere:
                value = np.where(each.applies, value, values[each.name])
            values[each.name] = value
        return values

    @cached_property
    def _starts(self) -> dict[str, Array]:
        return {each.name: np.full(self.cells, each.start) for each in self.parameters}


def told_priors(intervals: Mapping[str, tuple[float, float]]) -> str:
    """Return priors as a line of text, "" without any."""
    told = [f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in intervals.items()]
    more = f", and {len(told) - MOST_TOLD} more" if len(told) > MOST_TOLD else ""
    return f"priors (central 95 %): {', '.join(told[:MOST_TOLD])}{more}" if told else ""


def freedom(
    parameters: Sequence[Parameter],
    conditions: Mapping[str, Sequence[str]],
    cells: int,
    *,
    free: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    vary: Mapping[str, str] | None = None,
    designs: Mapping[str, Mapping[str, Array]] | None = None,
) -> ParameterSpace:
    """Return the free numbers of a fit; ``conditions`` has the level of each cell by column.

    ``vary`` gives a parameter a value in each level (``column/level`` fixes a level), ``designs``
    makes one linear in columns (cells,), as of ``formulas.Formula.matrix``.
    """
    fixed, vary, designs = dict(fixed or {}), dict(vary or {}), dict(designs or {})
    known = {each.name: each for each in parameters}
    added = [name for name in free or () if name.startswith(ADDED)]
    free = None if free is None else [name.removeprefix(ADDED) for name in free]
    for name in (*(free or ()), *fixed, *vary, *designs):
        if name not in known:
            raise InputError(f"no parameter is called {name!r}; there are {', '.join(known)}", name)
    for name, value in fixed.items():
        low, high = known[name].low, known[name].high
        must = f"must lie between {low:g} and {high:g}"
        require(low <= value <= high, name, must, value)
        known[name] = replace(known[name], start=value, free=False)
    default = {each.name for each in known.values() if each.free and (added or free is None)}
    chosen = default.union(free or ())
    held = sorted({*(free or ()), *vary, *designs} & set(fixed))
    if held:
        raise InputError(f"{', '.join(held)} can't be both free and fixed", "fix", held)
    twice = ", ".join(sorted(set(vary) & set(designs)))
    require(not twice, "vary", "must not hold a parameter with a formula", twice)
    designs |= {name: _levels(name, column, conditions) for name, column in vary.items()}
    moved: list[FreeParameter] = []
    for each in known.values():
        if each.name in designs:
            moved += _numbers(each, designs[each.name])
        elif each.name in chosen:
            moved.append(FreeParameter(each.name, each, np.ones(cells)))
    if not moved:
        raise InputError(f"no parameter is free: name some of {', '.join(known)}", "free", free)
    return ParameterSpace(tuple(known.values()), tuple(moved), cells)


def _levels(name: str, column: str, conditions: Mapping[str, Sequence[str]]) -> dict[str, Array]:
    """Return the columns of a design with a separate value in each level, but for a reference."""
    column, _, reference = column.partition("/")
    if column not in conditions:
        there = ", ".join(conditions) or "none"
        raise InputError(f"{name} can't vary with {column!r}: conditions are {there}", "vary")
    names = np.asarray(conditions[column])
    levels = sorted(set(names.tolist()))
    if reference and reference not in levels:
        raise InputError(f"{column} has no level {reference!r}: {', '.join(levels)}", "vary")
    return {
        f"{column}={level}": (names == level).astype(float)
        for level in levels
        if level != reference
    }


def _numbers(each: Parameter, design: Mapping[str, Array]) -> list[FreeParameter]:
    columns = np.array(list(design.values()), float)
    levels = bool(np.isin(columns, (0, 1)).all() and (columns.sum(axis=0) <= 1).all())
    numbers = []
    for k, label in enumerate(design):
        parameter = each
        if not levels:
            low, high, start = ranged((each.low, each.high), each.start, columns, k)
            parameter = replace(each, low=low, high=high, start=start, scale="identity", prior=None)
        numbers.append(FreeParameter(f"{each.name}[{label}]", parameter, columns[k], not levels))
    return numbers
