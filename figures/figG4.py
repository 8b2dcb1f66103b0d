"""Figure G4: the built-in experiments with stop signals: published results and the circuit's.

Predictions are in the experiments' files and were committed before the first run; the results are
those of a score.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bgmodel.experiments.predictions import AGREES, DISAGREES, OPEN
from bgmodel.support.files import read_table
from figures.common import Settings, run, say_if_older, where

COLOUR = {AGREES: "C2", DISAGREES: "C1", OPEN: "0.45"}
PANELS = {
    "mean_ms": ("change of mean go time, ms", (-190.0, 190.0)),
    "p_respond": ("change of share of failed stops", (-0.27, 0.27)),
    "ssrt_ms": ("change of SSRT, ms", (-42.0, 42.0)),
}
"""Measures, and their axis limits."""
SIZE = 7.0


def draw(settings: Settings, measures: Path, *, output: Path) -> Figure:
    """Draw a row per experiment: the change of three measures, and what was predicted."""
    table = read_table(measures)
    names = list(table["name"].unique())
    figure, axes = plt.subplots(1, 3, sharey=True, figsize=(8.2, 0.5 * len(names) + 1.0))
    for ax, (measure, (label, ends)) in zip(axes, PANELS.items(), strict=True):
        ax.axvline(0, lw=0.5, color="0.6", zorder=0)
        for row in where(table, condition="change", measure=measure).to_dict("records"):
            k = names.index(row["name"])
            colour = COLOUR.get(row["outcome"], "k")
            _predicted(ax, k, row["direction"], row["at_least"], ends)
            around = [[row["value"] - row["low"]], [row["high"] - row["value"]]]
            ax.errorbar(row["value"], k, xerr=around, fmt="o", ms=4, capsize=2, color=colour)
        ax.set(xlim=ends, ylim=(len(names) - 0.5, -0.5), yticks=[])
        ax.set_xlabel(label, fontsize=SIZE + 1)
        ax.tick_params(labelsize=SIZE)
    for k, name in enumerate(names):
        about = table[table["name"] == name].iloc[0]
        source = about["source"].rsplit(", ", 1)[0].removeprefix("derived from ")
        at = {"transform": axes[0].get_yaxis_transform(), "ha": "right", "va": "center"}
        axes[0].text(-0.03, k - 0.15, name.removesuffix(", stop signals"), fontsize=SIZE, **at)
        axes[0].text(-0.03, k + 0.2, source, fontsize=SIZE, color="0.4", **at)
    _key(figure)
    say_if_older(figure, measures)
    return figure


def _predicted(
    ax: Axes, k: int, direction: str, at_least: float, ends: tuple[float, float]
) -> None:
    """Shade the changes that would agree with a prediction, if there is one."""
    span = {
        "up": (at_least, ends[1]),
        "down": (ends[0], -at_least),
        "none": (-at_least, at_least),
    }.get(direction)
    if span is None:
        return
    ax.fill_betweenx(np.array([k - 0.36, k + 0.36]), *span, color="0.88", lw=0, zorder=-1)


def _key(figure: Figure) -> None:
    """Draw the key below the panels."""
    marks = [Patch(color="0.88", label="predicted from the source")] + [
        Line2D([], [], marker="o", ms=4, color=colour, label=label)
        for colour, label in (
            (COLOUR[AGREES], "agrees"),
            (COLOUR[DISAGREES], "disagrees"),
            (COLOUR[OPEN], OPEN),
            ("k", "no prediction"),
        )
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=5, fontsize=SIZE, frameon=False)


if __name__ == "__main__":
    run(draw=draw)
