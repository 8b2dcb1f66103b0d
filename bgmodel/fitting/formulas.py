"""Formulas of parameters over the conditions of a trial, such as ``bound ~ instruction * side``."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.trials.record import MOST_LEVELS, is_covariate
from circuits.arrays import Array, Integers
from circuits.errors import InputError

FAR = 50.0
"""Distance of a covariate's mean from 0, in its standard deviations, beyond which intercept and
slope are too correlated for the search."""


@dataclass(frozen=True)
class Formula:
    """A parameter as a linear function of conditions, in the notation of Wilkinson & Rogers."""

    parameter: str
    terms: str  # The right side, as the library formulaic reads it.

    @property
    def columns(self) -> list[str]:
        """Columns of the table of trials that the terms name."""
        names: set[str] = set()
        for term in self._parsed():
            for factor in term.factors:
                if factor.eval_method.value != "literal":
                    column = factor.eval_method.value == "lookup"
                    names |= {str(factor.expr)} if column else _names(str(factor.expr))
        return sorted(names)

    def check_trials(self, conditions: pd.DataFrame) -> None:
        """Refuse levels of a covariate, which a fit sorts into groups."""
        for column in self.columns:
            named = rf"\bC\(\s*`?{re.escape(column)}\b"
            if column in conditions and re.search(named, self.terms):
                values = conditions[column]
                if is_covariate(values):
                    self._refuse_levels(column, values.nunique())

    def _refuse_levels(self, column: str, count: int) -> None:
        raise self._refused(f"needs at most {MOST_LEVELS} levels of {column!r}, which has {count}")

    def matrix(
        self, conditions: Mapping[str, Sequence[str]], cell: Integers, cells: int
    ) -> dict[str, Array]:
        """Return the columns of the design by name, (cells,) each.

        Levels that are all numbers have a slope; functions such as ``center`` are over trials.
        """
        from formulaic.errors import FormulaicError

        parsed, frame = self._parsed(), self._frame(conditions, cells)
        places, first = np.unique(cell, return_index=True)
        try:
            with np.errstate(divide="ignore", invalid="ignore"):
                made = parsed.get_model_matrix(
                    frame.iloc[cell], na_action="ignore", output="pandas"
                )
        except FormulaicError as error:
            raise self._refused(f"cannot be computed ({_first_line(error)})") from None
        design = np.full((len(frame), made.shape[1]), np.nan)
        design[places] = np.asarray(made, float)[first]
        labels = [_label(str(name)) for name in made.columns]
        self._check(design, labels)
        self._check_far(design[places], labels)
        return dict(zip(labels, design.T, strict=True))

    def _parsed(self) -> Any:
        try:
            import formulaic
        except ImportError as error:
            raise ImportError('formulas need formulaic: pip install ".[fit]"') from error
        try:
            parsed = formulaic.Formula(self.terms)
        except Exception as error:  # its parser fails on some texts with an AttributeError
            raise self._refused(f"cannot be read ({_first_line(error)})") from None
        if not isinstance(parsed, formulaic.SimpleFormula):
            raise self._refused("must have one part, without |")
        return parsed

    def _frame(self, conditions: Mapping[str, Sequence[str]], cells: int) -> pd.DataFrame:
        frame = {}
        for column in self.columns:
            if column not in conditions:
                there = ", ".join(conditions) or "none"
                raise self._refused(f"has the unknown column {column!r}: conditions are {there}")
            count, texts = len(set(conditions[column])), pd.Series(list(conditions[column]))
            numbers = pd.to_numeric(texts, errors="coerce")
            levels = bool(numbers.isna().any())
            if count < 2:
                raise self._refused(f"needs two values of {column!r}, which has one: leave it out")
            if levels and count > MOST_LEVELS:
                self._refuse_levels(column, count)
            frame[column] = texts if levels else numbers
        return pd.DataFrame(frame, index=range(cells))

    def _check(self, design: Array, labels: list[str]) -> None:
        if not np.isfinite(design).all() or not design.any(axis=1).all():
            raise self._refused("must give every combination of conditions a finite, non-zero term")
        empty = [name for name, column in zip(labels, design.T, strict=True) if not column.any()]
        if empty:
            raise self._refused(f"has a term without trials: {', '.join(empty)}")
        ranks = [np.linalg.matrix_rank(design[:, : k + 1]) for k in range(len(labels))]
        extra = [name for k, name in enumerate(labels) if ranks[k] == (ranks[k - 1] if k else 0)]
        if extra:
            raise self._refused(
                f"is collinear in these trials: {', '.join(extra)} follows from the other terms"
            )

    def _check_far(self, design: Array, labels: list[str]) -> None:
        spread = np.maximum(design.std(axis=0), 1e-300)
        for label, column, sd in zip(labels, design.T, spread, strict=True):
            if np.ptp(column) and abs(column.mean()) > FAR * sd:
                raise self._refused(
                    f"has values of {label} that are far from 0 ({column.mean():.6g} +- {sd:.2g}), "
                    f"so that no fit can tell intercept and slope apart: write center({label})"
                )

    def _refused(self, why: str) -> InputError:
        return InputError(f"formula {self.parameter} ~ {self.terms} {why}", "formula", self.terms)


def formula_of(text: str) -> Formula:
    """Return a formula from its text; ValueError unless it is a parameter, ``~`` and terms."""
    parts = [part.strip() for part in text.split("~")] if isinstance(text, str) else []
    if len(parts) != 2 or not all(parts):
        must = "must be a parameter, ~, and terms, such as 'bound ~ instruction * side'"
        raise InputError.of("formula", must, text)
    return Formula(*parts)


def ranged(
    within: tuple[float, float], start: float, columns: Array, k: int
) -> tuple[float, float, float]:
    """Return the range and the start of coefficient ``k`` of a formula: low, high, start.

    By linear programming over all coefficients that keep the parameter ``within`` its range;
    ``columns`` are (coefficients, cells), independent.
    """
    from scipy.optimize import linprog

    rows = np.unique(columns.T, axis=0)
    limits = np.concatenate([rows, -rows]), np.repeat([within[1], -within[0]], len(rows))
    aim = np.eye(len(columns))[k]
    ends = [linprog(sign * aim, *limits, bounds=(None, None)).fun for sign in (1, -1)]
    coefficient = np.linalg.lstsq(rows, np.full(len(rows), start), rcond=None)[0][k]
    low, high = float(ends[0]), float(-ends[1])
    return low, high, float(np.clip(round(coefficient, 12), low, high))


def _names(factor: str) -> set[str]:
    """Return the columns in an expression: names in backticks, and those not of functions."""
    nodes = list(ast.walk(ast.parse(re.sub("`.*?`", "0", factor.strip()), mode="eval")))
    called = {id(node.func) for node in nodes if isinstance(node, ast.Call)}
    modules = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    names = [node for node in nodes if isinstance(node, ast.Name)]
    quoted = {*re.findall("`(.*?)`", factor)}
    return quoted | {node.id for node in names if id(node) not in called | modules}


def _label(name: str) -> str:
    """Return the name of a column, with a level as ``column=level`` where it is not a contrast."""
    return re.sub(r"(\w+)\[(?!T\.)([^\]]*)\]", r"\1=\2", name)


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]
