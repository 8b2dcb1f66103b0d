"""Figure 4b: speed-accuracy trade-off for single gratings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from bgmodel.learning.reinforce import smoothed
from bgmodel.plots import accuracy_axis
from bgmodel.support.files import read_table
from figures.common import COLOUR, Settings, letter

# From 3 mm on, one reading decides and the curve is a point.
SHOWN_MM = (0.0, 1.0, 1.5, 2.0, 2.5)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw simulated curves (mean of six folds, smoothed over 10 gaps) and the exact ones."""
    table = read_table(data)
    figure, ax = plt.subplots(figsize=(4.4, 2.8))
    for period in SHOWN_MM:
        here = table[table["period_mm"] == period]
        mean = here.groupby("boundary_separation").mean(numeric_only=True)
        colour = COLOUR.get(period, "0.5" if period else "0.75")
        window = min(10, max(1, len(mean) // 8))
        time, accuracy = (smoothed(mean[n].to_numpy(), window) for n in ("mean_steps", "accuracy"))
        style: dict[str, Any] = {"color": colour, "label": f"{period:g} mm" if period else "smooth"}
        # The curves of two gratings with forced ties coincide: dashes keep the lower one visible.
        ax.plot(time, accuracy, "--" if period == 1.0 else "-", **style)
        ax.plot(mean["exact_mean_steps"], mean["exact_accuracy"], ":", color=colour, lw=0.9)
    ax.set_xlabel("mean decision time (readings)")
    accuracy_axis(ax)
    ax.plot([], [], "k:", lw=0.9, label="exact")
    ax.plot([], [], color="0.8", lw=0.8, label="chance")
    ax.set_ylim(0.4, 1.02)
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    letter(ax, "speed against accuracy, gaps of 0 to 8 nats")
    return figure
