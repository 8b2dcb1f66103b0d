"""The picture of an exam, on one page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.experiments.drawing import LOOKS
from bgmodel.experiments.expected import AGREES, DISAGREES, FAILS, OPEN, UNANSWERED
from circuits.plots import GREY, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_SHOWN, WITHOUT_Z = 6.0, 8.0
"""Larger z scores are drawn at the first, as arrows; outcomes without a z score at the second."""
OUTCOMES = (AGREES, DISAGREES, OPEN, FAILS, UNANSWERED)
"""Outcomes of a number, in the order of bars."""


@styled
def page(table: pd.DataFrame, totals: pd.DataFrame, title: str) -> Figure:
    """Draw all numbers of an exam and the totals of its domains."""
    size = (7.2, 0.165 * len(table) + 1.2)
    figure, axes = panels(1, 2, size=size, width_ratios=[3, 1.3])
    numbers, domains = axes[0]
    _numbers(numbers, table)
    _domains(domains, totals)
    for ax, name in zip((numbers, domains), "ab", strict=True):
        ax.set_title(name, loc="left", fontweight="bold")
    _legend(figure, [name for name in OUTCOMES if name in set(table["outcome"])])
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _legend(figure: Figure, names: list[str]) -> None:
    """Explain the marker and the bar of each outcome, and stars and arrows."""
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        (Line2D([], [], ls="", **LOOKS[name] | {"ms": 5}), Patch(lw=0.5, ec="k", **_fill(name)))
        for name in names
    ]
    handles += [Line2D([], [], ls="", marker=">", ms=5, color=GREY), Line2D([], [], ls="")]
    labels = [name.capitalize() for name in names]
    labels += [f"Beyond {MOST_SHOWN:g}", "* Set by this number"]
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(handles), fontsize=6,
        handler_map={tuple: HandlerTuple(ndivide=None)}, columnspacing=1.2, handletextpad=0.4,
    )  # fmt: skip


def _fill(name: str) -> dict[str, Any]:
    """Return the filling of the bar of an outcome."""
    face = {OPEN: "w", FAILS: "w", UNANSWERED: "0.8"}.get(name, LOOKS[name]["color"])
    hatch = {OPEN: "////", FAILS: "xxxx"}.get(name, "")
    return {"fc": face, "hatch": hatch}


def _numbers(ax: Axes, table: pd.DataFrame) -> None:
    """Draw a row per number: its z score, or on the right the outcome of one without."""
    ax.axvspan(-2, 2, color="0.9", lw=0, zorder=0)
    ax.axvline(MOST_SHOWN + 1, color=GREY, lw=0.5)
    for y, row in enumerate(table.to_dict("records")):
        z = row["z"]
        style: Look = LOOKS[row["outcome"]] | {"ms": 5, "ls": ""}
        if np.isfinite(z) and abs(z) > MOST_SHOWN:
            style["marker"] = ">" if z > 0 else "<"
        x = float(np.clip(z, -MOST_SHOWN, MOST_SHOWN)) if np.isfinite(z) else WITHOUT_Z
        ax.plot(x, y, clip_on=False, zorder=3, **style)
    starts = np.flatnonzero(table["domain"].ne(table["domain"].shift()))
    for start in starts[1:]:
        ax.axhline(start - 0.5, color=GREY, lw=0.5)
    names = table["id"] + np.where(table["set_by"] == "set by", " *", "")
    ax.set_yticks(range(len(table)), names, fontsize=6)
    ax.tick_params(axis="y", length=0)
    ticks = range(-6, 7, 2)
    ax.set_xticks([*ticks, WITHOUT_Z], [*map("{:g}".format, ticks), "direction\nor none"])
    ax.set(
        xlim=(-MOST_SHOWN - 0.5, WITHOUT_Z + 1), ylim=(len(table) - 0.5, -0.5),
        xlabel="Model less published (standard errors)",
    )  # fmt: skip


def _domains(ax: Axes, per_domain: pd.DataFrame) -> None:
    """Draw, for each domain, how many numbers have each outcome."""
    for y, row in enumerate(per_domain.to_dict("records")):
        left = 0
        for name in OUTCOMES:
            count = row[name]
            ax.barh(y, count, left=left, height=0.6, ec="k", lw=0.5, **_fill(name))
            left += count
        ax.text(0.05, y - 0.36, row["domain"], fontsize=6, va="bottom")
    ax.set(xlabel="Numbers", ylim=(len(per_domain) - 0.5, -0.8), yticks=[])
