"""Figure E1: circuits under one exam of published numbers."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from bgmodel.support.files import read_table
from figures.common import Settings, letter, say_if_older

COLOURS = {
    "agrees": "#bfe3c0",
    "disagrees": "#f3c1b5",
    "left open": "#e6e6e6",
    "fails": "#c9c0dd",
    "not answered": "white",
}
"""Colour of each outcome."""
FIRST = (
    "macaque", "macaque, no motifs", "macaque_small", "macaque_small, no motifs", "spiking_msprt",
    "bogacz_gurney",
)  # fmt: skip
"""Circuits drawn first; others follow in the order of the table."""
SIGNS = {"agrees": "✓", "disagrees": "×", "left open": "?"}


def draw(settings: Settings, numbers: Path, domains: Path, *, output: Path) -> Figure:
    """Draw every answer of every circuit, and the share of each domain that agrees."""
    table, shares = read_table(numbers), read_table(domains)
    names = [name for name in FIRST if name in set(table["examinee"])]
    names += [name for name in table["examinee"].unique() if name not in names]
    figure = plt.figure(figsize=(7.4, 12.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 0.8))
    first = table[table["sitting"] == table["sitting"].min()]
    _answers(left, first, names)
    _shares(right, shares, names)
    letter(left, "a  every number")
    letter(right, "b  share of each domain")
    handles = [Patch(fc=colour, ec="0.4", lw=0.5, label=name) for name, colour in COLOURS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    say_if_older(figure, numbers, domains)
    return figure


def _answers(ax: Axes, table: pd.DataFrame, names: list[str]) -> None:
    """Draw a cell per number and circuit, with its z score or the mark of a direction."""
    rows = list(dict.fromkeys(table["id"]))
    for row in table.to_dict("records"):
        x, y = names.index(row["examinee"]), rows.index(row["id"])
        colour = COLOURS[row["outcome"]]
        ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="w", lw=0.6))
        z = row["z"]
        text = SIGNS.get(row["outcome"], "")
        if np.isfinite(z):
            text = f"{z:+.0f}" if abs(z) < 99.5 else ("≫" if z > 0 else "≪")
        weight = "bold" if row["set_by"] == "set by" else "normal"
        ax.text(x, y, text, ha="center", va="center", fontsize=5, fontweight=weight)
    domain = table.drop_duplicates("id")["domain"].to_numpy()
    for y in np.flatnonzero(domain[1:] != domain[:-1]):
        ax.axhline(y + 0.5, color="0.4", lw=0.6)
    ax.set_yticks(range(len(rows)), rows, fontsize=5.5)
    _columns(ax, names, len(rows))


def _shares(ax: Axes, shares: pd.DataFrame, names: list[str]) -> None:
    """Draw the share of each domain that agrees, mean and range over seeds."""
    rows = list(dict.fromkeys(shares["domain"]))
    for (domain, name), part in shares.groupby(["domain", "examinee"], sort=False):
        x, y = names.index(str(name)), rows.index(str(domain))
        share = part["share"].mean()
        known = np.isfinite(share)
        colour = plt.get_cmap("Greens")(0.7 * share) if known else "white"
        ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="w", lw=0.6))
        if known:
            apart = np.ptp(part["share"]) >= 0.005
            text = (
                f"{part['share'].min():.2f}\n{part['share'].max():.2f}" if apart else f"{share:.2f}"
            )
            ax.text(x, y, text, ha="center", va="center", fontsize=4.5)
    ax.set_yticks(range(len(rows)), [fill(name, 14) for name in rows], fontsize=5.5)
    _columns(ax, names, len(rows))


def _columns(ax: Axes, names: list[str], rows: int) -> None:
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=5.5)
    ax.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
    ax.spines[:].set_visible(False)
    ax.set(xlim=(-0.5, len(names) - 0.5), ylim=(rows - 0.5, -0.5))
