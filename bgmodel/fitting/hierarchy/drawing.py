"""The figure of a group's fit: everyone's parameters, and the distribution of the group."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
"""Panels in a row."""
WIDTH = 32
"""Characters in a line of a panel's title."""
LABELS = {"sensitivity": "sensitivity (1/√s)", "bound": "bound (√s)"}
"""Names of parameters with units; other names contain theirs."""


@styled
def draw_group(people: pd.DataFrame, group: pd.DataFrame, trials: int) -> Figure:
    """Draw a panel for each parameter: people in the order of their medians, and the group.

    Points are medians and lines central intervals of 0.9; the dashed line and the band are the
    median person's parameter and its interval. Values of one parameter in several conditions share
    the axis, and the order of the first.
    """
    count = people["participant"].nunique()
    rows = -(-len(group) // COLUMNS)
    figure, grid = panels(rows, COLUMNS, size=(7.2, 0.5 + rows * (1.1 + 0.13 * count)))
    axes = grid.ravel()
    place = np.arange(count)
    first: dict[str, tuple[pd.Index, Axes]] = {}
    for ax, (name, shared) in zip(axes, group.iterrows(), strict=False):
        parameter, _, condition = str(name).removesuffix("]").partition("[")
        estimates = people[people["parameter"] == name].set_index("participant")
        # Coefficients of a formula are values of different kinds.
        alike = parameter if "=" in condition else str(name)
        order, like = first.setdefault(alike, (estimates["median"].sort_values().index, ax))
        estimates = estimates.loc[order]
        if like is not ax:
            ax.sharex(like)
        ax.axvspan(shared["low"], shared["high"], color=PALETTE[0], alpha=0.2, lw=0)
        ax.axvline(shared["median"], color=PALETTE[0], ls="--")
        ax.hlines(place, estimates["low"], estimates["high"], color=GREY, lw=1)
        ax.plot(estimates["median"], place, "ko", ms=3)
        ax.set(title=fill(condition, WIDTH), yticks=place, ylim=(-0.8, count - 0.2))
        label = LABELS.get(parameter, parameter)
        plain = "=" in condition or condition in ("", "Intercept")
        ax.set_xlabel(label if plain else f"{label}: coefficient")
        ax.set_yticklabels(estimates.index, fontsize=5.5)
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
