"""Whether data of a group differ from a hierarchical fit by more than chance.

Each person's trials are compared with the model at the medians of that person's parameters. The
three tests of ``misfit`` are applied to sums over all people, which reveal differences too small to
be detected in single people; simulated trials are the same for all people, and so is their error.
Of single people only the distribution of responses and their times is tested: with fewer than a
hundred trials in a cell, means and shares are not Gaussian enough for as many tests as there are
people.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add

import pandas as pd

from bgmodel.fitting.checks.misfit import (
    BEYOND_CHANCE,
    ENOUGH,
    NAMED,
    TIMES,
    Excess,
    Misfit,
    misfit,
    p_values,
)
from bgmodel.fitting.optimum import Optimum

TOGETHER = "all people together"
"""Name of the sums over people in warnings, in place of a person's."""


@dataclass(frozen=True)
class GroupMisfit:
    """Difference between the data of a group and a hierarchical fit."""

    people: dict[str, Misfit]
    # Strength and levels of conditions of each person's cells.
    cells: dict[str, list[tuple[float | str, ...]]]

    @cached_property
    def together(self) -> dict[str, float]:
        """Probability of a larger chi-square of all people together, for each of three tests."""
        return p_values({test: self.sums(test) for test in ENOUGH})

    def sums(self, test: str) -> Excess:
        """Return the sums over all people; those of cells by cell, which some may lack."""
        every = {who: each.excess[test] for who, each in self.people.items()}
        if test == TIMES:
            return reduce(add, every.values())
        cells = dict.fromkeys(cell for of_person in self.cells.values() for cell in of_person)
        place = {cell: number for number, cell in enumerate(cells)}
        parts = (
            one.placed([place[cell] for cell in self.cells[who]], len(place))
            for who, one in every.items()
        )
        return reduce(add, parts)

    def beyond_chance(self) -> pd.Series:
        """Return p values below 0.003 / their number, by person and test, the smallest first."""
        every = {(TOGETHER, test): p for test, p in self.together.items()}
        every |= {(who, TIMES): each.p[TIMES] for who, each in self.people.items()}
        p_values = pd.Series(every)
        return p_values[len(p_values) * p_values < BEYOND_CHANCE].sort_values(kind="stable")

    def cautions(self) -> list[str]:
        """Return a warning that names the people and the tests with a misfit."""
        p_values = self.beyond_chance()
        if p_values.empty:
            return []
        told = "; ".join(
            f"{test} of {who} (p = {p_values[who, test]:.1g})"
            for who, test in p_values.index[:NAMED]
        )
        more = f" and {len(p_values) - NAMED} more" if len(p_values) > NAMED else ""
        return [
            f"the model does not fit: data differ from it by more than chance in {told}{more}. "
            "Parameters may be far off: see cells() (people_cells.csv) and plot_cells(), check for "
            "guesses and for strengths in another unit, or fit another model"
        ]


def group_misfit(people: Mapping[str, Optimum]) -> GroupMisfit:
    """Return the misfit of a hierarchical fit; all people have one model."""
    misfits, cells = {}, {}
    for who, each in people.items():
        design = each.likelihood.design
        cells[who] = list(zip(design.strength.tolist(), *design.conditions.values(), strict=True))
        parts = [(part, each.vector) for part in each.likelihood.without_parts()]
        misfits[who] = misfit(each, parts)
    return GroupMisfit(misfits, cells)
