"""Figure B4: Hick's law, speed-accuracy trade-off, quantiles, and taps with N alternatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, letter, run, say_if_older, where

DECIDERS = {
    "MSPRT": ("MSPRT", "C0", "o"),
    "population": ("circuit, populations", "C1", "s"),
    "ensemble": ("circuit, spikes", "C3", "^"),
}
"""Label, colour and marker of each model."""
AT_GAIN = "MSPRT at its gain"
CENTRED = "population, mean subtracted"
GAUSSIAN = "Gaussian, d' 0.5"
ACCURACY = 0.95
SHADES = {2: "C0", 4: "C2", 8: "C4"}
"""Colours by alternatives."""
KINDS = {"grating, 2 mm": ":", "grating, 2.5 mm": "--", "real taps, edge 5 degrees": "-"}
"""Line style of each kind of taps."""
QUANTILES = (10, 30, 50, 70, 90)


def draw(
    settings: Settings,
    times: Path,
    lines: Path,
    quantiles: Path,
    criteria: Path,
    calibration: Path,
    *,
    output: Path,
) -> Figure:
    """Draw times by alternatives, accuracy by time, quantiles, and taps."""
    every = read_table(times)
    figure, axes = plt.subplots(2, 3, figsize=(7.6, 5.4))
    _hick(axes[0, 0], every, read_table(lines))
    _tradeoff(axes[0, 1], every)
    _quantiles(axes[0, 2], read_table(quantiles))
    _taps(axes[1, 0], every)
    _errors(axes[1, 1], read_table(criteria))
    _calibration(axes[1, 2], read_table(calibration))
    letter(axes[0, 0], "a  Hick's law")
    letter(axes[0, 1], "b  speed and accuracy")
    letter(axes[0, 2], "c  quantiles, two alternatives")
    letter(axes[1, 0], "d  taps")
    letter(axes[1, 1], "e  errors of the test on taps")
    letter(axes[1, 2], "f  calibration of taps")
    say_if_older(figure, times)
    return figure


def _hick(ax: Any, times: pd.DataFrame, lines: pd.DataFrame) -> None:
    """Show mean times over the logarithm of the number, with fitted lines."""
    some = where(times, evidence=GAUSSIAN, accuracy=ACCURACY)
    for name, (label, colour, mark) in DECIDERS.items():
        rows = where(some, decider=name).dropna(subset=["time_ms"])
        _points(ax, rows["alternatives"], rows, colour, mark, label)
        fit = where(lines, decider=name, accuracy=ACCURACY, of="time_ms")
        if len(fit) and name != "ensemble":
            x = np.array([rows["alternatives"].min(), rows["alternatives"].max()])
            y = fit["intercept_ms"].iloc[0] + fit["slope_ms"].iloc[0] * np.log(x)
            ax.plot(x, y / 1000, color=colour, lw=0.9)
    ax.set_xscale("log")
    ax.set_xticks([2, 3, 4, 6, 8, 12, 20], ["2", "3", "4", "6", "8", "12", "20"])
    ax.minorticks_off()
    ax.set(xlabel="alternatives N (logarithmic)", ylabel="mean time at accuracy 0.95 (s)")
    ax.legend(loc="upper left")


def _points(
    ax: Any, x: Any, rows: pd.DataFrame, colour: str, mark: str, label: str | None = None
) -> None:
    """Show mean times with their intervals, s."""
    style: dict[str, Any] = {"color": colour, "marker": mark, "label": label}
    bars(ax, x, rows, "time_ms", unit=1000, ms=3.5, ls="", lw=1, **style)


def _tradeoff(ax: Any, times: pd.DataFrame) -> None:
    """Show accuracy over mean time, by alternatives."""
    some = where(times, evidence=GAUSSIAN).dropna(subset=["time_ms"])
    for count, colour in SHADES.items():
        for name, (_, _, mark) in DECIDERS.items():
            rows = where(some, decider=name, alternatives=count)
            line = "-" if name == "MSPRT" else ""
            ax.plot(
                rows["time_ms"] / 1000, rows["accuracy"], color=colour, ls=line, lw=1,
                marker="" if line else mark, ms=3.5, mfc="none",
            )  # fmt: skip
        ax.plot([], [], color=colour, label=f"N = {count}")
    for name in ("population", "ensemble"):
        label, _, mark = DECIDERS[name]
        ax.plot([], [], color="0.3", marker=mark, ms=3.5, mfc="none", ls="", label=label)
    ax.set(xlabel="mean time (s)", ylabel="accuracy", ylim=(0.45, 1.0))
    ax.legend(loc="lower right")


def _quantiles(ax: Any, table: pd.DataFrame) -> None:
    """Show RT quantiles of correct and error responses against the response's probability."""
    some = where(table, alternatives=2)
    names = {AT_GAIN: ("MSPRT at its gain", "C0", "o")} | {
        name: DECIDERS[name] for name in ("population", "ensemble")
    }
    for name, (label, colour, mark) in names.items():
        rows = where(some, decider=name).sort_values("share")
        for q in QUANTILES:
            known = rows.dropna(subset=[f"q{q}_ms"])
            line = "-" if name == AT_GAIN else ""
            ax.plot(
                known["share"], known[f"q{q}_ms"] / 1000, color=colour, ls=line, lw=0.8,
                marker="" if line else mark, ms=3, mfc="none",
                label=label if q == QUANTILES[0] else None,
            )  # fmt: skip
    ax.axvline(0.5, color="0.8", lw=0.8)
    ax.text(0.49, 0.99, "wrong", ha="right", va="top", fontsize=7, transform=ax.transAxes)
    ax.text(0.51, 0.99, "right", ha="left", va="top", fontsize=7, transform=ax.transAxes)
    ax.set(xlabel="probability of the response", ylabel="time, quantiles 0.1 to 0.9 (s)")
    ax.set(xlim=(0, 1), ylim=(0, 1.1 * ax.get_ylim()[1]))


def _taps(ax: Any, times: pd.DataFrame) -> None:
    """Show mean times on taps by alternatives, for the test and the circuit."""
    some = where(times, accuracy=ACCURACY).dropna(subset=["time_ms"])
    looks = {"MSPRT": ("C0", "o"), "population": ("C1", "s"), CENTRED: ("C1", "D")}
    for k, (kind, line) in enumerate(KINDS.items()):
        for name, (colour, mark) in looks.items():
            rows = where(some, evidence=kind, decider=name)
            x = rows["alternatives"] * 1.04 ** (k - 1)
            _points(ax, x, rows, colour, mark)
            ax.plot(x, rows["time_ms"] / 1000, color=colour, lw=0.9, ls=line)
    for kind, line in KINDS.items():
        ax.plot([], [], color="0.3", ls=line, lw=0.9, label=kind.replace(" 5 degrees", " 5°"))
    for name, (colour, mark) in looks.items():
        label = name.replace(", mean", ",\nmean")
        ax.plot([], [], color=colour, marker=mark, ls="", ms=3.5, label=label)
    ax.set(
        xscale="log", yscale="log", xlabel="alternatives N", ylabel="mean time at accuracy 0.95 (s)"
    )
    ax.set_xticks([2, 4, 8], ["2", "4", "8"])
    ax.set_yticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
    ax.minorticks_off()
    ax.set_ylim(0.5, 60)
    ax.legend(loc="upper left", fontsize=6)


def _errors(ax: Any, table: pd.DataFrame) -> None:
    """Show the share of errors against that allowed by the criterion."""
    for count, colour in SHADES.items():
        for kind, line in KINDS.items():
            rows = where(table, alternatives=count, evidence=kind)
            rows = rows[rows["accuracy"] < 1]  # the axes are logarithmic
            ax.plot(1 - rows["criterion"], 1 - rows["accuracy"], color=colour, ls=line, lw=1)
        ax.plot([], [], color=colour, label=f"N = {count}")
    ends = np.array([0.008, 0.45])
    ax.plot(ends, ends, color="0.5", lw=0.8)
    ax.fill_between(ends, ends, 1, color="0.9", lw=0)
    ax.set(xscale="log", yscale="log", xlim=ends, ylim=(1e-3, 0.5))
    ax.set(xlabel="errors allowed, 1 − P", ylabel="errors made")
    ax.legend(loc="upper left", ncols=3, columnspacing=1, handlelength=1.2)


def _calibration(ax: Any, table: pd.DataFrame) -> None:
    """Show the share correct against the posterior of the most probable alternative."""
    for count, colour in SHADES.items():
        for kind, line in KINDS.items():
            rows = where(table, alternatives=count, evidence=kind)
            style: dict[str, Any] = {"color": colour, "ls": line, "lw": 1, "elinewidth": 0.7}
            bars(ax, rows["posterior"], rows, "right", **style)
    ax.plot([0, 1], [0, 1], color="0.5", lw=0.8)
    ax.set(xlabel="highest posterior", ylabel="share correct", xlim=(0.2, 1.02), ylim=(0.2, 1.02))


if __name__ == "__main__":
    run(draw=draw)
