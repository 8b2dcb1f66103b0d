"""Figure E2: which task tells two models apart, and with how many trials."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bgmodel.discriminating.result import NAMES, label
from bgmodel.support.files import read_table
from figures.common import Settings, letter, say_if_older

RANGE_NATS = (1e-4, 3.0)
"""Information at the ends of the colours."""
COLOURS = ("#0072B2", "0.55")
"""Colours of the first and the second model of a pair."""


def draw(settings: Settings, axes: Path, trials: Path, *, output: Path) -> Figure:
    """Draw the map of the space of each pair, and the trials that its best task needs."""
    table, needed = (
        read_table(
            axes,
        ),
        read_table(trials),
    )
    pairs = list(dict.fromkeys(table["pair"]))
    figure = plt.figure(figsize=(7.4, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1))
    _map(left, table, pairs)
    _trials(right, needed, pairs)
    letter(left, "a  most information per trial (nats)")
    letter(right, "b  trials until a Bayes factor of 10")
    say_if_older(figure, axes, trials)
    return figure


def _map(ax: Axes, table: pd.DataFrame, pairs: list[str]) -> None:
    """Draw a cell per pair and value of an axis, with the information of the best task."""
    both = zip(table["axis"], table["value"].astype(str), strict=True)
    table = table.assign(text=[label(*each) for each in both])
    order = {name: k for k, name in enumerate(NAMES)}
    rows = table.drop_duplicates("text").sort_values(
        "axis", key=lambda axis: axis.map(order), kind="stable"
    )
    names, norm = list(rows["text"]), LogNorm(*RANGE_NATS, clip=True)
    for row in table.to_dict("records"):
        x, y = pairs.index(row["pair"]), names.index(row["text"])
        nats = row["nats"] if row["low"] > 0 else 0.0
        colour = plt.get_cmap("Blues")(0.75 * norm(nats)) if nats > 0 else "white"
        ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="0.85", lw=0.6))
        ax.text(x, y, f"{nats:.2g}" if nats > 0 else "–", ha="center", va="center", fontsize=4.5)
    kinds = rows["axis"].to_numpy()
    for y in np.flatnonzero(kinds[1:] != kinds[:-1]):
        ax.axhline(y + 0.5, color="0.4", lw=0.6)
    ax.set_yticks(range(len(names)), [fill(name, 24) for name in names], fontsize=5.5)
    ax.set_xticks(range(len(pairs)), [fill(pair, 20) for pair in pairs], rotation=90, fontsize=5.5)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set(xlim=(-0.5, len(pairs) - 0.5), ylim=(len(names) - 0.5, -0.5))


def _trials(ax: Axes, table: pd.DataFrame, pairs: list[str]) -> None:
    """Draw predicted medians with intervals, and simulated ones, with either model true."""
    for (pair, _), part in table.groupby(["pair", table.groupby("pair").cumcount()], sort=False):
        row = part.iloc[0]
        second = row["truth"] != table.loc[table["pair"] == pair, "truth"].iloc[0]
        y, colour = pairs.index(str(pair)) + (0.15 if second else -0.15), COLOURS[second]
        if np.isfinite(row["median"]):
            ax.hlines(y, row["low"], row["high"], color=colour, lw=2.5)
            ax.plot(row["median"], y, "o", ms=4, color=colour)
            ax.plot(row["simulated_median"], y, "x", ms=5, color="k", mew=1)
        elif np.isfinite(row["low"]):
            ax.plot(row["low"], y, ">", ms=4, color=colour, mfc="w")
    for pair in pairs:
        if not np.isfinite(table.loc[table["pair"] == pair, "low"]).any():
            ax.text(0.5, pairs.index(pair), "no task can", transform=ax.get_yaxis_transform(),
                    ha="center", va="center", fontsize=6)  # fmt: skip
    looks: tuple[tuple[str, dict[str, Any]], ...] = (
        ("first model true", {"marker": "o", "color": COLOURS[0]}),
        ("second model true", {"marker": "o", "color": COLOURS[1]}),
        ("200 simulated experiments", {"marker": "x", "color": "k"}),
        ("at least, cannot tell", {"marker": ">", "color": "0.4", "mfc": "w"}),
    )
    for name, style in looks:
        ax.plot([], [], ls="", ms=4, label=name, **style)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=6)
    ax.set_yticks(range(len(pairs)), [fill(pair, 20) for pair in pairs], fontsize=5.5)
    ax.set(xscale="log", xlabel="Trials", ylim=(len(pairs) - 0.5, -0.5))
