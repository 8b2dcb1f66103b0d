"""Figure 4a: psychometric curves of the sequential test improve with its gap."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import t

from bgmodel.files import read_table
from bgmodel.plots import accuracy_axis
from figures.common import Settings, run

GAPS = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw one curve a gap, bolder for a wider one."""
    table = read_table(data)
    figure, ax = plt.subplots(figsize=(3.6, 2.8))
    for i, gap in enumerate(GAPS):
        here = table[np.isclose(table["delta"], gap)]
        folds = here.pivot(index="period_mm", columns="fold", values="accuracy")
        # Trials are many, taps are few: the interval is that of six folds of taps.
        half = t.ppf(0.975, folds.shape[1] - 1) * folds.sem(axis=1)
        style = {"color": plt.get_cmap("viridis")(0.85 * i / (len(GAPS) - 1)), "capsize": 2}
        ax.errorbar(
            folds.index, folds.mean(axis=1), half, lw=0.7 + 0.45 * i, label=f"{gap:g}", **style
        )
    accuracy_axis(ax)
    ax.set(xlabel="grating period (mm)", ylim=(0.4, 1.02))
    ax.legend(title="gap δ (nats)", loc="lower right")
    return figure


if __name__ == "__main__":
    run(draw=draw)
