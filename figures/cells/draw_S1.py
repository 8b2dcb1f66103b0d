"""Figure S1: held-out spikes of recorded cells under models and regressions, and gains."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, letter, where

LOOKS = {"recorded": ("C0", "o"), "shuffled": ("0.6", "s")}


def draw(
    settings: Settings, models: Path, regressions: Path, each: Path, gains: Path, *, output: Path
) -> Figure:
    """Draw nats by model, nats of each cell beside those of the regression, and gains."""
    figure, axes = plt.subplots(1, 3, figsize=(7.4, 2.6))
    fitted = read_table(models)
    described = read_table(regressions)
    described = described[described["past"] & (described["model"] != "psth")]
    names = [*described["model"], *fitted["model"]]
    nats = [*described["over_recent"], *fitted["apart"]]
    at = np.arange(len(names))
    axes[0].barh(at, nats, color=["0.7"] * len(described) + ["C0"] * len(fitted))
    axes[0].plot(fitted["together"], at[len(described) :], "k|", ms=9, mew=2)
    axes[0].set_yticks(at, names)
    axes[0].invert_yaxis()
    axes[0].set(xlabel="held-out nats over course and recent rate")
    letter(axes[0], "a  models")
    table = read_table(each).pivot(index="cell", columns="model", values="nats")
    axes[1].plot(table["clicks and choice"], table["exponential"], "o", ms=3, color="C0")
    ends = [table.min().min(), table.max().max()]
    axes[1].plot(ends, ends, color="0.7", lw=0.8, zorder=0)
    axes[1].set(xlabel="regression on clicks and choice (nats)", ylabel="one noisy sum (nats)")
    letter(axes[1], "b  cells")
    found = read_table(gains)
    order = where(found, spikes="recorded").sort_values("gain")["cell"].tolist()
    for name, (color, marker) in LOOKS.items():
        rows = where(found, spikes=name).set_index("cell").loc[order]
        axes[2].errorbar(
            np.arange(len(rows)), rows["gain"], 2 * rows["error"], color=color, fmt=marker, ms=2.5,
            lw=0.7, label=name,
        )  # fmt: skip
    axes[2].axhline(0, color="0.8", lw=0.8, zorder=0)
    axes[2].set(xlabel="cell", ylabel="gain per click (log rate)")
    axes[2].legend(frameon=False, fontsize=7)
    letter(axes[2], "c  gains by clicks")
    return figure
