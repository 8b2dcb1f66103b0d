"""Figure B5: published circuits under one protocol: which test each follows, effects of edits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from bgmodel.comparison.designed import CLOSE_MS
from bgmodel.support.files import read_table
from figures.common import Settings, bars, letter, say_if_older

NAMES = {
    "bogacz_gurney": "Bogacz & Gurney 2007",
    "macaque": "macaque, the default",
    "spiking_msprt": "spiking_msprt",
    "gpr": "Gurney et al. 2001",
    "humphries": "Humphries et al. 2006",
    "stewart": "Stewart et al. 2010",
}
"""Label of each circuit."""
THEORIES = {"MSPRT": ("C0", "o"), "max vs average": ("C1", "s"), "max vs next": ("C2", "^")}
EDITS = {
    "conflict": ("conflict", "stn_percent"),
    "a tenth of STN lost": ("STN −10 %", "accuracy"),
    "a tenth of STN lost, conflict": ("STN −10 %,\nconflict", "mean_percent"),
    "a fifth of GPe lost": ("GPe −20 %", "mean_percent"),
    "dopamine 1.15": ("dopamine\n+15 %", "mean_percent"),
    "dopamine 0.85": ("dopamine\n−15 %", "mean_percent"),
}
"""Label of each edit, and the measure expected to change."""
MEASURED = {"stn_percent": "rate of STN", "accuracy": "share correct", "mean_percent": "mean time"}
COLOURS = {
    "as expected": "#bfe3c0",
    "not as expected": "#f3c1b5",
    "left open": "#e6e6e6",
    "does not decide": "#f7e3a8",
    "decides without evidence": "#d9d3ee",
    "nothing to change": "white",
}
"""Colour of each outcome."""


def draw(
    settings: Settings, decisions: Path, computes: Path, changes: Path, *, output: Path
) -> Figure:
    """Draw distances from each test, agreement with the MSPRT, and effects of edits."""
    compared = read_table(decisions)
    names = [name for name in NAMES if name in set(compared["circuit"])]
    figure = plt.figure(figsize=(7.4, 2.7 + 0.55 * len(names)))
    above, below = figure.subfigures(
        2, 1, height_ratios=(2.2, 0.5 * len(names) + 1.2), squeeze=False
    )[:, 0]
    left, right = above.subplots(1, 2, sharey=True)
    _theories(left, read_table(computes), names)
    _beside(right, compared, names)
    left.set_yticks(range(len(names)), [NAMES[name] for name in names])
    left.set_ylim(len(names) - 0.5, -0.5)
    letter(left, "a  which test it follows, four alternatives")
    letter(right, "b  same choice as the MSPRT")
    ax = below.subplots()
    _edits(ax, read_table(changes), names)
    letter(ax, "c  effects of edits, compared with expectations")
    say_if_older(figure, decisions)
    return figure


def _theories(ax: Any, table: pd.DataFrame, names: list[str]) -> None:
    """Show the largest difference of each circuit from each test on designed trials."""
    row: Any
    for row in table.itertuples():
        if row.circuit in names:
            colour, mark = THEORIES[row.theory]
            face = colour if row.outcome == "follows" else "none"
            ax.plot(
                max(row.largest_ms, 1), names.index(row.circuit), marker=mark, color=colour,
                mfc=face, ls="", ms=5.5,
            )  # fmt: skip
    for theory, (colour, mark) in THEORIES.items():
        ax.plot([], [], marker=mark, color=colour, mfc="none", ls="", label=theory)
    ax.axvline(CLOSE_MS, color="0.6", lw=0.8, ls=":")
    ax.set(xscale="log", xlabel="largest difference from the theory (ms)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.33), ncols=3, columnspacing=1)


def _beside(ax: Any, table: pd.DataFrame, names: list[str]) -> None:
    """Show the share of choices equal to the MSPRT's, its ceiling and chance."""
    for count, off, mark in ((2, -0.12, "o"), (4, 0.12, "s")):
        rows = table[(table["alternatives"] == count) & table["circuit"].isin(names)]
        y = np.array([names.index(name) for name in rows["circuit"]]) + off
        style: dict[str, Any] = {"color": "C0", "marker": mark, "ls": "", "ms": 4}
        bars(ax, y, rows, "agreement", across=True, label=f"N = {count}", **style)
        noisy = rows["agreement_ceiling"].where(rows["agreement_ceiling"] < 1)
        ax.plot(noisy, y, marker="|", color="0.4", ms=9, ls="")
        ax.plot(rows["agreement_chance"], y, marker="|", color="C3", ms=9, ls="")
    ax.plot([], [], marker="|", color="0.4", ms=9, ls="", label="other noise")
    ax.plot([], [], marker="|", color="C3", ms=9, ls="", label="chance")
    ax.set(xlabel="share of trials, accuracy 0.9")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.33), ncols=4, columnspacing=1)


def _edits(ax: Any, table: pd.DataFrame, names: list[str]) -> None:
    """Show one cell per circuit, edit and number of alternatives."""
    counts = sorted(table["alternatives"].unique())
    row: Any
    for row in table.itertuples():
        if row.circuit not in names:
            continue
        _, measure = EDITS[row.edit]
        x = len(counts) * list(EDITS).index(row.edit) + counts.index(row.alternatives)
        y = names.index(row.circuit)
        ax.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, color=COLOURS[row.outcome], lw=0))
        value = getattr(row, measure)
        text = {"nothing to change": "–", "does not decide": "never"}.get(
            row.outcome, _number(value, measure)
        )
        ax.text(x, y, text, ha="center", va="center", fontsize=6.5)
    ax.set_xlim(-0.55, len(counts) * len(EDITS) - 0.45)
    ax.set_ylim(len(names) - 0.5, -1.15)
    ax.set_yticks(range(len(names)), [NAMES[name] for name in names])
    middles = [len(counts) * k + (len(counts) - 1) / 2 for k in range(len(EDITS))]
    labels = [f"{label}\n{MEASURED[measure]}" for label, measure in EDITS.values()]
    ax.set_xticks(middles, labels, fontsize=7)
    for k in range(len(EDITS)):
        for i, count in enumerate(counts):
            ax.text(
                len(counts) * k + i, -0.8, f"N = {count}", ha="center", fontsize=6.5, color="0.3"
            )
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    shown = [label for label in COLOURS if label in set(table["outcome"])]
    ax.legend(
        handles=[Patch(facecolor=COLOURS[label], edgecolor="0.7", label=label) for label in shown],
        loc="upper center", bbox_to_anchor=(0.45, -0.22), ncols=len(shown), columnspacing=1,
    )  # fmt: skip


def _number(value: float, measure: str) -> str:
    """Return a change with its sign as short text."""
    if measure == "accuracy":
        return f"{value:+.2f}".replace("-", "−")
    text = f"{value:+.0f} %" if abs(value) >= 10 else f"{value:+.1f} %"
    return text.replace("-", "−")
