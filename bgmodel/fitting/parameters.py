"""Parameters of a model, which of them are free in a fit, and over which conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.formulas import ranged
from bgmodel.support.arrays import Array, Integers, Truths
from circuits.errors import InputError, require

AT_BOUND = 1e-3
"""A number of a fit counts as at a bound within this share of its range."""


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
    """

    name: str
    low: float
    high: float
    start: float
    about: str = ""
    free: bool = True

    def __post_init__(self) -> None:
        given = (self.low, self.start, self.high)
        if not (all(map(math.isfinite, given)) and self.low <= self.start <= self.high):
            raise InputError(
                f"{self.name}: low <= start <= high must hold and be finite: {given}", "start"
            )


RESPONSE = (
    Parameter("t0_s", 0.05, 1.5, 0.3, "mean non-decision time"),
    Parameter("t0_sd_s", 0.01, 0.3, 0.05, "its standard deviation from trial to trial"),
    Parameter("lapse", 0.001, 0.2, 0.01, "share of trials that are lapses"),
)
"""Parameters of responses, the same for every model."""


@dataclass(frozen=True)
class FreeParameter:
    """One number of a fit: a parameter in some cells of a design, or a coefficient of a formula.

    Parameters
    ----------
    name : str
        ``t0_s``, ``t0_s[stimulation=on]`` or ``t0_s[stimulation[T.on]]``.
    parameter : Parameter
        The parameter, with the bounds and the start of this number.
    weights : array (cells,)
        Its column of the design: what the number is multiplied by in each cell. In cells where all
        numbers of a parameter have weight 0, the parameter keeps its default value.
    effect : bool
        Whether it is a difference or a slope: no cell has this number as its value.
    """

    name: str
    parameter: Parameter
    weights: Array
    effect: bool = False


@dataclass(frozen=True)
class _Sum:
    """A parameter whose value in each cell is a sum over numbers of a fit."""

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
    """The free numbers of a fit, and their mapping to the parameters of every cell.

    Parameters
    ----------
    parameters : sequence of Parameter
        All parameters of the model.
    moved : tuple of FreeParameter
        The free parameters, in order.
    cells : int
        Number of cells of the design.
    """

    parameters: tuple[Parameter, ...]
    moved: tuple[FreeParameter, ...]
    cells: int

    @property
    def names(self) -> list[str]:
        """Names of the numbers of a fit."""
        return [each.name for each in self.moved]

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

    def at_bound(self, vector: Array) -> Truths:
        """Return which numbers of a fit are at a bound of their range, (numbers,).

        A coefficient of a formula is at a bound as well if the parameter is, in any of its cells.
        """
        near = AT_BOUND * (self.high - self.low)
        found = np.asarray((vector - self.low < near) | (self.high - vector < near))
        for each in self._sums:
            if each.bounded:
                value, close = each.value(vector), AT_BOUND * (each.high - each.low)
                ends = (value - each.low < close) | (each.high - value < close)
                found[each.places] |= (each.design[:, ends] != 0).any(axis=1)
        return found

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
        found = []
        for each in self.parameters:
            own = [k for k, one in enumerate(self.moved) if one.parameter.name == each.name]
            if own:
                design = np.array([self.moved[k].weights for k in own], float)
                effects = any(self.moved[k].effect for k in own)
                found.append(_Sum(each.name, np.array(own), design, each.low, each.high, effects))
        return found

    @property
    def held(self) -> dict[str, float]:
        """Values of the parameters that are fixed in some or all cells."""
        free = {each.name for each in self._sums if each.everywhere}
        return {p.name: p.start for p in self.parameters if p.name not in free}

    def values(self, vector: Array) -> dict[str, Array]:
        """Return each parameter in every cell, (cells,), from the numbers of a fit.

        What a formula gives is limited to the range of the parameter.
        """
        found = {name: start.copy() for name, start in self._starts.items()}
        for each in self._sums:
            value = each.value(vector)
            if each.bounded:
                value = np.clip(value, each.low, each.high)
            if not each.everywhere:
                value = np.where(each.applies, value, found[each.name])
            found[each.name] = value
        return found

    @cached_property
    def _starts(self) -> dict[str, Array]:
        """The default value of each parameter in every cell, (cells,)."""
        return {each.name: np.full(self.cells, each.start) for each in self.parameters}


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
    """Return the free numbers of a fit.

    Parameters
    ----------
    parameters : sequence of Parameter
        Parameters of the model.
    conditions : dict of str to sequence of str (cells,)
        Level of each cell in each column of conditions.
    cells : int
        Number of cells.
    free : sequence of str, optional
        Parameters to fit; by default those with ``free``.
    fixed : dict of str to float, optional
        Fixed parameters and their values.
    vary : dict of str to str, optional
        Parameters with a separate value in each level of a column; ``column/level`` fixes one level
        at the default value.
    designs : dict of str to dict of str to array (cells,), optional
        Parameters that are linear in the columns of a design, as of ``formulas.Formula.matrix``;
        levels of ``vary`` are such columns too, 1 in the cells of a level and 0 in others.

    Raises
    ------
    ValueError
        For an unknown name, a value outside its bounds, or no free parameter.
    """
    fixed, vary, designs = dict(fixed or {}), dict(vary or {}), dict(designs or {})
    known = {each.name: each for each in parameters}
    for name in (*(free or ()), *fixed, *vary, *designs):
        if name not in known:
            raise InputError(f"no parameter is called {name!r}; there are {', '.join(known)}", name)
    for name, value in fixed.items():
        low, high = known[name].low, known[name].high
        must = f"must lie between {low:g} and {high:g}"
        require(low <= value <= high, name, must, value)
        known[name] = replace(known[name], start=value, free=False)
    chosen = {each.name for each in known.values() if each.free} if free is None else set(free)
    held = sorted({*(free or ()), *vary, *designs} & set(fixed))
    if held:
        raise InputError(f"{', '.join(held)} can't be both free and fixed", "fix", held)
    twice = sorted(set(vary) & set(designs))
    if twice:
        raise InputError(f"{', '.join(twice)} has a formula: leave it out of vary", "vary", twice)
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
    """Return the numbers of a parameter that is linear in the columns of a design."""
    columns = np.array(list(design.values()), float)
    levels = bool(np.isin(columns, (0, 1)).all() and (columns.sum(axis=0) <= 1).all())
    found = []
    for k, label in enumerate(design):
        own = each
        if not levels:
            low, high, start = ranged((each.low, each.high), each.start, columns, k)
            own = replace(each, low=low, high=high, start=start)
        found.append(FreeParameter(f"{each.name}[{label}]", own, columns[k], not levels))
    return found
