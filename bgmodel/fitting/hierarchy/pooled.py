"""Data and model in each cell of the design, with the trials of all people together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pandas as pd

from bgmodel.fitting.exact.responses import Grid, Observed
from bgmodel.fitting.fit import cells_of
from bgmodel.fitting.optimum import Optimum


def pooled(people: Collection[Optimum]) -> pd.DataFrame | None:
    """Return ``cells_of`` everyone's trials and model, or None if strengths or conditions differ.

    The prediction for a cell is the mixture of the people's distributions, each with the share of
    that person's trials, so that data and model are pooled alike: quantiles of errors exist where
    all people together make enough of them, and none is biased by few trials of single people.
    Standard errors are as if all trials were of one person.
    """
    people = [each.complete for each in people]
    designs = [each.likelihood.design for each in people]
    every = [list(zip(each.strength, *each.conditions.values(), strict=True)) for each in designs]
    order = {cell: number for number, cell in enumerate(every[0])}
    if any(set(cells) != set(order) for cells in every):
        return None
    places = [np.array([order[cell] for cell in cells]) for cells in every]
    mass = np.zeros((len(order), 2, max(each.grid.bins for each in designs)))
    trials = np.zeros(len(order))
    for each, design, place in zip(people, designs, places, strict=True):
        predicted, _ = design.observed.outcomes(each.density)
        mass[place, :, : predicted.shape[2]] += design.trials[:, None, None] * predicted
        trials[place] += design.trials
    seen = [design.observed for design in designs]
    together = Observed(
        np.concatenate([place[one.cell] for place, one in zip(places, seen, strict=True)]),
        np.concatenate([one.response for one in seen]),
        np.concatenate([one.rt_s for one in seen]),
        Grid(mass.shape[2], seen[0].grid.width_s),
        alternatives=seen[0].alternatives,
        untimed=seen[0].untimed,
    )
    density = mass / trials[:, None, None] / seen[0].grid.width_s
    return cells_of(replace(designs[0], observed=together), density)
