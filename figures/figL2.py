"""Figure L2: decision times with learned weights, over trials and by rule."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, key, letter, run, where

LEARNERS: dict[str, dict[str, Any]] = {
    "confidence": {"color": "C0", "fmt": "o-", "label": "confidence rule"},
    "chosen": {"color": "C1", "fmt": "s-", "label": "chosen channel alone"},
    "confidence, D1 alone": {"color": "C3", "fmt": "v-", "label": "learned drive to D1 alone"},
    "counts": {"color": "0.5", "fmt": "^--", "label": "counts with the truth known"},
}
"""Look of each learner."""
PANELS = {
    "2 mm": "a  same or different, 2 mm",
    "1.5 mm": "b  same or different, 1.5 mm",
    "Poisson cells, N = 4": "c  Poisson cells, N = 4",
}
STOPPINGS = {"at a posterior of 0.9": "C0", "after 3 readings": "C1"}
"""Colour of each stopping rule."""
LEAST_SLOPE = 0.03
"""Slopes below this, and negative ones, are drawn here."""


def draw(settings: Settings, courses: Path, rules: Path, *, output: Path) -> Figure:
    """Draw relative times over trials for three tasks, and the slopes of the rules."""
    course = read_table(courses)
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 4.8))
    for ax, (task, title) in zip(axes.flat, PANELS.items(), strict=False):
        _times(ax, where(course, task=task))
        letter(ax, title)
    _slopes(axes[1, 1], read_table(rules))
    letter(axes[1, 1], "d  rules, 2 mm")
    key(figure, axes[1, 0], axes[1, 1], ncols=4)
    return figure


def _times(ax: Axes, course: pd.DataFrame) -> None:
    """Show times at equal accuracy relative to the exact likelihoods."""
    for rule, style in LEARNERS.items():
        rows = where(course, rule=rule)
        if len(rows):
            ax.errorbar(rows["after"], rows["relative_time"], 1.96 * rows["relative_time_se"],
                        ms=3, lw=0.9, **style)  # fmt: skip
    ax.axhline(1, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.set(xscale="log", xlabel="trials", ylabel="time relative to exact likelihoods")


def names(table: pd.DataFrame) -> list[str]:
    """Return rule and critic of each row as text."""
    own = table["critic"] == "the rule's"
    return list(table["rule"].where(own, table["rule"] + ", critic " + table["critic"]))


def _slopes(ax: Axes, table: pd.DataFrame) -> None:
    """Show the slope of each rule, after 10 000 trials (open) and after 40 000."""
    table = table.assign(name=names(table))
    every = list(dict.fromkeys(table["name"]))
    for shift, (stopping, colour) in zip((-0.16, 0.16), STOPPINGS.items(), strict=True):
        rows = where(table, stopping=stopping)
        for after, fill in zip(sorted(rows["after"].unique()), ("none", "full"), strict=True):
            part = where(rows, after=after)
            at = np.array([every.index(name) for name in part["name"]]) + shift
            ax.errorbar(
                part["slope"].clip(lower=LEAST_SLOPE), at, xerr=1.96 * part["slope_se"], fmt="o",
                ms=3.5, lw=0.8, color=colour, fillstyle=fill,
                label=stopping if fill == "full" else None,
            )  # fmt: skip
    ax.axvline(1, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.set_yticks(range(len(every)), every)
    ax.set(xscale="log", xlabel="nats learned per exact nat", ylim=(len(every) - 0.4, -0.6))
    ax.set_xticks([0.03, 0.1, 0.3, 1, 3, 10], ["≤ 0.03", "0.1", "0.3", "1", "3", "10"])


if __name__ == "__main__":
    run(draw=draw)
