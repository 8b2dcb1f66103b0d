"""Figure of a search: the information of each value of an axis, and the trials needed."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from bgmodel.discriminating.sequential import FACTOR
from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = {
    "channels": "N", "d_prime": "d'", "conflict": "conflict", "stop_nats": "stop signal, nats",
    "edits": "", "accuracy": "accuracy", "deadline_ms": "deadline, ms", "session": "session",
}  # fmt: skip
"""The label of each axis."""
LEAST_NATS = 1e-5
"""Information is drawn from here on."""
WIDE = 300.0
"""Ratio of the ends of an axis with few ticks."""


def label(axis: str, value: str) -> str:
    """Return the label of a value of an axis."""
    return "no manipulation" if value == "none" else f"{NAMES[axis]} {value}".strip()


@styled
def draw(rows: pd.DataFrame, sequential: pd.DataFrame, title: str) -> Figure:
    """Draw a map of the space, and the trials that the best task needs."""
    # An axis of one value is no axis.
    several = rows[rows.groupby("axis")["value"].transform("size") > 1]
    rows = several if len(several) else rows
    figure, axes = panels(1, 2, size=(7.4, 0.2 * len(rows) + 1.5), width_ratios=[1.4, 1])
    draw_map(axes[0, 0], rows)
    draw_trials(axes[0, 1], sequential)
    for ax, name in zip(axes[0], "ab", strict=True):
        ax.set_title(name, loc="left", fontweight="bold")
    _legend(figure)
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _legend(figure: Figure) -> None:
    """Explain points, lines and crosses."""
    from matplotlib.lines import Line2D

    predicted = "Predicted, with 95 % interval (in a its lower end)"
    figure.legend(
        handles=[
            Line2D([], [], color=GREY, lw=1, marker="o", ms=4, label=predicted),
            Line2D([], [], color="k", ls="", marker="x", ms=6, label="Simulated experiments"),
        ],
        loc="outside lower center", ncols=2, fontsize=7,
    )  # fmt: skip


def draw_map(ax: Axes, rows: pd.DataFrame) -> None:
    """Draw the best task's information at each value of each axis, with its lower 95 % bound."""
    nats = np.maximum(rows["nats"], LEAST_NATS)
    low = np.maximum(rows["low"], LEAST_NATS)
    y = np.arange(len(rows))
    ax.hlines(y, low, nats, color=GREY, lw=1)
    ax.plot(nats, y, "o", ms=4, color=PALETTE[0])
    for start in np.flatnonzero(rows["axis"].ne(rows["axis"].shift()))[1:]:
        ax.axhline(start - 0.5, color="0.85", lw=0.6)
    names = [label(row["axis"], row["value"]) for row in rows.to_dict("records")]
    ax.set_yticks(y, [fill(name, 28) for name in names])
    _log_axis(ax, low.min() / 2, nats.max() * 2)
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlabel="Most information per trial (nats)")


def draw_trials(ax: Axes, sequential: pd.DataFrame) -> None:
    """Draw predicted and simulated numbers of trials, for either model being true."""
    known = np.isfinite(sequential["median"])
    if known.any():
        ends = sequential.loc[known, ["low", "high", "simulated_median"]]
        _log_axis(ax, ends.min().min() / 2, ends.max().max() * 2)
    else:
        ax.set_xticks([])
    for y, row in enumerate(sequential.to_dict("records")):
        style: dict[str, Any] = {"color": PALETTE[y % len(PALETTE)]}
        if known.iloc[y]:
            ax.hlines(y, row["low"], row["high"], lw=2, **style)
            ax.plot(row["median"], y, "o", ms=5, **style)
            ax.plot(row["simulated_median"], y, "kx", ms=6)
        else:
            text = f"more than {row['low']:,.0f}" if np.isfinite(row["low"]) else "no number"
            ax.text(0.03, y, text, transform=ax.get_yaxis_transform(), va="center", fontsize=7)
    names = [fill(f"{name} true", 24) for name in sequential["truth"]]
    ax.set_yticks(range(len(sequential)), names)
    ax.set(ylim=(len(sequential) - 0.5, -0.5), xlabel=f"Trials until a Bayes factor of {FACTOR:g}")


def _log_axis(ax: Axes, *ends: float) -> None:
    """Give a logarithmic axis ticks at 1, 2 and 5, or at 1 if it is wide."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    low, high = ends
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    subs = (1,) if high > WIDE * low else (1, 2, 5)
    ax.xaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.minorticks_off()
