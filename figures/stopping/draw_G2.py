"""Figure G2: inhibition functions and failed stops of circuit, observer, race and people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, key, letter, say_if_older, where

RACE = "race"
DECIDERS: dict[str, dict[str, Any]] = {
    "circuit, 1 nat": {"color": "C0", "fmt": "o", "label": "circuit, 1 nat to STN"},
    "circuit, 0.3 nats": {"color": "C4", "fmt": "s", "label": "circuit, 0.3 nats"},
    "ideal observer": {"color": "C2", "fmt": "^-", "label": "ideal observer"},
}
"""Look of each model."""
LIKE_RACE: dict[str, Any] = {"color": "0.5", "lw": 1.2, "zorder": 0}
COMPARED = {"circuit": ("C0", "o"), "ideal observer": ("C2", "^"), "extra channel": ("C3", "v")}
MEASURES = (
    ("a  inhibition function", "p_respond", "share of stop trials answered"),
    ("b  stop-signal reaction time", "ssrt_ms", "SSRT by integration (ms)"),
)


def draw(settings: Settings, functions: Path, people: Path, tones: Path, *, output: Path) -> Figure:
    """Draw the models over the delay, the people over z, and the effect of common input."""
    table, seen, tone = read_table(functions), read_table(people), read_table(tones)
    figure, axes = plt.subplots(2, 3, figsize=(7.4, 4.9))
    for ax, (title, name, label) in zip(axes[0], MEASURES, strict=False):
        _models(ax, table, name)
        ax.set(ylabel=label, xlabel="stop-signal delay (ms)")
        letter(ax, title)
    axes[0, 1].set(ylim=(-10, 290))
    _failed(axes[0, 2], table)
    letter(axes[0, 2], "c  failed stops")
    _people(axes[1, 0], seen, "p_respond", "p_race")
    rows = where(table, decider="circuit, 1 nat")
    axes[1, 0].plot(relative(rows), rows["p_respond"], "o", ms=3, color="C0")
    axes[1, 0].set(xlim=(-1.6, 1.8), ylim=(0, 1), ylabel="share of stop trials answered")
    letter(axes[1, 0], "d  people")
    _people(axes[1, 1], seen, "failed_minus_go_ms", "race_minus_go_ms")
    axes[1, 1].axhline(0, color="0.8", lw=0.8, zorder=0)
    axes[1, 1].set(xlim=(-1.6, 1.8), ylabel="failed stops minus go (ms)")
    letter(axes[1, 1], "e  failed stops of people")
    _tones(axes[1, 2], tone)
    letter(axes[1, 2], "f  four alternatives")
    key(figure, axes[0, 0], axes[1, 0], axes[1, 2], ncols=4)
    say_if_older(figure, functions, tones)
    return figure


def relative(rows: pd.DataFrame) -> pd.Series:
    """Return z of each delay: (SSD + SSRT - median go time) / sd of go times."""
    ssrt = rows["ssrt_ms"].mean()
    z: pd.Series = (rows["ssd_ms"] + ssrt - rows["go_median_ms"]) / rows["go_sd_ms"]
    return z


def _models(ax: Axes, table: pd.DataFrame, name: str) -> None:
    for decider, style in DECIDERS.items():
        rows = where(table, decider=decider)
        bars(ax, rows["ssd_ms"], rows, name, ms=3, lw=0.9, **style)
    rows = where(table, decider=RACE)
    ax.plot(rows["ssd_ms"], rows[name], label="independent race", **LIKE_RACE)


def _failed(ax: Axes, table: pd.DataFrame) -> None:
    """Show the mean time of failed stops minus that of go trials."""
    for decider, style in DECIDERS.items():
        rows = where(table, decider=decider)
        look = {k: v for k, v in style.items() if k != "label"}
        late = rows["failed_ms"] - rows["go_ms"]
        ax.errorbar(rows["ssd_ms"], late, 1.96 * rows["failed_se"], ms=3, lw=0.9, **look)
    rows = where(table, decider=RACE)
    ax.plot(rows["ssd_ms"], rows["failed_ms"] - rows["go_ms"], **LIKE_RACE)
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    ax.set(xlabel="stop-signal delay (ms)", ylabel="failed stops minus go (ms)")


def _people(ax: Axes, seen: pd.DataFrame, name: str, race: str) -> None:
    bars(ax, seen["z"], seen, name, fmt="D", ms=3, lw=0.9, color="k", label="people")
    ax.plot(seen["z"], seen[race], "--", label="race, people's go times", color="k", lw=1)
    ax.set_xlabel("(SSD + SSRT - median go) / sd of go")


def _tones(ax: Axes, rows: pd.DataFrame) -> None:
    """Show p(respond) over the input common to all channels."""
    for k, (name, (colour, mark)) in enumerate(COMPARED.items()):
        part = where(rows, compared=name)
        look: dict[str, Any] = {"color": colour, "fmt": f"{mark}-", "ms": 3, "lw": 0.9}
        if name == "extra channel":
            look["label"] = "stop as one more channel"
        bars(ax, part["common_nats"] + 0.04 * (k - 1), part, "p_respond", **look)
    went = where(rows, compared="extra channel")["p_go"]
    ax.axhline(went.iloc[0], color="C3", lw=0.8, ls=":")
    ax.annotate("without a signal", (0, went.iloc[0]), (0, 3), fontsize=7,
                textcoords="offset points", ha="left", color="C3")  # fmt: skip
    ax.set(xlabel="common input (nats)", ylim=(0, 1.03))
    ax.set_ylabel("share of stop trials answered")
