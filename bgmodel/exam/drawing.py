"""The picture of an exam, on one page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.experiments.predictions import AGREES, DISAGREES, OPEN
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FAILS, UNANSWERED = "fails", "not answered"
MOST_SHOWN = 6.0
"""Larger z scores are drawn here, as arrows."""
LOOKS: dict[str, Look] = {
    AGREES: {"marker": "o", "color": PALETTE[0]},
    DISAGREES: {"marker": "X", "color": PALETTE[1]},
    OPEN: {"marker": "o", "color": GREY, "mfc": "w"},
    FAILS: {"marker": "v", "color": PALETTE[1], "mfc": "w"},
    UNANSWERED: {"marker": "_", "color": GREY},
}
"""Markers of outcomes, which differ in shape or filling, not only in colour."""


@styled
def page(table: pd.DataFrame, totals: pd.DataFrame, title: str) -> Figure:
    """Draw all numbers of an exam and the totals of its domains.

    Parameters
    ----------
    table, totals : DataFrame
        As from ``ExamRecord.table`` and ``ExamRecord.summary``.
    title : str
        Title of the page.
    """
    size = (7.2, 0.165 * len(table) + 1.2)
    figure, axes = panels(1, 2, size=size, width_ratios=[3, 1.3])
    numbers, domains = axes[0]
    _numbers(numbers, table)
    _domains(domains, totals)
    for ax, name in zip((numbers, domains), "ab", strict=True):
        ax.set_title(name, loc="left", fontweight="bold")
    handles = [_entry(name) for name in LOOKS if name in set(table["outcome"])]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _entry(name: str) -> Any:
    """Return an entry of the legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", ms=5, label=name.capitalize(), **LOOKS[name])


def _numbers(ax: Axes, table: pd.DataFrame) -> None:
    """Draw a row per number: its z score, or the outcome of a direction at 0."""
    ax.axvspan(-2, 2, color="0.9", lw=0, zorder=0)
    for y, row in enumerate(table.to_dict("records")):
        z = row["z"]
        style: Look = {"ms": 5, "ls": "", **LOOKS[row["outcome"]]}
        if np.isfinite(z) and abs(z) > MOST_SHOWN:
            style["marker"] = ">" if z > 0 else "<"
        x = float(np.clip(z, -MOST_SHOWN, MOST_SHOWN)) if np.isfinite(z) else 0.0
        ax.plot(x, y, clip_on=False, zorder=3, **style)
        if not np.isfinite(z) and row["outcome"] not in (FAILS, UNANSWERED):
            ax.text(0.5, y, "direction", va="center", fontsize=5, color=GREY)
    starts = np.flatnonzero(table["domain"].ne(table["domain"].shift()))
    for start in starts[1:]:
        ax.axhline(start - 0.5, color=GREY, lw=0.5)
    names = table["id"] + np.where(table["set_by"] == "set by", " *", "")
    ax.set_yticks(range(len(table)), names, fontsize=6)
    ax.tick_params(axis="y", length=0)
    ax.set(
        xlim=(-MOST_SHOWN - 0.5, MOST_SHOWN + 0.5), ylim=(len(table) - 0.5, -0.5),
        xlabel="Model less published (standard errors)",
    )  # fmt: skip


def _domains(ax: Axes, whole: pd.DataFrame) -> None:
    """Draw, for each domain, how many numbers have each outcome."""
    for y, row in enumerate(whole.to_dict("records")):
        left = 0
        for name, look in LOOKS.items():
            count = row[name]
            hatch = "////" if name in (OPEN, FAILS) else ""
            face = "w" if name == UNANSWERED else look["color"]
            ax.barh(y, count, left=left, height=0.6, fc=face, ec="k", lw=0.5, hatch=hatch)
            left += count
        ax.text(0.05, y - 0.36, row["domain"], fontsize=6, va="bottom")
    ax.set(xlabel="Numbers", ylim=(len(whole) - 0.5, -0.8), yticks=[])
