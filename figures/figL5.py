"""Figure L5: a Simon task on and off dopaminergic medication, in patients and in the circuit.

Predictions were committed before the patients were analysed; the results are those of a score.
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
from figures.common import Settings, bars, key, letter, run, say_if_older, where

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
BOTH = ("congruent", "incongruent")
CONTROLS, ON_OFF = "controls", "on - off"
WHO = "0.8 s"
"""People with the same deadline in all sessions."""
COLOUR = {"controls": "k", "off": "C1", "on": "C0"}
KINDS = MAIN, _, LATER = ("pulse", "fading", "brief")
"""Courses of the location's input in the circuit; the last one was added after the analysis."""
COURSE = {"pulse": ("C2", "-"), "fading": ("C4", "--"), "brief": ("C3", ":")}
MARK: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 2}
TESTED = {"better_far": "far apart", "better_near": "near"}
"""Pairs of the test, by the difference of their values: 1 and 0.5."""


def draw(
    settings: Settings, people: Path, outcomes: Path, circuit: Path, *, output: Path
) -> Figure:
    """Draw changes of times, costs, accuracy by speed, and choices of the test."""
    data = where(read_table(people), who=WHO)
    table = where(read_table(outcomes), who=WHO)
    later = where(read_table(circuit), kind=LATER, contrast=CONTROLS)
    figure, axes = plt.subplots(2, 2, figsize=(7.6, 5.6))
    _times(axes[0, 0], where(table, kind=MAIN, contrast=ON_OFF))
    levels = pd.concat([where(table, contrast=CONTROLS), later.assign(predicted=later["value"])])
    _costs(axes[0, 1], data, levels)
    _errors(axes[1, 0], data, levels)
    _tested(axes[1, 1], where(table, kind=MAIN, contrast=ON_OFF))
    key(figure, *axes.flat, ncols=4, fontsize=7)
    say_if_older(figure, people, outcomes, circuit)
    return figure


def _rows(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Return the rows of some measures, in their order."""
    return table.set_index("measure").loc[names].reset_index()


def _times(ax: Axes, change: pd.DataFrame) -> None:
    """Show the change of each quantile of the times of correct responses."""
    rows = _rows(change, [f"q{100 * q:.0f}_ms" for q in QUANTILES])
    ax.axhline(0, lw=0.5, color="0.6", zorder=0)
    ends = (rows["predicted_low"], rows["predicted_high"])
    ax.fill_between(QUANTILES, *ends, color="C2", alpha=0.2, lw=0, label="predicted range")
    ax.plot(QUANTILES, rows["predicted"], color="C2", label="circuit, pulse")
    bars(ax, QUANTILES, rows, color="0.3", label="patients, on minus off", **MARK)
    ax.set(xlabel="quantile of response times", ylabel="on minus off medication, ms")
    letter(ax, "a  times")


def _costs(ax: Axes, data: pd.DataFrame, levels: pd.DataFrame) -> None:
    """Show the cost of incongruence at each quantile."""
    ax.axhline(0, lw=0.5, color="0.6", zorder=0)
    names = [f"cost_q{100 * q:.0f}_ms" for q in QUANTILES]
    for kind in KINDS:
        colour, style = COURSE[kind]
        rows = _rows(where(levels, kind=kind), names)
        ax.plot(QUANTILES, rows["predicted"], color=colour, ls=style, label=_course(kind))
    for k, (who, colour) in enumerate(COLOUR.items()):
        at = np.array(QUANTILES) + 0.015 * (k - 1)
        rows = _rows(where(data, contrast=who), names)
        bars(ax, at, rows, color=colour, label=_named(who), **MARK)
    ax.set(xlabel="quantile of response times", ylabel="incongruent minus congruent, ms")
    letter(ax, "b  cost of incongruence")


def _errors(ax: Axes, data: pd.DataFrame, levels: pd.DataFrame) -> None:
    """Show the share of correct responses among the fastest and the slowest third."""
    speeds = ("fast", "slow")
    for k, congruency in enumerate(BOTH):
        names, at = [f"{congruency}_{speed}" for speed in speeds], np.array([0.0, 1.0]) + 2.6 * k
        for kind in KINDS:
            colour, style = COURSE[kind]
            rows = _rows(where(levels, kind=kind), names)
            ax.plot(at, rows["predicted"], color=colour, ls=style)
        for j, (who, colour) in enumerate(COLOUR.items()):
            rows = _rows(where(data, contrast=who), names)
            bars(ax, at + 0.12 * (j - 1), rows, color=colour, **MARK)
        ax.text(2.6 * k + 0.5, 1.0, congruency, ha="center", va="bottom", fontsize=7,
                transform=ax.get_xaxis_transform())  # fmt: skip
    ax.set_xticks([0, 1, 2.6, 3.6], ["fastest\nthird", "slowest\nthird"] * 2)
    ax.set_ylabel("share correct")
    ax.set_title("c  accuracy by speed", loc="left", fontweight="bold", pad=14)


def _tested(ax: Axes, change: pd.DataFrame) -> None:
    """Show the change of choices of the better item, and of their times on the right."""
    right = ax.twinx()
    for side, names, begin in (
        (ax, list(TESTED), 0),
        (right, [name.replace("better", "test") + "_s" for name in TESTED], 2),
    ):
        rows = _rows(change, names)
        for k, row in rows.iterrows():
            at = np.array([begin + int(str(k)) - 0.3, begin + int(str(k)) + 0.3])
            ends = (row["predicted_low"], row["predicted_high"])
            side.fill_between(at, *ends, color="C2", alpha=0.2, lw=0)
            side.plot(at, [row["predicted"]] * 2, color="C2")
        bars(side, begin + np.arange(2), rows, color="0.3", **MARK)
    for side in (ax, right):
        low, high = side.get_ylim()
        size = max(-low, high)
        side.set_ylim(-size, size)
    ax.axhline(0, lw=0.5, color="0.6", zorder=0)
    ax.axvline(1.5, lw=0.5, color="0.6")
    ax.set_xticks(range(4), [f"{what}\n{name}" for what in ("choice", "time") for name in
                             TESTED.values()])  # fmt: skip
    ax.set_ylabel("on minus off: share of better item")
    right.set_ylabel("on minus off: median time, s")
    letter(ax, "d  test of what was learned")


def _course(kind: str) -> str:
    return f"circuit, {kind}{' (added later)' if kind == LATER else ''}"


def _named(who: str) -> str:
    return who if who == "controls" else f"patients {who} medication"


if __name__ == "__main__":
    run(draw=draw)
