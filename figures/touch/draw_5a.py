"""Figure 5a: the gap learned by REINFORCE with baseline, and its convergence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bgmodel.learning.gap import learn_folds
from bgmodel.learning.reinforce import Learner
from bgmodel.plots import acquisition
from bgmodel.support.files import read_table, write_table
from figures.common import COLOUR, Settings, key, letter

STARTS = (0.5, 7.5)
KEPT = 250


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Learn on six folds, several repeats each, from a narrow and from a wide gap."""
    table = read_table(taps)
    learner = Learner(episodes=settings.episodes)
    parts = [
        learn_folds(
            table,
            period,
            xi=settings.xi,
            starts=STARTS,
            repeats=settings.repeats,
            t_max=settings.t_max,
            seed=settings.seed,
            learner=learner,
            keep=KEPT,
        )
        for period in COLOUR
    ]
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings, learner=learner)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw a column per grating: the gap of all runs trial by trial, and the regret they end with.

    For both starts, the median and 10-90 % of all runs, with the exact optimum of each fold.
    """
    table = read_table(data)
    figure, axes = plt.subplots(2, 3, figsize=(7.2, 3.8), height_ratios=[2.4, 1], sharey="row")
    for (above, below), period in zip(axes.T, COLOUR, strict=True):
        here = table[table["period_mm"] == period]
        _gaps(above, here, COLOUR[period])
        _regret(below, here, COLOUR[period])
        letter(above, f"{period:g} mm")
    for ax in axes[:, 1:].flat:
        ax.set_ylabel("")
    axes[0, 0].set_ylabel("boundary separation δ (nats)")
    axes[1, 0].set_ylabel("runs")
    key(figure, more=_marks(), ncols=4)
    return figure


def _gaps(ax: Axes, here: pd.DataFrame, colour: str) -> None:
    for start, style in zip(STARTS, ("-", "--"), strict=True):
        some = here[here["start_separation"] == start]
        runs = some.pivot(index=["fold", "repeat"], columns="episode", values="smoothed_separation")
        acquisition(ax, runs, color=colour, ls=style)
    best = here.groupby("fold")["optimal_separation"].first()
    ax.axhspan(best.min(), best.max(), color="0.85", lw=0, zorder=0)
    ax.axhline(best.mean(), color="k", lw=0.8, ls=":")
    ax.set(xlabel="trial", ylim=(0, 8))


def _regret(ax: Axes, here: pd.DataFrame, colour: str) -> None:
    """Draw the distribution over runs of the final cost beyond the optimum of their fold."""
    final = here.groupby(["start_separation", "fold", "repeat"])["regret"].first() * 100
    bins: Any = np.linspace(0, max(6, np.ceil(final.max())), 19)
    kind: Any
    for start, kind in zip(STARTS, ("stepfilled", "step"), strict=True):
        ax.hist(final[start], bins, histtype=kind, color=colour, lw=0.8)
    ax.set(xlabel="cost beyond the optimum (%)")


def _marks() -> list[Any]:
    """Return the marks of all panels, in neutral colours."""
    narrow, wide = (f"from {start:g} nats: " for start in STARTS)
    grey: dict[str, Any] = {"color": "0.4"}
    return [
        Line2D([], [], **grey, label=f"{narrow}median"),
        Line2D([], [], **grey, ls="--", label=f"{wide}median"),
        Patch(**grey, alpha=0.3, lw=0, label="10-90 % of runs"),
        Patch(**grey, label=f"{narrow}runs"),
        Patch(fill=False, edgecolor="0.4", label=f"{wide}runs"),
        Line2D([], [], color="k", lw=0.8, ls=":", label="exact optimum, mean of folds"),
        Patch(color="0.85", lw=0, label="exact optimum, range of folds"),
    ]
