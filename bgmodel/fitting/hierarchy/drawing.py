"""The figure of a group's fit: everyone's parameters, and the distribution of the group."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

COLUMNS = 3
"""Panels in a row."""


@styled
def draw_group(people: pd.DataFrame, group: pd.DataFrame, trials: int) -> Figure:
    """Draw a panel for each parameter: people in the order of their medians, and the group.

    Points are medians and lines central intervals of 0.9; the dashed line and the band are the
    median person's parameter and its interval.

    Parameters
    ----------
    people : DataFrame
        Participant, parameter, median, low and high.
    group : DataFrame
        Median, low and high of each parameter, its index.
    trials : int
        Number of trials, for the title.
    """
    count = people["participant"].nunique()
    rows = -(-len(group) // COLUMNS)
    figure, grid = panels(rows, COLUMNS, size=(7.2, 0.5 + rows * (0.9 + 0.13 * count)))
    axes = grid.ravel()
    for ax, (name, shared) in zip(axes, group.iterrows(), strict=False):
        own = people[people["parameter"] == name].sort_values("median")
        place = np.arange(count)
        ax.axvspan(shared["low"], shared["high"], color=PALETTE[0], alpha=0.2, lw=0)
        ax.axvline(shared["median"], color=PALETTE[0], ls="--")
        ax.hlines(place, own["low"], own["high"], color=GREY, lw=1)
        ax.plot(own["median"], place, "ko", ms=3)
        ax.set(title=name, yticks=place, ylim=(-0.8, count - 0.2))
        ax.set_yticklabels(own["participant"], fontsize=5.5)
    for row in grid:
        row[0].set_ylabel("Participant")
    for ax in axes[len(group) :]:
        ax.remove()
    figure.suptitle(
        f"{count} people, {trials} trials: medians and intervals of 90 % of each person (black) "
        "and of the median person (colour)",
        x=0.01,
        ha="left",
    )
    return figure
