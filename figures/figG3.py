"""Figure G3: a pause that a cancel must follow, and signals to the arkypallidal cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bgmodel.support.files import read_table
from figures.common import Settings, bars, letter, run, say_if_older

COLOURS = {"STN": "C0", "Arky": "C1", "both": "C3", "cancel": "C2", "no signal": "0.4"}
"""Colours of the signals, by what they involve."""


def draw(settings: Settings, pauses: Path, signals: Path, *, output: Path) -> Figure:
    """Draw p(respond) over the pause and the time of the cancel, and of other signals."""
    table, arky = read_table(pauses), read_table(signals)
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.3), width_ratios=[1.15, 1])
    image = _map(left, table[table["cancel_ms"] > 0])
    figure.colorbar(image, ax=left, label="share of stop trials answered", pad=0.02)
    letter(left, "a  a pause by STN, then a cancel")
    _signals(right, arky)
    letter(right, "b  signals to STN and Arky")
    say_if_older(figure, pauses, signals)
    return figure


def _map(ax: Axes, table: pd.DataFrame) -> Any:
    """Show the share with a response, in per cent, for each pause and cancel."""
    wide = table.pivot(index="cancel_ms", columns="pause_ms", values="p_respond")
    image = ax.imshow(wide.to_numpy(), origin="lower", aspect="auto", vmin=0.15, vmax=0.75)
    for (row, column), p in np.ndenumerate(wide.to_numpy()):
        ax.text(column, row, f"{100 * p:.0f}", ha="center", va="center", fontsize=6,
                color="k" if p > 0.5 else "w")  # fmt: skip
    columns = list(wide.columns)
    for row, cancel in enumerate(wide.index):
        if cancel in columns:
            corner = (columns.index(cancel) - 0.5, row - 0.5)
            ax.add_patch(Rectangle(corner, 1, 1, fill=False, ec="w", lw=0.8))
    ax.set_xticks(range(0, len(wide.columns), 2), [f"{each:g}" for each in wide.columns[::2]])
    ax.set_yticks(range(len(wide)), [f"{each:g}" for each in wide.index])
    ax.set(xlabel="pause: duration of the input to STN (ms)", ylabel="cancel after the signal (ms)")
    return image


def kind(signal: str) -> str:
    """Return which colour a signal has."""
    if signal.startswith("no signal"):
        return "no signal"
    if "cancel" in signal:
        return "cancel"
    return "both" if {"STN", "Arky"} <= set(signal.split()) else signal.split()[0]


def _signals(ax: Axes, table: pd.DataFrame) -> None:
    """Show the share with a response for each signal."""
    place = -np.arange(len(table))
    for at, (_, row) in zip(place, table.iterrows(), strict=True):
        one = row.to_frame().T
        bars(ax, [at], one, "p_respond", across=True, fmt="o", ms=4, lw=1,
             color=COLOURS[kind(row["signal"])])  # fmt: skip
    held = table.loc[table["signal"] == "STN held", "p_respond"].item()
    ax.axvline(held, color="0.6", lw=0.8, ls=":", zorder=0)
    labels = [name.replace(", without Arky", ",\nwithout these cells") for name in table["signal"]]
    labels = [name.replace("ms, Arky", "ms,\nArky").replace("ms, cancel", "ms,\ncancel")
              for name in labels]  # fmt: skip
    ax.set_yticks(place, labels, fontsize=7)
    ax.set(xlim=(0, 1.04), xlabel="share of stop trials answered")


if __name__ == "__main__":
    run(draw=draw)
