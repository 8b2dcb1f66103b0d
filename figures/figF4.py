"""Figure F4: parameter recovery of the fits, and the calibration of their intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import beta, kstwo

from bgmodel.support.arrays import Array
from bgmodel.support.files import read_table
from figures.common import Settings, key, letter, run, say_if_older, where

CRITERION = {"test": "bound", "circuit": "threshold_nats"}
LABELS = {
    "sensitivity": "sensitivity (s$^{-1/2}$)",
    "bound": "half of the gap (s$^{1/2}$)",
    "threshold_nats": "threshold (nats)",
    "t0_s": "t0 (s)",
    "t0_sd_s": "SD of t0 (s)",
    "lapse": "lapses",
}
COLOUR = {"sensitivity": "C0", "bound": "C1", "threshold_nats": "C1", "t0_s": "C2",
          "t0_sd_s": "C3", "lapse": "C4"}  # fmt: skip
RANKED = 99
"""Number of draws among which the score ranks the truth."""
SHARE = 0.9
"""Posterior probability of the score's intervals."""
SURE = 0.95


def draw(settings: Settings, recovered: Path, calibrated: Path, *, output: Path) -> Figure:
    """Draw truth against posterior mean, ranks of the truth, and coverage."""
    table, calibration = read_table(recovered), read_table(calibrated)
    figure, axes = plt.subplots(3, 3, figsize=(7.4, 7.2))
    for row, by in zip(axes, CRITERION, strict=False):
        for ax, name in zip(row, ("sensitivity", CRITERION[by], "t0_s"), strict=True):
            rows, found = (where(one, by=by, parameter=name) for one in (table, calibration))
            _recovery(ax, rows, found["correlation"].item(), name)
        row[0].set_ylabel("posterior mean")
    letter(axes[0, 0], "a  the test")
    letter(axes[1, 0], "b  the circuit")
    axes[2, 1].sharey(axes[2, 0])
    for ax, by in zip(axes[2], CRITERION, strict=False):
        _ranks(ax, where(table, by=by))
    axes[2, 0].set_ylabel("share of ranks below,\nminus uniform")
    axes[2, 1].tick_params(labelleft=False)
    letter(axes[2, 0], "c  ranks, the test")
    letter(axes[2, 1], "d  ranks, the circuit")
    _coverage(axes[2, 2], calibration)
    letter(axes[2, 2], "e  coverage")
    key(figure, *axes[2], ncols=5)
    say_if_older(figure, recovered, calibrated)
    return figure


def _recovery(ax: Any, rows: pd.DataFrame, correlation: float, name: str) -> None:
    """Show the posterior mean and its interval against the truth."""
    ends = (rows["truth"].min(), rows["truth"].max())
    ax.plot(ends, ends, color="0.6", lw=0.8, zorder=0)
    off = np.abs(rows[["low", "high"]].to_numpy().T - rows["mean"].to_numpy())
    ax.errorbar(
        rows["truth"], rows["mean"], off, fmt="o", ms=2, lw=0.4, color=COLOUR[name], alpha=0.7
    )
    ax.text(0.04, 0.93, f"r = {correlation:.2f}", transform=ax.transAxes, fontsize=7)
    ax.set(xlabel=f"true {LABELS[name]}")


def _ranks(ax: Any, table: pd.DataFrame) -> None:
    """Show the deviation of ranks of the truth from uniform, with the 95 % band."""
    sets = table["set"].nunique()
    reach = kstwo.ppf(SURE, sets)
    ax.axhspan(-reach, reach, color="0.93", lw=0, zorder=-1, label="95 % band of uniform ranks")
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    place = np.arange(RANKED + 1)
    for name, rows in table.groupby("parameter", sort=False):
        below = np.searchsorted(np.sort(rows["rank"]), place, side="right") / len(rows)
        less = below - (place + 1) / (RANKED + 1)
        ax.step(place / RANKED, less, where="post", lw=1, color=COLOUR[str(name)])
    for name in table["parameter"].unique():
        ax.plot([], [], lw=1.4, color=COLOUR[name], label=_short(name))
    ax.set(xlabel="rank of the truth among draws (share)", xlim=(0, 1))


def _short(name: str) -> str:
    """Return the name of a parameter without its unit; criteria of both models have one."""
    return "criterion" if name in CRITERION.values() else LABELS[name].partition(" (")[0]


def interval(inside: float, sets: int) -> Array:
    """Return the 95 % interval of a share of some sets (Clopper & Pearson 1934)."""
    count = round(inside * sets)
    tail = (1 - SURE) / 2
    low = beta.ppf(tail, count, sets - count + 1) if count else 0.0
    high = beta.ppf(1 - tail, count + 1, sets - count) if count < sets else 1.0
    return np.array([low, high])


def _coverage(ax: Any, table: pd.DataFrame) -> None:
    """Show the share of data sets whose interval contains the truth."""
    ax.axhline(SHARE, color="0.6", lw=0.8, ls=":")
    names: list[str] = []
    for by, mark, move in (("test", "o", -0.12), ("circuit", "s", 0.12)):
        rows = where(table, by=by)
        row: Any
        for place, row in enumerate(rows.itertuples()):
            away = np.abs(interval(row.coverage, row.sets) - row.coverage)[:, None]
            colour = COLOUR[row.parameter]
            style: dict[str, Any] = {"color": colour, "mfc": "w" if by == "test" else colour}
            ax.errorbar(place + move, row.coverage, away, fmt=mark, ms=3.5, lw=0.9, **style)
        names = list(rows["parameter"])
        fill = "w" if by == "test" else "0.3"
        ax.plot([], [], mark, ms=3.5, color="0.3", mfc=fill, label=f"coverage, the {by}")
    ax.set_xticks(range(len(names)), map(_short, names), rotation=35, ha="right", fontsize=6)
    ax.set(
        ylabel=f"share of {100 * SHARE:.0f} % intervals", ylim=(min(0.5, ax.get_ylim()[0]), 1.02)
    )


if __name__ == "__main__":
    run(draw=draw)
