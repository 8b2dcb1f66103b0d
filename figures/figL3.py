"""Figure L3: unequal gains, unreliable feedback, and changes of labels and sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, letter, run, where

CRITICS: dict[str, dict[str, Any]] = {
    "confidence": {"color": "C0", "fmt": "o-", "label": "confidence"},
    "affine, share known": {"color": "C2", "fmt": "^-", "label": "affine, share known"},
    "affine, share learned": {"color": "C1", "fmt": "s-", "label": "affine, share learned"},
    "mean reward": {"color": "0.5", "fmt": "v-", "label": "mean reward"},
}
"""Look of each critic."""
AFTER = {10_000: ("o", "none"), 40_000: ("o", "full")}
DRIFTS = {
    "40 degrees at once": "C1",
    "40 degrees over 2000 trials": "C2",
    "readings doubled": "C3",
}
SHOWN = (2500, 5500)
"""First and last trial that are shown."""


def draw(settings: Settings, gains: Path, feedback: Path, changes: Path, *, output: Path) -> Figure:
    """Draw the shift of the criterion, slopes by critic, and the proportion correct."""
    changed = read_table(changes)
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 4.8))
    _gains(axes[0, 0], read_table(gains))
    letter(axes[0, 0], "a  unequal gains")
    _feedback(axes[0, 1], read_table(feedback))
    letter(axes[0, 1], "b  unreliable feedback")
    _changes(axes[1, 0], changed, {"labels exchanged": "C0", "none": "0.6"})
    letter(axes[1, 0], "c  labels exchanged")
    _changes(axes[1, 1], changed, DRIFTS)
    letter(axes[1, 1], "d  drift of the sensor")
    return figure


def _gains(ax: Axes, table: pd.DataFrame) -> None:
    """Show the shift of log odds over the ratio of gains, and its law."""
    law = np.log(table["ratio"])
    ends = np.array([law.min(), law.max()])
    ax.plot(ends, ends, "k--", lw=1, label=r"law, ln($\alpha_+ / \alpha_-$)")
    for after, (mark, fill) in AFTER.items():
        rows = where(table, after=after)
        ax.errorbar(
            np.log(rows["ratio"]), rows["shift_nats"], 1.96 * rows["shift_nats_se"], fmt=mark, ms=4,
            lw=0.9, color="C0", fillstyle=fill, label=f"{after:,} trials",
        )  # fmt: skip
    ratios = sorted(table["ratio"].unique())
    ax.set_xticks(np.log(ratios), [f"{r:g}" for r in ratios])
    ax.set(xlabel="gain of positive / negative errors", ylabel="overconfidence (nats)")
    ax.legend()


def _feedback(ax: Axes, table: pd.DataFrame) -> None:
    """Show the slope over the share of valid feedback."""
    for critic, style in CRITICS.items():
        rows = where(table, critic=critic)
        ax.errorbar(100 * rows["valid"], rows["slope"], 1.96 * rows["slope_se"], ms=3.5, lw=0.9,
                    **style)  # fmt: skip
    ax.axhline(1, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.set_xticks(100 * np.sort(table["valid"].unique()))
    ax.set(xlabel="trials with valid feedback (%)", ylabel="nats learned per exact nat")
    ax.set_ylim(0, None)
    ax.legend(title="critic")


def _changes(ax: Axes, table: pd.DataFrame, colours: dict[str, str]) -> None:
    """Show the proportion correct around a change, with 95 % intervals over runs."""
    for name, colour in colours.items():
        rows = where(table, change=name)
        rows = rows[rows["trial"].between(*SHOWN)]
        since = rows["trial"] - rows["begins"]
        low, high = (rows["correct"] + k * 1.96 * rows["correct_se"] for k in (-1, 1))
        ax.fill_between(since, low, high, color=colour, alpha=0.2, lw=0)
        label = "no change" if name == "none" else name
        ax.plot(since, rows["correct"], color=colour, lw=1.1, label=label)
    ax.axvline(0, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.set(xlabel="trials since the change began", ylabel="proportion correct")
    ax.legend(loc="lower right")


if __name__ == "__main__":
    run(draw=draw)
