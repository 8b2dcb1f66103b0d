"""Figure 5a: the gap acquired by REINFORCE with baseline, and how it converges."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.files import read_table, write_table
from bgmodel.learning.gap import learn_folds
from bgmodel.plots import acquisition
from figures.common import COLOUR, Settings, letter, run

STARTS = (0.5, 7.5)
KEPT = 250


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Learn on six folds, several repeats each, from a narrow and from a wide gap."""
    from bgmodel.learning.reinforce import Learner

    table = read_table(taps)
    learner = Learner(episodes=settings.episodes)
    parts = [
        learn_folds(
            table,
            period,
            xi=settings.xi,
            start_delta=start,
            repeats=settings.repeats,
            t_max=settings.t_max,
            seed=settings.seed,
            learner=learner,
            keep=KEPT,
        )
        for period in COLOUR
        for start in STARTS
    ]
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings, learner=learner)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw a panel a grating: both starts, median and 10-90 % of all runs, exact optimum."""
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.5), sharey=True)
    for ax, period in zip(axes, COLOUR, strict=True):
        here = table[table["period_mm"] == period]
        for start, style in zip(STARTS, ("-", "--"), strict=True):
            some = here[here["start_delta"] == start]
            runs = some.pivot(index=["fold", "repeat"], columns="episode", values="smoothed_delta")
            acquisition(ax, runs, color=COLOUR[period], ls=style)
        best = here.groupby("fold")["optimal_delta"].first()
        ax.axhspan(best.min(), best.max(), color="0.85", lw=0, zorder=0)
        ax.axhline(best.mean(), color="k", lw=0.8, ls=":")
        inset = ax.inset_axes([0.55, 0.55 if period == 1.5 else 0.22, 0.4, 0.2])
        final = here.groupby(["start_delta", "fold", "repeat"])["regret"].first() * 100
        bins = np.linspace(-1, max(6, np.ceil(final.max())), 22)
        for start, fill in zip(STARTS, (True, False), strict=True):
            kind = "stepfilled" if fill else "step"
            inset.hist(final[start], bins, histtype=kind, color=COLOUR[period], lw=0.8)
        inset.axvline(2, color="k", lw=0.6, ls=":")
        inset.set(yticks=[], xlabel="final regret (%)")
        inset.xaxis.label.set_size(6)
        inset.tick_params(labelsize=6)
        letter(ax, f"{period:g} mm")
        ax.set(xlabel="trial", ylim=(0, 8))
    axes[0].set_ylabel("gap δ (nats)")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
