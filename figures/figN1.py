"""Figure N1: which of N orientations? The MSPRT on decoded orientations, N = 2 to 8."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import t

from bgmodel import Msprt, stream
from bgmodel.deciding.tally import tally
from bgmodel.plots import speed_accuracy
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import FOLDS, source
from bgmodel.tactile.task import Orientation
from figures.common import Settings, key, letter, run, where

SHOWN_MM = (1.5, 2.0, 2.5)
POSTERIORS = np.concatenate([np.linspace(0.15, 0.9, 16), [0.93, 0.95, 0.97, 0.98, 0.99]])


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Run the test at many criteria for every N and grating, on six folds."""
    table = read_table(taps)
    rows = []
    for period in SHOWN_MM:
        for count in range(2, 9):
            for fold in range(FOLDS):
                readings = source(table, Orientation(count, period_mm=period), fold=fold)
                rng = stream(settings.seed, "figN1", period, count, fold)
                evidence = readings.draw(settings.sweep_trials // 6, settings.t_max, rng=rng)
                trace = Msprt().run(evidence)
                # The lowest of these posteriors are below chance for few alternatives.
                counts = tally(trace, evidence.truth, -np.log(POSTERIORS), checked=False)
                row: dict[str, Any] = {"period_mm": period, "orientations": count, "fold": fold}
                row |= {"posterior": POSTERIORS, "trials": counts.trials}
                row |= {"accuracy": counts.accuracy, "mean_steps": counts.mean_steps}
                rows.append(pd.DataFrame(row))
    write_table(pd.concat(rows), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw accuracy against mean readings, one line per N, the last point with its interval."""
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.8), sharey=True)
    for ax, period in zip(axes, SHOWN_MM, strict=True):
        ends = []
        for count in range(2, 9):
            here = where(table, period_mm=period, orientations=count)
            folds = here.groupby("posterior")
            mean = folds[["mean_steps", "accuracy"]].mean()
            # Points at which the prior alone decides, without readings, are not shown.
            mean = mean[mean["mean_steps"] > 0]
            colour = plt.get_cmap("viridis")((count - 2) / 7)
            style = {"color": colour, "label": f"N = {count}", "lw": 1.2, "marker": ".", "ms": 3}
            speed_accuracy(ax, mean["mean_steps"], mean["accuracy"], None, **style)
            ax.axhline(1 / count, color=colour, lw=0.7, ls=":")
            # There are many trials but few taps, so the interval is over six folds of taps.
            half = t.ppf(0.975, FOLDS - 1) * folds["accuracy"].sem().iloc[-1]
            ends.append((mean["mean_steps"].iloc[-1], mean["accuracy"].iloc[-1], half, colour))
        _bars(ax, ends)
        ax.set_ylim(0, 1.04)
        letter(ax, f"{period:g} mm")
    for ax in axes[1:]:
        ax.set_ylabel("")
    chance = Line2D([], [], color="0.5", lw=0.7, ls=":", label="chance, 1/N")
    key(figure, axes[0], more=[chance], ncols=8, columnspacing=1.2)
    return figure


def _bars(ax: Axes, ends: list[tuple[float, float, float, Any]]) -> None:
    """Draw the intervals of the last points (steps, accuracy, half, colour).

    If several lines end at the same place, their bars are drawn side by side to the right.
    """
    width = max(steps for steps, *_ in ends)
    together = [end for end in ends if end[0] > 0.97 * width]
    for steps, accuracy, half, colour in ends:
        end = (steps, accuracy, half, colour)
        aside = len(together) > 1 and end in together
        x = width * (1.03 + 0.025 * together.index(end)) if aside else steps
        ax.errorbar(x, accuracy, half, color=colour, lw=0.9, capsize=1.5)


if __name__ == "__main__":
    run(compute=compute, draw=draw)
