"""Figure 4a: psychometric curves of the sequential test improve with its gap."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import t

from bgmodel.plots import accuracy_axis
from bgmodel.support.files import read_table
from figures.common import Settings, letter

GAPS = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw one curve per gap, bolder for a wider one."""
    table = read_table(data)
    figure, ax = plt.subplots(figsize=(4.4, 2.8))
    for i, gap in enumerate(GAPS):
        here = table[np.isclose(table["boundary_separation"], gap)]
        folds = here.pivot(index="period_mm", columns="fold", values="accuracy")
        # There are many trials but few taps, so the interval is over six folds of taps.
        half = t.ppf(0.975, folds.shape[1] - 1) * folds.sem(axis=1)
        style: dict[str, Any] = {
            "color": plt.get_cmap("viridis")(0.85 * i / (len(GAPS) - 1)),
            "capsize": 2,
        }
        # Side by side, so that bars do not overlap.
        x = folds.index + 0.03 * (i - (len(GAPS) - 1) / 2)
        ax.errorbar(x, folds.mean(axis=1), half, lw=0.7 + 0.3 * i, label=f"{gap:g}", **style)
    accuracy_axis(ax)
    ax.plot([], [], color="0.8", lw=0.8, label="chance")
    _tied(ax, table)
    ax.set(xlabel="grating period (mm), 0: smooth", ylim=(0.4, 1.02))
    ax.legend(title="gap δ (nats)", loc="center left", bbox_to_anchor=(1, 0.5))
    letter(ax, "accuracy of the sequential test")
    return figure


def _tied(ax: Axes, table: pd.DataFrame) -> None:
    """Label gratings whose readings are uninformative in all folds: all responses are ties."""
    largest = table.groupby("period_mm")["shrink"].max()
    tied = largest.index[largest == 0]
    if len(tied):
        ax.text(tied.min(), 0.47, "forced ties", fontsize=7, va="top")
        ax.plot([tied.min(), tied.max()], [0.48, 0.48], color="k", lw=0.8)
