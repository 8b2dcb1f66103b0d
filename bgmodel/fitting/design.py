"""The design behind a table of choices and times: its cells, and the data laid on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bgmodel.arrays import Array, Integers
from bgmodel.fitting.responses import BIN_S, Grid, Observed
from bgmodel.tables.choices import Choices

ALONE = 1.0
"""Strength of every trial where there is no column of strengths."""


@dataclass(frozen=True)
class Design:
    """Cells of a design: strengths and conditions, and the trials that lie in them.

    Parameters
    ----------
    strength : array (cells,)
        At least 0: a trial of negative strength is the mirror image of a positive one, and is
        taken for one with its responses exchanged.
    conditions : dict of str to list of str (cells,)
        What each cell is called in each column.
    observed : Observed
        The trials; response 1 is the one that the strength speaks for.
    """

    strength: Array
    conditions: dict[str, list[str]]
    observed: Observed

    @property
    def cells(self) -> int:
        """How many."""
        return len(self.strength)

    @property
    def trials(self) -> Integers:
        """How many trials each cell has, (cells,)."""
        return np.bincount(self.observed.cell, minlength=self.cells)

    @property
    def grid(self) -> Grid:
        """That of the densities."""
        return self.observed.grid

    def label(self, cell: int) -> str:
        """Return what a cell is called."""
        names = [f"{column} {levels[cell]}" for column, levels in self.conditions.items()]
        return ", ".join([f"strength {self.strength[cell]:g}", *names])

    def part(self, trials: Array | Integers) -> Design:
        """Return the same cells with some of the trials."""
        seen = self.observed
        few = Observed(
            seen.cell[trials], seen.response[trials], seen.rt_s[trials], seen.grid, seen.deadline_s
        )
        return Design(self.strength, self.conditions, few)


def lean(choices: Choices) -> tuple[float, float]:
    """Return the bias to response 1, as a share of all responses, and its z score.

    Models are the same for both sides: a strength and its mirror image have one probability of a
    right response, and strength 0 has a half. The bias is the responses 1 beyond that, over all
    responses; z is the bias over its standard error where there is none, with the number of right
    responses at each strength given (Cochran 1954; Mantel & Haenszel 1959).

    Parameters
    ----------
    choices : Choices
        Of one person in one condition. Trials without a response do not count. Where there are no
        strengths, or a strength has no mirror image, nothing is known: 0 and 0.
    """
    if choices.strength is None:
        return 0.0, 0.0
    answered = choices.response >= 0
    strength, ones = choices.strength[answered], choices.response[answered] == 1
    beyond, variance = 0.0, 0.0
    for size in np.unique(np.abs(strength)):
        positive, negative = ones[strength == size], ones[strength == -size]
        if size == 0:
            beyond += positive.sum() - positive.size / 2
            variance += positive.size / 4
            continue
        trials, right = positive.size + negative.size, positive.sum() + (~negative).sum()
        # Right responses on one side more than its share; as many are missing on the other.
        beyond += 2 * (positive.sum() - positive.size * right / trials)
        spread = positive.size * negative.size * right * (trials - right)
        variance += 4 * spread / (trials**2 * max(trials - 1, 1))
    if not variance:
        return 0.0, 0.0
    return float(beyond / len(ones)), float(beyond / np.sqrt(variance))


def design_of(choices: Choices, by: Sequence[str] = ()) -> Design:
    """Return the cells of a table of choices, by strength and some of its conditions.

    Parameters
    ----------
    choices : Choices
        Of one person, or of several taken for one.
    by : sequence of str
        Columns of conditions.

    Raises
    ------
    ValueError
        For a column that is not among the conditions.
    """
    for column in by:
        if column not in choices.conditions:
            there = ", ".join(choices.conditions.columns) or "none"
            raise ValueError(f"no condition is called {column!r}; there are {there}")
    signed = choices.strength
    strength = np.full(choices.trials, ALONE) if signed is None else np.abs(signed)
    response = choices.response.astype(np.int64)
    if signed is not None:
        response = np.where((signed < 0) & (response >= 0), 1 - response, response)
    columns = [choices.conditions[column].to_numpy(dtype=str) for column in by]
    keys = list(zip(strength.tolist(), *columns, strict=True))
    cells = sorted(set(keys))
    place = {key: number for number, key in enumerate(cells)}
    longest = choices.deadline_s or float(np.nanmax(choices.rt_s)) + 10 * BIN_S
    grid = Grid(int(np.ceil(longest / BIN_S)))
    observed = Observed(
        np.array([place[key] for key in keys]), response, choices.rt_s, grid, choices.deadline_s
    )
    conditions = {column: [str(cell[1 + n]) for cell in cells] for n, column in enumerate(by)}
    return Design(np.array([cell[0] for cell in cells]), conditions, observed)
