"""Figure B1: decision times by number of alternatives, with the published ones (B&G, 3A)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, key, letter, run, say_if_older, where

TESTS = {
    "MSPRT": ("MSPRT", "C0", "o"),
    "MSPRTb": ("MSPRTb, max vs next", "C4", "v"),
    "linear GPe, gain 0.4, a 0.84": ("linear GPe, gain 0.4, a = 0.84", "C2", "s"),
    "linear GPe": ("linear GPe, a = 1", "C5", "D"),
    "UM": ("UM, leaky and competing", "C1", "^"),
    "race": ("race", "C3", "P"),
}
"""Label, colour and marker of each test of the score."""


def draw(settings: Settings, times: Path, *, output: Path) -> Figure:
    """Draw mean times by alternatives, and the extra time of each test over the MSPRT."""
    table = read_table(times)
    figure, axes = plt.subplots(1, 2, figsize=(7.4, 3.4))
    for name, (label, colour, mark) in TESTS.items():
        rows = where(table, model=name).sort_values("alternatives")
        style: dict[str, Any] = {"color": colour, "marker": mark, "ms": 3.5, "lw": 1}
        bars(axes[0], rows["alternatives"], rows, "time_ms", label=label, **style)
        if name != "MSPRT":
            bars(axes[1], rows["alternatives"], rows, "longer_ms", **style)
        printed = rows.dropna(subset=["printed_ms"])
        axes[0].plot(
            1.06 * printed["alternatives"], printed["printed_ms"], marker="_", ms=12, mew=1.6,
            ls="", color=colour,
        )  # fmt: skip
    axes[0].plot([], [], marker="_", ms=12, mew=1.6, ls="", color="0.3", label="published, N = 10")
    axes[1].axhline(0, color="0.6", lw=0.8)
    axes[0].set_ylabel("mean time at 1 % errors (ms)")
    axes[1].set_ylabel("longer than the MSPRT (ms)")
    for ax in axes:
        ax.set_xscale("log")
        ax.set_xticks(table["alternatives"].unique(), minor=True)
        ax.set_xticks([2, 3, 4, 6, 10, 20], ["2", "3", "4", "6", "10", "20"])
        ax.set_xticklabels([], minor=True)
        ax.set_xlabel("alternatives N (logarithmic)")
    letter(axes[0], "a  decision time")
    letter(axes[1], "b  cost of other tests")
    key(figure, axes[0], ncols=4)
    say_if_older(figure, times)
    return figure


if __name__ == "__main__":
    run(draw=draw)
