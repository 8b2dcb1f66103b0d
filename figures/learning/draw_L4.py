"""Figure L4: learners of values against the ideal learner, the circuit, and people who learn.

Everything drawn is from the tables of the score `values`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, letter, say_if_older, where

LEARNERS = {
    "ideal": "k",
    "Q, both arms": "C0",
    "confidence": "C1",
    "OpAL": "C2",
    "Q": "C4",
    "REINFORCE": "C5",
}
"""Learners that are drawn after a reversal, and their colours."""
LEVELS = {0.9: "C0", 1.0: "k", 1.15: "C3"}
"""Levels of dopamine."""
PAIRS = {"AB": "C0", "CD": "C1", "EF": "C2"}
"""Pairs of items of people."""
TITLES = (
    "a  after a reversal",
    "b  regret",
    "c  circuit, values given",
    "d  circuit, values learned",
    "e  people: choices",
    "f  their times",
    "g  by difference",
)
DOTS: dict[str, Any] = {"fmt": "o", "ms": 3.5, "lw": 1.0, "capsize": 1.5}


def draw(
    settings: Settings,
    bandit: Path,
    reversal: Path,
    times: Path,
    loop: Path,
    courses: Path,
    differences: Path,
    *,
    output: Path,
) -> Figure:
    """Draw learners, the circuit and people, one row each."""
    figure = plt.figure(figsize=(7.8, 8.4))
    parts: Any = figure.subfigures(2, 1, height_ratios=(2, 1))
    top, bottom = parts
    panels = [*top.subplots(2, 2).flat, *bottom.subplots(1, 3).flat]
    axes = dict(zip("abcdefg", panels, strict=True))
    _after_reversal(axes["a"], read_table(reversal))
    _regret(axes["b"], read_table(bandit))
    _circuit(axes["c"], read_table(times))
    _loop(axes["d"], read_table(loop))
    people = read_table(courses)
    _people(axes["e"], people, "share")
    axes["e"].set(ylabel="better item chosen", ylim=(0.3, 1.0))
    axes["e"].legend(fontsize=7, loc="upper left")
    _people(axes["f"], people, "median_s")
    axes["f"].set(ylabel="median response time (s)", ylim=(0.8, 1.4))
    _by_difference(axes["g"], read_table(differences))
    for ax, title in zip(axes.values(), TITLES, strict=True):
        letter(ax, title)
    say_if_older(figure, times, loop)
    return figure


def _after_reversal(ax: Axes, table: pd.DataFrame) -> None:
    """Draw the share of the better arm by trial since the reversal."""
    for name, colour in LEARNERS.items():
        rows = where(table, learner=name)
        ax.plot(rows["since"], rows["share"], color=colour, lw=2 if name == "ideal" else 1,
                label=name)  # fmt: skip
    ax.set(xlabel="trial since the reversal", ylabel="better arm chosen", ylim=(0, 1))
    ax.legend(fontsize=7, loc="lower right")


def _regret(ax: Axes, table: pd.DataFrame) -> None:
    """Draw the relative regret of every learner for both pairs of probabilities."""
    rows = where(table, reversals="every 50")
    names = [name for name in rows["learner"].unique() if name not in ("ideal", "chance")]
    shown = [name for name in names if name != "REINFORCE, no decay"]
    for better, colour, shift in ((0.8, "k", -0.12), (0.7, "0.55", 0.12)):
        regrets = where(rows, better=better).set_index("learner").loc[shown]
        ax.errorbar(regrets["relative_regret"], np.arange(len(shown)) + shift,
                    xerr=regrets["relative_regret_se"], color=colour,
                    label=f"{better:g} and {1 - better:.1f}", **DOTS)  # fmt: skip
    ax.axvline(1, color="0.7", lw=0.8, zorder=0)
    ax.axvline(1.35, color="0.7", lw=0.8, ls=":", zorder=0)
    ax.set_yticks(range(len(shown)), shown, fontsize=7)
    ax.set(xlabel="regret / regret of the ideal learner")
    ax.invert_yaxis()
    ax.legend(fontsize=7, title="rewarded", title_fontsize=7)


def _circuit(ax: Axes, table: pd.DataFrame) -> None:
    """Draw the median time against the share of the better action, one line a level."""
    for level, colour in LEVELS.items():
        rows = where(table, dopamine=level)
        ax.errorbar(rows["difference"], rows["median_ms"], rows["median_se"], color=colour,
                    label=f"dopamine {level:g}", **{**DOTS, "fmt": "o-"})  # fmt: skip
        for row in rows.to_dict("records"):
            ax.annotate(f"{row['share']:.2f}", (row["difference"], row["median_ms"]), fontsize=6,
                        color=colour, xytext=(4, 4), textcoords="offset points")  # fmt: skip
    ax.set(xlabel="difference of values", ylabel="median decision time (ms)", xlim=(-0.05, 0.7))
    ax.legend(fontsize=7)


def _loop(ax: Axes, table: pd.DataFrame) -> None:
    """Draw mean times and choices of the circuit that teaches its learner."""
    for level, colour in LEVELS.items():
        rows = where(table, dopamine=level)
        ax.errorbar(rows["since"], rows["mean_ms"], rows["mean_ms_se"], color=colour,
                    **{**DOTS, "fmt": "o-"})  # fmt: skip
    ax.set(xlabel="trial since the reversal", ylabel="mean decision time (ms)")
    right = ax.twinx()
    rows = where(table, dopamine=1.0)
    right.plot(rows["since"], rows["share"], "--", color="0.5", lw=1)
    right.set_ylim(0, 1)
    right.set_ylabel("better arm (dashed, dopamine 1)", fontsize=7, color="0.4")
    right.tick_params(labelsize=7, colors="0.4")


def _people(ax: Axes, table: pd.DataFrame, name: str) -> None:
    """Draw people (dots) and the fitted model (lines) over the trials of each pair."""
    for shift, (pair, colour) in zip((-0.7, 0.0, 0.7), PAIRS.items(), strict=True):
        rows = where(table, pair=pair)
        at = rows["trial"] + shift
        ax.errorbar(at, rows[name], rows[f"{name}_se"], color=colour, label=pair, **DOTS)
        ax.plot(at, rows[f"{name}_model"], color=colour, lw=1)
    ax.set(xlabel="trial of the pair")


def _by_difference(ax: Axes, table: pd.DataFrame) -> None:
    """Draw times by the difference of the fitted values."""
    ax.errorbar(table["drift"], table["median_s"], table["median_s_se"], color="k", **DOTS)
    ax.plot(table["drift"], table["median_s_model"], color="k", lw=1)
    ax.set(xlabel="absolute drift (1/sqrt(s))", ylim=(0.8, 1.4))
