"""Figure N1: which of N orientations?  The MSPRT on the double-angle head, N = 2 to 8."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import Msprt, stream, tally
from bgmodel.files import read_table, write_table
from bgmodel.plots import speed_accuracy
from bgmodel.tactile.task import FOLDS, Orientations, source
from figures.common import Settings, letter, run

SHOWN_MM = (1.5, 2.0, 2.5)
POSTERIORS = np.concatenate([np.linspace(0.15, 0.9, 16), [0.93, 0.95, 0.97, 0.98, 0.99]])


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Run the test at many criteria for every N and grating, on six folds."""
    table = read_table(taps)
    rows = []
    for period in SHOWN_MM:
        for count in range(2, 9):
            for fold in range(FOLDS):
                readings = source(table, Orientations(count), period_mm=period, fold=fold)
                rng = stream(settings.seed, "figN1", period, count, fold)
                evidence = readings.draw(settings.sweep_trials // 6, settings.t_max, rng=rng)
                counts = tally(Msprt().run(evidence), evidence.truth, -np.log(POSTERIORS))
                rows.append(
                    pd.DataFrame(
                        {
                            "period_mm": period,
                            "orientations": count,
                            "fold": fold,
                            "posterior": POSTERIORS,
                            "trials": counts.trials,
                            "accuracy": counts.accuracy,
                            "mean_steps": counts.mean_steps,
                        }
                    )
                )
    write_table(pd.concat(rows), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw accuracy against mean readings, a line an N."""
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.4), sharey=True)
    for ax, period in zip(axes, SHOWN_MM, strict=True):
        for count in range(2, 9):
            here = table[(table["period_mm"] == period) & (table["orientations"] == count)]
            mean = here.groupby("posterior")[["mean_steps", "accuracy"]].mean()
            # Where the prior alone is enough, no reading is taken: not shown.
            mean = mean[mean["mean_steps"] > 0]
            colour = plt.get_cmap("viridis")((count - 2) / 7)
            style = {"color": colour, "label": f"N = {count}", "lw": 1.2, "marker": ".", "ms": 3}
            speed_accuracy(ax, mean["mean_steps"], mean["accuracy"], None, **style)
        letter(ax, f"{period:g} mm")
    for ax in axes[1:]:
        ax.set_ylabel("")
    axes[-1].legend(ncols=2, loc="lower right")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
