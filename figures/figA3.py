"""Figure A3: residual effects of changed weights after homeostasis, and recovery of rates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.laws.homeostasis import recovery
from figures.common import Settings, bars, key, letter, run, say_if_older, where

CHANNELS = (2, 4)
UP, DOWN = " weight +20%", " weight -20%"
CHANGES = {DOWN: ("<", -0.24), UP: (">", 0.24)}
"""Marker of a change, and its vertical offset in the row."""
APART = 0.14
"""Vertical distance between the states of a changed circuit, in rows."""
RULES = {
    "acute": ("acute", "C1"),
    "biases": ("homeostasis", "C0"),
    "both": ("homeostasis and balance", "C2"),
}
"""States of a changed circuit by the table's column names, from the bottom of a row up."""
BEYOND = 0.075
"""Distance, left of all intervals, at which circuits that miss the accuracy are marked."""
TIME_STEP, SHOWN_UNTIL = 0.02, 6.0
"""Time step and end of the courses, in time constants of the rule."""
EDITS = ("STN->SNr weight x 0.8", "half of STN lost")
POPULATIONS = {"ctx": "C4", "D1": "C2", "D2": "C3", "STN": "C0", "GPe": "C1", "SNr": "k"}


def course(settings: Settings, *, output: Path) -> None:
    """Run the rule after two edits: rates relative to the table's resting rates."""
    table = load_circuit(DEFAULT)
    weight = table.projection("STN", "SNr").weight
    edited = (table.with_projection("STN", "SNr", weight=0.8 * weight), table.lesion("STN", 0.5))
    parts = []
    for name, edit in zip(EDITS, edited, strict=True):
        found = recovery(edit, table, step=TIME_STEP)
        parts.append(found.assign(edit=name, share=found["rate_hz"] / reference(found, table)))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def reference(course: pd.DataFrame, table: Any) -> pd.Series:
    """Return the resting rate of each row's population before the edit, Hz."""
    return course["population"].map(resting_hz(table))


def draw(settings: Settings, scored: Path, followed: Path, *, output: Path) -> Figure:
    """Draw the change of r for each weight, acute and recovered, and the courses of rates."""
    table, courses = read_table(scored), read_table(followed)
    weights = [name.removesuffix(UP) for name in table["variant"] if name.endswith(UP)]
    figure = plt.figure(figsize=(7.4, 6.4))
    grid = figure.add_gridspec(2, 3, width_ratios=[1.25, 1.25, 1])
    left = figure.add_subplot(grid[:, 0])
    middle = figure.add_subplot(grid[:, 1], sharex=left)
    lost = float(np.nanmin(table.filter(like="_low").to_numpy())) - BEYOND
    for ax, count in zip((left, middle), CHANNELS, strict=True):
        _weights(ax, table.set_index("variant"), count, weights, lost)
        ax.set_yticks(-np.arange(len(weights)), weights if ax is left else [])
    letter(left, "a  each weight, N = 2")
    letter(middle, "b  N = 4")
    right = [figure.add_subplot(grid[0, 2]), figure.add_subplot(grid[1, 2])]
    for ax, edit in zip(right, EDITS, strict=True):
        _course(ax, where(courses, edit=edit))
    letter(right[0], f"c  {EDITS[0]}")
    letter(right[1], f"d  {EDITS[1]}")
    right[1].set_xlabel("time (time constants)")
    right[0].legend(loc="center right", ncols=2, columnspacing=1, handlelength=1.4)
    key(figure, left, loc="outside lower left", ncols=5, columnspacing=1.2)
    say_if_older(figure, scored)
    return figure


def _weights(ax: Any, table: pd.DataFrame, count: int, weights: list[str], lost: float) -> None:
    """Show one row per weight: changes down and up, acute and recovered."""
    ax.axvline(0, color="0.8", lw=0.8, zorder=0)
    for k, (rules, (said, colour)) in enumerate(RULES.items()):
        fill = colour if k else "w"
        for change, (mark, above) in CHANGES.items():
            rows = table.loc[[name + change for name in weights]]
            y = above + APART * (k - 1) - np.arange(len(weights))
            style: dict[str, Any] = {"ms": 3, "color": colour, "mfc": fill}
            bars(ax, y, rows, f"{rules}_{count}", across=True, fmt=mark, lw=0.8, **style)
            missed = rows[f"{rules}_{count}"].isna().to_numpy()
            ax.plot(np.full(missed.sum(), lost), y[missed], mark, **style)
        ax.plot([], [], "o", ms=3.5, color=colour, mfc=fill, label=said)
    for mark, label in (("<", DOWN.strip()), (">", UP.strip())):
        ax.plot([], [], mark, ms=3.5, color="0.4", label=label)
    ax.axvline(lost + BEYOND / 2, color="0.6", lw=0.6, ls=":")
    ax.text(lost + BEYOND / 2 - 0.01, 0.62, "not\nreached", ha="right", fontsize=7)
    ax.set(xlabel="change of r of decision times", ylim=(0.5 - len(weights), 1.3))
    ax.set_xlim(left=lost - BEYOND)
    for k in range(1, len(weights), 2):
        ax.axhspan(-k - 0.5, 0.5 - k, color="0.96", lw=0, zorder=-1)


def _course(ax: Any, table: pd.DataFrame) -> None:
    """Show rates relative to their resting rates, from the edit on."""
    ax.axhline(1, color="0.8", lw=0.8, zorder=0)
    for name, colour in POPULATIONS.items():
        rows = where(table, population=name).sort_values("time")
        ax.plot(rows["time"], rows["share"], color=colour, lw=1.1, label=name)
    ax.set(ylabel="rate / resting rate", xlim=(0, SHOWN_UNTIL))


if __name__ == "__main__":
    run(course=course, draw=draw)
