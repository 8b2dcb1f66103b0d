"""Parameters of a model, and which of them a fit may move, over which conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bgmodel.support.arrays import Array, Integers, Truths
from circuits.errors import InputError, require

AT_BOUND = 1e-3
"""Share of its range within which a number of a fit counts as at a bound."""


@dataclass(frozen=True)
class Parameter:
    """A number that a fit may move.

    Parameters
    ----------
    name : str
        With its unit.
    low, high : float
        Its bounds.
    start : float
        What it is unless a fit moves it, and where a fit begins.
    about : str
        What it is.
    free : bool
        Whether a fit moves it unless it is told otherwise.
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
        What it is.
    cells : int array
        Where it holds.
    """

    name: str
    parameter: Parameter
    cells: Integers


@dataclass(frozen=True)
class ParameterSpace:
    """What a fit moves: from a vector of numbers to the parameters of every cell, and back.

    Parameters
    ----------
    parameters : sequence of Parameter
        All of the model.
    moved : tuple of FreeParameter
        Those that the fit moves, in order.
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
        """Where a fit begins."""
        return np.array([each.parameter.start for each in self.moved])

    def at_bound(self, vector: Array) -> Truths:
        """Return which numbers of a fit lie at a bound of their range, (numbers,)."""
        near = AT_BOUND * (self.high - self.low)
        return np.asarray((vector - self.low < near) | (self.high - vector < near))

    @property
    def held(self) -> dict[str, float]:
        """Values of the parameters that a fit leaves alone in some cell, or in all."""
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
    """Return what a fit moves.

    Parameters
    ----------
    parameters : sequence of Parameter
        Of the model.
    conditions : dict of str to sequence of str (cells,)
        What each cell is called in each column of conditions.
    cells : int
        Number of cells.
    free : sequence of str, optional
        Parameters that the fit moves; those that say so themselves if left out.
    fixed : dict of str to float, optional
        Parameters that are held, and where.
    vary : dict of str to str, optional
        Parameters with a value of their own in each level of a column; ``column/level`` holds one
        level where the parameter stands.

    Raises
    ------
    ValueError
        For a name that is none, a value beyond its bounds, or nothing to move.
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
        raise InputError(f"{', '.join(held)} can't be moved and fixed at once", "fix", held)
    moved: list[FreeParameter] = []
    for each in known.values():
        if each.name in vary:
            moved += _levels(each, vary[each.name], conditions)
        elif each.name in chosen:
            moved.append(FreeParameter(each.name, each, np.arange(cells)))
    if not moved:
        raise InputError(f"nothing is free: name some of {', '.join(known)}", "free", free)
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
