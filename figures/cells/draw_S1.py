"""Figure S1: rates of recorded cells by clicks and choice, held-out nats of models, and gains."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, letter, where

LOOKS = {"recorded": ("C0", "o"), "shuffled": ("0.6", "s")}
CLICKS = {-1: ("C3", "few"), 0: ("0.4", "middle"), 1: ("C0", "many")}
CHOICES = {1: "-", 0: ":"}


def draw(
    settings: Settings, models: Path, regressions: Path, gains: Path, courses: Path, *, output: Path
) -> Figure:
    """Draw courses of recorded and expected rates, nats by model, and gains."""
    figure, axes = plt.subplots(1, 3, figsize=(7.4, 2.8))
    table = read_table(courses)
    for clicks, (color, label) in CLICKS.items():
        for choice, style in CHOICES.items():
            rows = where(table, clicks=clicks, choice=choice)
            axes[0].plot(rows["time_s"], rows["model"], style, color=color, lw=1,
                         label=label if choice else None)  # fmt: skip
            axes[0].errorbar(
                rows["time_s"], rows["recorded"], rows["error"], fmt="o", ms=2.5, lw=0.6,
                color=color, mfc=color if choice else "w",
            )  # fmt: skip
    axes[0].set(
        xlabel="time from onset (s)", ylabel="rate / mean rate of the cell", ylim=(0.2, 1.6)
    )
    axes[0].legend(
        frameon=False,
        loc="lower left",
        fontsize=7,
        title="clicks, preferred side",
        title_fontsize=7,
    )
    letter(axes[0], "a  clicks and choice")
    fitted = read_table(models).dropna(subset=["nats"])
    fitted = fitted[fitted["model"] != "no recent rate"]
    described = where(read_table(regressions), past=True)
    described = described[described["model"] != "psth"]
    names = [*described["model"], *fitted["model"]]
    at = np.arange(len(names))
    colors = ["0.7"] * len(described) + ["C0"] * len(fitted)
    axes[1].barh(at, [*described["nats"], *fitted["nats"]], color=colors)
    axes[1].plot(fitted["together"], at[len(described) :], "k|", ms=9, mew=2)
    axes[1].set_yticks(at, names)
    axes[1].invert_yaxis()
    axes[1].set(xlabel="held-out nats")
    letter(axes[1], "b  models")
    by_cell = read_table(gains)
    by_cell = by_cell[by_cell["shuffle"] <= 1]
    order = where(by_cell, spikes="recorded").sort_values("gain")["cell"].tolist()
    for name, (color, marker) in LOOKS.items():
        rows = where(by_cell, spikes=name).set_index("cell").loc[order]
        axes[2].errorbar(
            np.arange(len(rows)), rows["gain"], 2 * rows["error"], color=color, fmt=marker, ms=2.5,
            lw=0.7, label=name,
        )  # fmt: skip
    axes[2].axhline(0, color="0.8", lw=0.8, zorder=0)
    axes[2].set(xlabel="cell", ylabel="gain per click (log rate)")
    axes[2].legend(frameon=False, fontsize=7, loc="lower right")
    letter(axes[2], "c  gains by clicks")
    return figure
