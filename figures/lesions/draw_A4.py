"""Figure A4: loss of STN, acute, recovered, and with a rebound of SNr; drawn from the score."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, key, letter, say_if_older, where

CONFLICT = 0.9
INTACT, ACUTE, RECOVERED = "intact", "acute", "recovered"
COLOUR = {0.0: "C0", CONFLICT: "C1"}
RAMPS = {3.0: "C2", 5.0: "C3"}
CHANGES = (
    ("mean_ms", 1000, "change of mean time (s)"),
    ("accuracy", 1, "change of accuracy"),
)
"""A measure, its divisor, and its axis label."""
CAVANAGH: dict[str, Any] = {
    "mean_ms": {0.0: (-74, 57), CONFLICT: (-126, 71)},
    "accuracy": {0.0: (-0.034, 0.038), CONFLICT: (-0.013, 0.041)},
}
"""Stimulation of STN on minus off, mean and standard error over 14 people.

Computed from the trials of Cavanagh et al. 2011 (conflict: two good or two bad items).
"""
T_OF_14 = 2.16
"""Half a 95 % interval of 14 people, in standard errors."""
AT_NATS = 0.93
"""Position of the human data, to the right of all rebounds."""
SHOWN, SLOW = "d' 0.5, N = 4", ("d' 0.5, N = 2", "d' 0.5, N = 4")
"""Evidence of panels c and d, and of panel e."""


def draw(settings: Settings, behaved: Path, ahead: Path, *, output: Path) -> Figure:
    """Draw time and accuracy against the rebound and the fraction lost, and early responses."""
    behaviour, anticipation = read_table(behaved), read_table(ahead)
    tasks = list(behaviour["evidence"].unique())
    figure = plt.figure(figsize=(7.4, 6.6))
    grids = figure.add_gridspec(2, 1, height_ratios=[1.9, 1])
    grid: Any = grids[0].subgridspec(2, len(tasks)).subplots(sharex=True, sharey="row")
    for column, task in zip(grid.T, tasks, strict=True):
        rows = where(behaviour, evidence=task)
        for ax, (measure, unit, _) in zip(column, CHANGES, strict=True):
            _against_rebound(ax, rows, measure, unit)
            ax.axvline(tuned_rebound(rows), color="0.6", lw=0.8, ls=":", zorder=0)
        column[0].set_title(task, loc="right", fontweight="normal")
    for ax, (measure, unit, _) in zip(grid[:, 0], CHANGES, strict=True):
        _people(ax, measure, unit)
    for row, name, (*_, label) in zip(grid, ("a  ", "b  "), CHANGES, strict=True):
        row[0].set_ylabel(label)
        letter(row[0], name)
    grid[1, 1].set_xlabel("rebound of SNr after loss of all of STN (nats)")
    lower: Any = grids[1].subgridspec(1, 3).subplots()
    rows = where(behaviour, evidence=SHOWN)
    for ax, (measure, unit, label) in zip(lower, CHANGES, strict=False):
        _by_loss(ax, rows, measure, unit)
        ax.set(ylabel=label, xlabel="fraction of STN lost (%)")
    letter(lower[0], f"c  time, {SHOWN}")
    letter(lower[1], f"d  accuracy, {SHOWN}")
    _early(lower[2], anticipation)
    key(figure, grid[0, 0], *lower[::2], ncols=3, columnspacing=1.5)
    letter(lower[2], "e  before the onset")
    say_if_older(figure, behaved, ahead)
    return figure


def tuned_rebound(rows: pd.DataFrame) -> float:
    """Return the rebound after complete loss that was found on tuning seeds, nats.

    After a partial loss, the score uses the same fraction of this rebound.
    """
    part = rows[(rows["lost"] == 0.5) & (rows["rebound_nats"] > 0)]
    return float((part["rebound_nats"] / part["lost"]).iloc[0])


def _against_rebound(ax: Any, rows: pd.DataFrame, measure: str, unit: float) -> None:
    """Show the change after loss of all of STN and recovery, by conflict."""
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    rows = where(rows, lost=1, state=RECOVERED).sort_values("rebound_nats")
    for conflict, colour in COLOUR.items():
        part, name = where(rows, conflict=conflict), f"{measure}_change"
        label = "with conflict" if conflict else "without conflict"
        style: dict[str, Any] = {"fmt": "o-", "ms": 3, "lw": 1, "color": colour, "label": label}
        bars(ax, part["rebound_nats"], part, name, unit=unit, **style)


def _people(ax: Any, measure: str, unit: float) -> None:
    """Show the effect of STN stimulation on people, next to the curves."""
    for conflict, (mean, error) in CAVANAGH[measure].items():
        x, off = AT_NATS + (0.03 if conflict else -0.03), T_OF_14 * error / unit
        ax.errorbar(x, mean / unit, off, fmt="D", ms=4, mfc="w", lw=1, color=COLOUR[conflict])
    ax.plot([], [], "D", ms=4, mfc="w", color="0.4", label="people, STN stimulated")


def _by_loss(ax: Any, rows: pd.DataFrame, measure: str, unit: float) -> None:
    """Show the change by fraction lost: acute, recovered, and with a proportional rebound."""
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    name, parts = f"{measure}_change", sorted(set(rows["lost"]) - {0.0})
    for i, lost in enumerate(parts):
        rebound = round(lost * tuned_rebound(rows), 2)
        states = (
            (ACUTE, 0.0, "s", "acute"),
            (RECOVERED, 0.0, "o", "recovered"),
            (RECOVERED, rebound, "^", "recovered, with a rebound"),
        )
        for k, (state, nats, mark, label) in enumerate(states):
            for conflict, colour in COLOUR.items():
                at = where(rows, lost=lost, state=state, conflict=conflict)
                at = at[np.isclose(at["rebound_nats"], nats)]
                x = i + 0.25 * (k - 1) + (0.05 if conflict else -0.05)
                style: dict[str, Any] = {"fmt": mark, "ms": 3.5, "lw": 0.8, "color": colour}
                fill = "w" if state == ACUTE else colour
                bars(ax, [x], at, name, unit=unit, mfc=fill, **style)
            if not i:
                fill = "w" if state == ACUTE else "0.4"
                ax.plot([], [], mark, color="0.4", mfc=fill, ms=3.5, label=label)
    ax.set_xticks(range(len(parts)), [f"{100 * lost:g}" for lost in parts])


def _early(ax: Any, table: pd.DataFrame) -> None:
    """Show the share of responses before the onset against the rebound."""
    for task, line in zip(SLOW, ("-", "--"), strict=True):
        for most, colour in RAMPS.items():
            total = where(table, evidence=task, most_nats=most, lost=1).sort_values("rebound_nats")
            label = f"e: {task.split(', ')[1]}, up to {most:g} nats"
            fill = colour if line == "-" else "w"
            style: dict[str, Any] = {"fmt": "o", "ls": line, "color": colour, "mfc": fill}
            bars(ax, total["rebound_nats"], total, "anticipatory", ms=3, lw=1, label=label, **style)
    partly = table[(table["lost"] < 1) & (table["state"] != INTACT)]["anticipatory"].max()
    intact = table[table["state"] == INTACT]["anticipatory"].max()
    # One line for all of them, at the highest.
    level = max(partly, intact)
    ax.axhline(level, color="0.6", lw=0.8, zorder=0, label="e: maximum of intact and partial loss")
    ax.set(xlabel="rebound of SNr (nats)", ylabel="share of responses", ylim=(-0.03, 1.03))
    ax.set_yticks(np.arange(0, 1.1, 0.25))
