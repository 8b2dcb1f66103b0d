"""Figure L1: weights learned from reward against the exact log-likelihoods, on gratings."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, key, letter, where

SHADES = {100: "C5", 1000: "C0", 10_000: "C3"}
"""Colour after each number of trials."""
TASKS = {
    "2 mm": ("C0", "o", "same or different, 2 mm"),
    "1.5 mm": ("C1", "s", "same or different, 1.5 mm"),
    "Poisson cells, N = 4": ("C2", "^", "Poisson cells, N = 4"),
    "4 orientations, 2 mm": ("C3", "v", "4 orientations, 2 mm"),
    "8 orientations, 2 mm": ("C4", "D", "8 orientations, 2 mm"),
}
"""Colour, mark and label of each task."""


def draw(settings: Settings, ratios: Path, courses: Path, *, output: Path) -> Figure:
    """Draw the learned ratios of single readings, and slope and r over trials."""
    learned = read_table(ratios)
    course = where(read_table(courses), rule="confidence")
    figure, axes = plt.subplots(1, 3, figsize=(7.4, 2.7), width_ratios=[1.4, 1, 1])
    _ratios(axes[0], learned)
    letter(axes[0], "a  what a reading tells")
    for ax, name, label in (
        (axes[1], "slope", "nats learned per exact nat"),
        (axes[2], "r", "correlation with exact nats"),
    ):
        over_trials(ax, course, name)
        ax.axhline(1, color="0.6", lw=0.8, ls=":", zorder=0)
        ax.set(ylabel=label, ylim=(0, None))
    letter(axes[1], "b  calibration")
    letter(axes[2], "c  direction")
    key(figure, axes[1], ncols=3)
    return figure


def _ratios(ax: Axes, learned: pd.DataFrame) -> None:
    """Show learned and exact ratios over the reading."""
    for after, colour in SHADES.items():
        rows = where(learned, after=after)
        low, high = (rows["learned_nats"] + k * rows["learned_sd"] for k in (-1, 1))
        ax.fill_between(rows["reading_deg"], low, high, color=colour, alpha=0.2, lw=0)
        ax.plot(rows["reading_deg"], rows["learned_nats"], color=colour, label=f"{after:,} trials")
    rows = where(learned, after=max(SHADES))
    ax.plot(rows["reading_deg"], rows["exact_nats"], "k--", lw=1, label="exact")
    ax.legend(loc="upper left")
    ax.set(xlabel="difference of two decoded angles (deg)", xticks=[-90, 0, 90], xlim=(-100, 130))
    ax.set_ylabel("ln p(different) / p(same) (nats)")


def over_trials(ax: Axes, course: pd.DataFrame, name: str) -> None:
    """Show a score of each task over the number of trials, with 95 % intervals over runs."""
    for task, (colour, mark, label) in TASKS.items():
        rows = where(course, task=task)
        ax.errorbar(rows["after"], rows[name], 1.96 * rows[f"{name}_se"], fmt=f"{mark}-", ms=3,
                    lw=0.9, color=colour, label=label)  # fmt: skip
    ax.set(xscale="log", xlabel="trials")
