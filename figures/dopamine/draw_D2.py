"""Figure D2: dopamine sets the threshold: posterior by level, and speed-accuracy trade-off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.comparison.thresholds import MSPRT
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.dopamine import (
    THRESHOLD_NATS,
    levels_against_msprt,
    stopping_posterior,
    working_range,
)
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from figures.common import Settings, bars, key, letter, where

COLOURS = {2: "C0", 4: "C1"}
EARLY = 0.02
"""Share of responses before the first reading above which decisions are attributed to noise."""
ENGINES = (("rate", "o", "rates"), ("population", "d", "with noise"), ("spikes", "s", "spikes"))


def compute(settings: Settings, *, output: Path) -> None:
    """Run decisions of all circuits at levels across their working range, N = 2 and 4."""
    trials, every = settings.circuit_trials // 2, settings.spiking_levels
    compared = levels_against_msprt(settings.seed, trials, every)
    write_table(compared, output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the map, the speed-accuracy curve, and accuracy relative to the MSPRT at equal time.

    Lines in the map are the fixed point. Levels at which more than 2 % of responses come before
    the first reading are crossed out, because there decisions are made by noise.
    """
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.8))
    for channels, colour in COLOURS.items():
        rows = where(table, channels=channels)
        _map(axes[0], rows, channels, colour)
        _tradeoff(axes[1], rows, colour)
        _gap(axes[2], rows, colour)
    axes[0].axhspan(0.75, 0.99, color="0.95", zorder=0)
    axes[0].set(xlabel="dopamine (1: normal)", ylabel="posterior of the choice", xscale="log")
    axes[0].set_xticks([0.6, 0.8, 1, 1.25, 1.6, 2], ["0.6", "0.8", "1", "1.25", "1.6", "2"])
    axes[0].minorticks_off()
    if (table.loc[table["measure"] == "premature", "value"] > EARLY).any():
        axes[0].plot([], [], "kx", ms=6, mew=0.8, label="decided by noise")
    axes[1].set(xlabel="mean time (s)", ylabel="expected accuracy", xlim=(0, 5), ylim=(0.5, 1.0))
    axes[2].axhspan(-0.01, 0.01, color="0.93", zorder=0)
    axes[2].axhline(0, lw=0.8, color="0.6")
    axes[2].set_xlabel("posterior of the choice")
    axes[2].set_ylabel("accuracy minus the MSPRT's\nat equal time")
    titles = ("a  dopamine to posterior", "b  speed and accuracy", "c  versus the MSPRT")
    for ax, title in zip(axes, titles, strict=True):
        letter(ax, title)
    key(figure, axes[0], ncols=6, columnspacing=1.4)
    return figure


def _points(rows: pd.DataFrame, engine: str, measure: str) -> pd.DataFrame:
    points = where(rows, engine=engine, measure=measure)
    return points[points["reference"].isin(["", MSPRT])].set_index("level")


def _style(mark: str, colour: str) -> dict[str, Any]:
    """Return the look of an engine's marks; those of spikes are full."""
    face = colour if mark == "s" else "w"
    return {"marker": mark, "ls": "", "ms": 3, "color": colour, "mfc": face}


def _map(ax: Axes, rows: pd.DataFrame, channels: int, colour: str) -> None:
    table = load_circuit(DEFAULT, channels)
    low, high = working_range(table, THRESHOLD_NATS)
    levels = np.geomspace(low * 1.001, high * 0.999, 24)
    exact = [stopping_posterior(table, level, THRESHOLD_NATS, gain_of(table)) for level in levels]
    label = f"N = {channels}: fixed point (a), MSPRT (b)"
    ax.plot(levels, exact, lw=0.8, color=colour, label=label)
    for engine, mark, name in ENGINES:
        points = _points(rows, engine, "mean_posterior")
        named = name if channels == 2 else None
        bars(ax, points.index, points, lw=0.6, label=named, **_style(mark, colour))
        early = _points(rows, engine, "premature")["value"] > EARLY
        ax.plot(points.index[early], points["value"][early], "x", ms=6, color="k", mew=0.8)


def _tradeoff(ax: Axes, rows: pd.DataFrame, colour: str) -> None:
    line = where(rows, measure="curve", reference=MSPRT)
    ax.plot(line["value"] / 1000, line["level"], lw=0.8, color=colour)
    for engine, mark, _ in ENGINES:
        time, known = (_points(rows, engine, name) for name in ("mean_ms", "mean_posterior"))
        ax.plot(time["value"] / 1000, known["value"], **_style(mark, colour))


def _gap(ax: Axes, rows: pd.DataFrame, colour: str) -> None:
    for engine, mark, _ in ENGINES:
        gap, known = (_points(rows, engine, name) for name in ("accuracy_gap", "mean_posterior"))
        bars(ax, known["value"], gap, lw=0.6, **_style(mark, colour))
