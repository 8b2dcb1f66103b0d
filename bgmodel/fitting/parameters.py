"""Parameters of a model, which of them are free in a fit, and over which conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

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
    """One number of a fit: a parameter, in all cells of a design or in some.

    Parameters
    ----------
    name : str
        ``t0_s``, or ``t0_s[stimulation=on]``.
    parameter : Parameter
        The parameter.
    cells : int array
        Indices of the cells in which it applies.
    """

    name: str
    parameter: Parameter
    cells: Integers


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
        """Return which numbers of a fit are at a bound of their range, (numbers,)."""
        near = AT_BOUND * (self.high - self.low)
        return np.asarray((vector - self.low < near) | (self.high - vector < near))

    @property
    def held(self) -> dict[str, float]:
        """Values of the parameters that are fixed in some or all cells."""
        moved: dict[str, set[int]] = {each.name: set() for each in self.parameters}
        for each in self.moved:
            moved[each.parameter.name].update(each.cells.tolist())
        return {p.name: p.start for p in self.parameters if len(moved[p.name]) < self.cells}

    def values(self, vector: Array) -> dict[str, Array]:
        """Return each parameter in every cell, (cells,), from the numbers of a fit."""
        found = {each.name: np.full(self.cells, each.start) for each in self.parameters}
        for each, value in zip(self.moved, vector, strict=True):
            found[each.parameter.name][each.cells] = value
        return found


def freedom(
    parameters: Sequence[Parameter],
    conditions: Mapping[str, Sequence[str]],
    cells: int,
    *,
    free: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    vary: Mapping[str, str] | None = None,
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

    Raises
    ------
    ValueError
        For an unknown name, a value outside its bounds, or no free parameter.
    """
    fixed, vary = dict(fixed or {}), dict(vary or {})
    known = {each.name: each for each in parameters}
    for name in (*(free or ()), *fixed, *vary):
        if name not in known:
            raise InputError(f"no parameter is called {name!r}; there are {', '.join(known)}", name)
    for name, value in fixed.items():
        low, high = known[name].low, known[name].high
        must = f"must lie between {low:g} and {high:g}"
        require(low <= value <= high, name, must, value)
        known[name] = replace(known[name], start=value, free=False)
    chosen = {each.name for each in known.values() if each.free} if free is None else set(free)
    held = sorted({*(free or ()), *vary} & set(fixed))
    if held:
        raise InputError(f"{', '.join(held)} can't be both free and fixed", "fix", held)
    moved: list[FreeParameter] = []
    for each in known.values():
        if each.name in vary:
            moved += _levels(each, vary[each.name], conditions)
        elif each.name in chosen:
            moved.append(FreeParameter(each.name, each, np.arange(cells)))
    if not moved:
        raise InputError(f"no parameter is free: name some of {', '.join(known)}", "free", free)
    return ParameterSpace(tuple(known.values()), tuple(moved), cells)


def _levels(
    each: Parameter, column: str, conditions: Mapping[str, Sequence[str]]
) -> list[FreeParameter]:
    column, _, reference = column.partition("/")
    if column not in conditions:
        there = ", ".join(conditions) or "none"
        raise InputError(f"{each.name} can't vary with {column!r}: conditions are {there}", "vary")
    names = np.asarray(conditions[column])
    levels = sorted(set(names.tolist()))
    if reference and reference not in levels:
        raise InputError(f"{column} has no level {reference!r}: {', '.join(levels)}", "vary")
    return [
        FreeParameter(f"{each.name}[{column}={level}]", each, np.flatnonzero(names == level))
        for level in levels
        if level != reference
    ]
