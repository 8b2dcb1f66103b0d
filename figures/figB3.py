"""Figure B3: the recursive MSPRT on interspike intervals of MT cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, key, letter, run, say_if_older, where

TESTS = {
    "MSPRT": ("MSPRT", "C0", "o", "-"),
    "rMSPRT": ("rMSPRT: the loop takes 3 readings, 3 are summed", "C1", "s", "--"),
    "rMSPRT, 2 readings": ("2 are summed", "C2", "v", "-"),
    "rMSPRT, 4 readings": ("4 are summed", "C3", "^", "-"),
}
"""Label, colour, marker and line of each test of the score."""


def draw(settings: Settings, readings: Path, *, output: Path) -> Figure:
    """Draw readings to a decision by coherence, and the excess over the MSPRT."""
    table = read_table(readings)
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 5.6), sharex=True)
    for column, alternatives in zip(axes.T, (2, 4), strict=True):
        rows = where(table, alternatives=alternatives).sort_values("coherence")
        for name, (label, colour, mark, line) in TESTS.items():
            some = where(rows, model=name)
            look: dict[str, Any] = {"color": colour, "marker": mark, "ls": line, "ms": 3.5, "lw": 1}
            bars(column[0], some["coherence"], some, "time_readings", label=label, **look)
            if name != "MSPRT":
                bars(column[1], some["coherence"], some, "longer_readings", **look)
        column[1].axhline(1, color="0.6", lw=0.8, ls=":")
        for ax in column:
            ax.set(xscale="log", yscale="log")
            coherences = rows["coherence"].unique()
            ax.set_xticks(coherences, [f"{100 * c:g}" for c in coherences])
            ax.minorticks_off()
        column[1].set_xlabel("coherence (%)")
    axes[0, 0].set_ylabel("readings at 1 % errors")
    axes[1, 0].set_ylabel("readings beyond the MSPRT")
    letter(axes[0, 0], "a  two directions")
    letter(axes[0, 1], "b  four directions")
    letter(axes[1, 0], "c  cost of the loop, two")
    letter(axes[1, 1], "d  cost of the loop, four")
    key(figure, axes[0, 0], ncols=2)
    say_if_older(figure, readings)
    return figure


if __name__ == "__main__":
    run(draw=draw)
