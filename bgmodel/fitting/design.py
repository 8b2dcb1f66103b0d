"""The design behind a table of choices and times: its cells, and the data binned on a grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.fitting.responses import BIN_S, ENDS_S, EVERY_TIME, BinnedResponses, Grid
from bgmodel.fitting.sides import check_sides, name_of
from bgmodel.support.checks import reals
from bgmodel.trials.columns import EVERYONE, FEWEST
from bgmodel.trials.record import Trials, is_covariate
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require

RANGES = 25.0
"""Interquartile ranges above the upper quartile at which the default window ends.

No decision of a constant gap is that late: an exponential tail, such as its own, exceeds this in
fewer than one of 10^12 trials. Lapses may.
"""
ENOUGH = 20
"""Least number of responses of a cell for its quartiles to be used separately."""

SHORT_TAIL, TAIL_CHANCE = 2.2, 1e-5
"""Means of an exponential tail within which the slowest tenth of times ends if it was cut off
(that of a Gaussian does not), and the probability of so early an end by chance."""


def fence_s(rt_s: Array, cell: Integers) -> float:
    """Return the end of the default window, s; infinity if the quartiles are equal.

    The latest, over cells, of the upper quartile plus 25 interquartile ranges.
    """
    answered = np.isfinite(rt_s)
    groups = [rt_s[answered & (cell == each)] for each in np.unique(cell)]
    groups = [group for group in groups if len(group) >= ENOUGH] or [rt_s[answered]]
    fences = []
    for group in groups:
        lower, upper = np.quantile(group, [0.25, 0.75]) if len(group) else (0.0, 0.0)
        fences.append(upper + RANGES * (upper - lower) if upper > lower else math.inf)
    return float(max(fences))


def in_window(
    rt_s: Array,
    cell: Integers,
    rt_window: tuple[float, float] | None,
    deadline_s: float | None,
    who: str,
) -> tuple[tuple[float, float], Truths]:
    """Return the window of a fit, s, and which trials are in it; warn of excluded trials.

    By default, without a deadline, it ends at ``fence_s``.
    """
    rule = ""
    if rt_window is not None:
        ends = reals("rt_window", rt_window)
        must = "must be an earliest and a later latest time, 0 s or more, such as 0.2 5 (inf for "
        good = ends.shape == (2,) and 0 <= ends[0] < ends[1]
        require(good, "rt_window", must + "no latest one)", rt_window)
        window = (float(rt_window[0]), float(rt_window[1]))
    elif deadline_s is None:
        window = (0.0, fence_s(rt_s, cell))
        rule = f" (upper quartile plus {RANGES:g} interquartile ranges)"
    else:
        window = EVERY_TIME
    inside = np.isnan(rt_s) | ((rt_s >= window[0]) & (rt_s <= window[1]))
    out, responses = int((~inside).sum()), int(np.isfinite(rt_s).sum())
    span = f"between {window[0]:g} and {window[1]:.3g} s{rule}"
    if out and responses - out < FEWEST:
        raise InputError(
            f"rt_window must leave at least {FEWEST} responses, got {responses - out} of "
            f"{responses} of {who} {span}",
            "rt_window",
        )
    if out:
        DataWarning.warn(
            f"{who}: {out} of {responses} response times are excluded from the fit, the longest "
            f"{rt_s[~inside].max():.3g} s: it uses those {span}. To change this: rt_window (at the "
            "terminal --columns rt_window=); 0,inf keeps all"
        )
    elif rule:
        # All trials are included: the likelihood is that of all times.
        _warn_of_cut(rt_s[np.isfinite(rt_s)], who)
        window = EVERY_TIME
    return window, inside


def _warn_of_cut(times_s: Array, who: str) -> None:
    """Warn if times end abruptly, compared with an exponential tail from the upper quartile on."""
    upper, tenth = np.quantile(times_s, [0.75, 0.9]) if len(times_s) else (0.0, 0.0)
    if upper == tenth:
        return
    tail = math.log(2.5) * (times_s.max() - tenth) / (tenth - upper)
    if tail < SHORT_TAIL and (1 - math.exp(-tail)) ** (len(times_s) / 10) < TAIL_CHANCE:
        DataWarning.warn(
            f"{who}: response times end abruptly at {times_s.max():.4g} s: if later trials were "
            "left out, the fit needs to know, since it takes all times to be there: end the "
            "window at that time (rt_window, at the terminal --columns rt_window=0,T)"
        )


FAVOURS = "favours"
"""Condition of a design by sides: the response, 0 or 1, that the strength of a cell favours."""
GROUPS = 10
"""Number of groups of equal size into which trials are sorted by a covariate."""
ALONE = 1.0
"""Strength of every trial if there is no column of strengths."""


@dataclass(frozen=True)
class Design:
    """Cells of a design: strengths and conditions, and their trials.

    Strengths are absolute: a trial of negative strength is treated as the mirror image of a
    positive one, with its responses exchanged.
    """

    strength: Array
    conditions: dict[str, list[str]]  # Level of each cell in each column.
    observed: BinnedResponses  # Response 1 is the one that the strength favours.
    left_out: int = 0  # Number of trials outside the window of response times.
    who: str = EVERYONE
    choices: Trials | None = None  # Trials of the table within that window.

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.strength)

    @property
    def trials(self) -> Integers:
        """Number of trials in each cell, (cells,)."""
        return np.bincount(self.observed.cell, minlength=self.cells)

    @property
    def grid(self) -> Grid:
        """Grid of the densities."""
        return self.observed.grid

    @property
    def timed(self) -> bool:
        """Whether any response has times."""
        return self.observed.untimed is None or not self.observed.untimed.all()

    @property
    def side(self) -> Array:
        """1 where observed response 1 is that of the table, -1 where it is response 0, (cells,)."""
        levels = self.conditions.get(FAVOURS, ["1"] * self.cells)
        return np.where(np.array(levels) == "0", -1.0, 1.0)

    def label(self, cell: int) -> str:
        """Return the name of a cell."""
        names = [f"{column} {levels[cell]}" for column, levels in self.conditions.items()]
        return ", ".join([f"strength {self.strength[cell]:g}", *names])

    def part(self, trials: Array | Integers) -> Design:
        """Return the same cells with a subset of the trials."""
        seen = self.observed
        few = replace(
            seen, cell=seen.cell[trials], response=seen.response[trials], rt_s=seen.rt_s[trials]
        )
        return replace(self, observed=few)


def design_of(
    choices: Trials,
    by: Sequence[str] = (),
    *,
    rt_window: tuple[float, float] | None = None,
    pooled: bool = False,
    sides: bool = False,
) -> Design:
    """Return the cells of a table of choices, by strength and some of its conditions.

    The likelihood is conditional on the window, s. ``pooled`` choices of several people give no
    warning; with ``sides`` strengths of opposite sign are separate cells.
    """
    for column in by:
        if column not in choices.conditions:
            there = ", ".join(choices.conditions.columns) or "none"
            raise InputError(f"no condition is called {column!r}; there are {there}", "by", column)
    people = choices.people()
    if len(people) > 1 and not pooled:
        named = ", ".join(people[:3]) + (", ..." if len(people) > 3 else "")
        DataWarning.warn(
            f"choices are of {len(people)} participants ({named}), and are pooled: "
            "parameters are then a mixture. Fit each on its own, "
            f"choices.where(choices.participant == {people[0]!r}), or set pooled=True"
        )
    check_sides(choices, by, biased=sides)
    return _laid(choices, by, rt_window, sides)


def _laid(
    choices: Trials, by: Sequence[str], rt_window: tuple[float, float] | None, sides: bool
) -> Design:
    """Return the cells of choices, with the trials within the window binned on a grid."""
    sides = sides or choices.withheld is not None
    response = mirrored(choices)
    strength, conditions, cell = cells_of(choices, by, sides)
    deadline_s = choices.deadline_s
    window, inside = in_window(choices.rt_s, cell, rt_window, deadline_s, name_of(choices))
    if not inside.all():
        rest = _laid(choices.where(inside), by, window, sides)
        return replace(rest, left_out=int((~inside).sum()))
    some = np.isfinite(choices.rt_s).any()
    answered = some or not choices.timed or deadline_s is not None
    require(answered, "response", "must be given in some trials", "none")
    longest = float(np.nanmax(choices.rt_s)) + 10 * BIN_S if some else ENDS_S
    grid = Grid(int(np.ceil((deadline_s or min(window[1], longest)) / BIN_S)))
    untimed = None if choices.timed else np.ones((len(strength), 2), dtype=bool)
    if choices.withheld is not None:
        favours = np.array(conditions[FAVOURS]) == "1"
        untimed = np.eye(2, dtype=bool)[np.where(favours == choices.withheld, 1, 0)]
    observed = BinnedResponses(
        cell, response, choices.rt_s, grid, deadline_s, window, choices.alternatives, untimed
    )
    return Design(strength, conditions, observed, who=name_of(choices), choices=choices)


def _levels(column: pd.Series) -> npt.NDArray[np.str_]:
    """Return the level of each trial; that of a covariate is the mean of its group.

    Ten groups of a Gaussian covariate keep 0.96 of its variance, and a slope has no bias. Equal
    values are in one group, and means have six digits of their differences.
    """
    if not is_covariate(column):
        return column.to_numpy(dtype=str)
    values = pd.to_numeric(column).to_numpy(float)
    ordered = np.sort(values)
    group = np.repeat(np.arange(GROUPS), [len(x) for x in np.array_split(ordered, GROUPS)])
    of = group[np.searchsorted(ordered, values)]
    labels = np.empty(len(values), dtype="U24")
    digits = 6 + max(0, int(np.log10(np.abs(values).max() / values.std())))
    for one in np.unique(of):
        labels[of == one] = f"{values[of == one].mean():.{digits}g}"
    return labels


def mirrored(choices: Trials, response: Integers | None = None) -> Integers:
    """Return the responses, by default those of the trials, 1 on the side the strength favours."""
    response = choices.response.astype(np.int64) if response is None else response
    if choices.strength is None:
        return response
    return np.where((choices.strength < 0) & (response >= 0), 1 - response, response)


def cells_of(
    choices: Trials, by: Sequence[str], sides: bool = False
) -> tuple[Array, dict[str, list[str]], Integers]:
    """Return the strength and the levels of each cell, and the cell of each trial."""
    signed = choices.strength
    strength = np.full(choices.trials, ALONE) if signed is None else np.abs(signed)
    columns = {column: _levels(choices.conditions[column]) for column in by}
    if sides:
        favoured = np.ones(choices.trials) if signed is None else signed >= 0
        columns[FAVOURS] = np.where(favoured, "1", "0")
    keys = list(zip(strength.tolist(), *columns.values(), strict=True))
    cells = sorted(set(keys))
    place = {key: number for number, key in enumerate(cells)}
    levels = {name: [str(key[1 + n]) for key in cells] for n, name in enumerate(columns)}
    return np.array([key[0] for key in cells]), levels, np.array([place[key] for key in keys])
