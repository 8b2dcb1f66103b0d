"""Figure 5c: how the optimal gap and its cost depend on xi, which the paper does not give."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bgmodel.deciding.reward import reward_of
from bgmodel.integrators.sprt_theory import sprt
from bgmodel.learning.gap import fold_sources, increments
from bgmodel.support.files import read_table, write_table
from figures.common import COLOUR, Settings, key, letter


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Find the exact optimum of every fold at many costs of an error."""
    table = read_table(taps)
    gaps = np.linspace(0, 8, 2 * len(settings.separations) - 1)
    rows = []
    for period in COLOUR:
        for fold, readings in enumerate(fold_sources(table, period)):
            test = sprt(*increments(readings), gaps, t_max=settings.t_max)
            for xi in np.geomspace(5, 500, 25):
                costs = -reward_of(test.error_rate, test.mean_steps, xi)
                best = int(np.argmin(costs))
                row = {
                    "period_mm": period,
                    "fold": fold,
                    "xi": xi,
                    "optimal_separation": gaps[best],
                }
                row |= {"cost": costs[best], "accuracy": 1 - test.error_rate[best]}
                rows.append(row | {"mean_steps": test.mean_steps[best]})
    write_table(pd.DataFrame(rows), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the optimum against xi: mean and range of the six folds."""
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.5))
    names = {
        "optimal_separation": ("optimal gap", "gap δ (nats)"),
        "accuracy": ("accuracy at the optimum", "proportion correct"),
        "mean_steps": ("decision time at the optimum", "mean readings"),
    }
    for ax, (name, (title, label)) in zip(axes, names.items(), strict=True):
        for period, colour in COLOUR.items():
            here = table[table["period_mm"] == period].groupby("xi")[name]
            ax.plot(here.mean(), color=colour, label=f"{period:g} mm, mean of folds")
            low, high = here.min(), here.max()
            ax.fill_between(low.index, low, high, color=colour, alpha=0.15, lw=0)
        ax.axvline(
            settings.xi, color="0.7", lw=0.8, label=f"ξ = {settings.xi:g}, as in figures 5a, b"
        )
        ax.set(xscale="log", xlabel="cost of an error ξ (readings)", ylabel=label)
        letter(ax, title)
    shade = Patch(color="0.5", alpha=0.15, lw=0, label="range of folds")
    key(figure, axes[0], more=[shade], ncols=5, columnspacing=1.4)
    return figure
