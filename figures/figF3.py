"""Figure F3: STN stimulation with and without conflict, and its possible targets in the circuit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import t as student

from bgmodel.support.files import read_table
from figures.common import Settings, key, letter, run, say_if_older, where

MOVES = {
    "nothing": ("nothing", "0.5"),
    "threshold": ("threshold", "C0"),
    "dopamine": ("dopamine", "C3"),
    "stn_loss": ("loss of STN", "C1"),
    "gpe_loss": ("loss of GPe", "C2"),
}
"""The parameter changed by stimulation (the score's name), its label and colour."""
EFFECTS = ("high", "low", "interaction")
EFFECT_LABELS = ("with\nconflict", "without", "difference")
MEASURES = (("mean_s", "change of mean time (s)"), ("accuracy", "change of accuracy"))


def draw(settings: Settings, cells: Path, moves: Path, *, output: Path) -> Figure:
    """Draw effects of stimulation on people and on the circuit, and predictions of trials."""
    table, summed = read_table(cells), read_table(moves).set_index("moved")
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 5.4), width_ratios=[1.25, 1])
    for ax, (measure, label) in zip(axes[:, 0], MEASURES, strict=True):
        _effects(ax, table, measure)
        ax.set_ylabel(label)
    letter(axes[0, 0], "a  time, stimulation on minus off")
    letter(axes[1, 0], "b  accuracy, stimulation on minus off")
    _summed(axes[0, 1], summed, table["participant"].nunique())
    letter(axes[0, 1], "c  held-out trials")
    _each(axes[1, 1], table)
    letter(axes[1, 1], "d  the same, person by person")
    key(figure, axes[0, 0], ncols=6, columnspacing=1.2)
    say_if_older(figure, cells, moves)
    return figure


def effects(rows: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return the effects of stimulation with and without conflict, and their difference.

    Parameters
    ----------
    rows : DataFrame
        One row per person and condition.
    name : str
        The column to compare.

    Returns
    -------
    DataFrame
        Index of ``EFFECTS``; mean over people, and off, half its 95 % interval (Student t).
    """
    wide = rows.pivot(index="participant", columns=["conflict", "stimulation"], values=name)
    each = {one: wide[one, "on"] - wide[one, "off"] for one in ("high", "low")}
    each["interaction"] = each["high"] - each["low"]
    reach = student.ppf(0.975, len(wide) - 1)
    found = {one: (change.mean(), reach * change.sem()) for one, change in each.items()}
    return pd.DataFrame(found, index=["mean", "off"]).T


def _effects(ax: Any, table: pd.DataFrame, measure: str) -> None:
    """Show the effects of people, and of the circuit with each move."""
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    first = where(table, moved=next(iter(MOVES)))
    place = np.arange(len(EFFECTS))
    seen = effects(first, measure)
    look: dict[str, Any] = {"fmt": "D", "ms": 4, "lw": 1, "color": "k", "label": "people"}
    ax.errorbar(place - 0.32, seen["mean"], seen["off"], **look)
    for k, (move, (label, colour)) in enumerate(MOVES.items()):
        said, x = effects(where(table, moved=move), f"model_{measure}"), place - 0.16 + 0.12 * k
        look = {"fmt": "o", "ms": 3, "lw": 0.9, "color": colour, "label": f"circuit: {label}"}
        ax.errorbar(x, said["mean"], said["off"], **look)
    ax.axvline(1.5, color="0.6", lw=0.6, ls=":")
    ax.set_xticks(place, EFFECT_LABELS)


def _summed(ax: Any, table: pd.DataFrame, people: int) -> None:
    """Show how much better each change predicts than none, summed over people."""
    ax.axvline(0, color="0.8", lw=0.8, zorder=0)
    shown = [move for move in MOVES if move != "nothing"]
    for k, move in enumerate(shown):
        one, (_, colour) = table.loc[move], MOVES[move]
        ax.errorbar([one["better_nats"]], [-k], xerr=[one["error_nats"]], fmt="o", ms=4, lw=1,
                    color=colour)  # fmt: skip
        said = f"{one['better_people']:.0f} of {people} people"
        ax.annotate(said, (one["better_nats"], -k), (0, 5), textcoords="offset points",
                    ha="center", fontsize=6)  # fmt: skip
    ax.set_yticks(-np.arange(len(shown)), [MOVES[move][0] for move in shown])
    ax.margins(x=0.25)
    ax.set(ylim=(0.6 - len(shown), 0.6), xlabel="better than no change (nats)")


def _each(ax: Any, table: pd.DataFrame) -> None:
    """Show the same for each person, one line per person, sorted by the best change."""
    each = table.drop_duplicates(["participant", "moved"])
    wide = each.pivot(index="participant", columns="moved", values="better_nats")
    shown = [move for move in MOVES if move != "nothing"]
    wide = wide[shown].iloc[wide[shown].max(axis=1).argsort()]
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    for k, move in enumerate(shown):
        place = np.arange(len(wide)) + 0.14 * (k - 1.5)
        ax.plot(place, wide[move], "o", ms=3, color=MOVES[move][1])
    ax.set_xticks([])
    ax.set(xlabel="people, sorted", ylabel="better (nats)")


if __name__ == "__main__":
    run(draw=draw)
