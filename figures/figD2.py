"""Figure D2: dopamine moves the threshold: level to posterior, and speed to accuracy."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.comparison.thresholds import MSPRT
from bgmodel.integrators.basal_ganglia import gain_of
from bgmodel.learning.dopamine import (
    THRESHOLD_NATS,
    levels_between,
    stopping_posterior,
    working_range,
)
from bgmodel.learning.dopamine_levels import levels_against_msprt
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from figures.common import Settings, letter, run

COLOURS = {2: "C0", 4: "C1"}
EARLY = 0.02
"""Share of responses before the first reading above which noise is said to decide."""
ENGINES = (("rate", "o", "rates"), ("population", "d", "with noise"), ("ensemble", "s", "spikes"))


def compute(settings: Settings, *, output: Path) -> None:
    """Let all circuits decide at levels across their working range, N = 2 and 4."""
    trials, every = settings.circuit_trials // 2, settings.spiking_levels
    found = levels_against_msprt(settings.seed, trials, every)
    write_table(found, output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the map, the speed-accuracy curve, and accuracy beside the MSPRT's in equal time.

    Lines in the map are the fixed point. Levels at which more than 2 % of responses come before
    the first reading are crossed out: there noise decides.
    """
    table = read_table(data)
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.8))
    for channels, colour in COLOURS.items():
        rows = table[table["channels"] == channels]
        _map(axes[0], rows, channels, colour)
        _tradeoff(axes[1], rows, colour)
        _gap(axes[2], rows, colour)
    axes[0].axhspan(0.75, 0.99, color="0.95", zorder=0)
    axes[0].set(xlabel="dopamine (1: normal)", ylabel="posterior of what is chosen", xscale="log")
    axes[0].set_xticks([0.6, 0.8, 1, 1.25, 1.6, 2], ["0.6", "0.8", "1", "1.25", "1.6", "2"])
    axes[0].minorticks_off()
    if (table.loc[table["measure"] == "premature", "value"] > EARLY).any():
        axes[0].plot([], [], "kx", ms=6, mew=0.8, label="noise decides")
    axes[1].set(xlabel="mean time (s)", ylabel="expected accuracy", xlim=(0, 5), ylim=(0.5, 1.0))
    axes[2].axhspan(-0.01, 0.01, color="0.93", zorder=0)
    axes[2].axhline(0, lw=0.8, color="0.6")
    axes[2].set(
        xlabel="posterior of what is chosen",
        ylabel="accuracy minus the MSPRT's\nin equal time",
    )
    titles = ("a  dopamine to posterior", "b  speed and accuracy", "c  beside the MSPRT")
    for ax, title in zip(axes, titles, strict=True):
        letter(ax, title)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, columnspacing=1.4)
    return figure


def _points(rows: pd.DataFrame, engine: str, measure: str) -> pd.DataFrame:
    found = rows[(rows["engine"] == engine) & (rows["measure"] == measure)]
    return found[found["reference"].isin(["", MSPRT])].set_index("level")


def _map(ax: Axes, rows: pd.DataFrame, channels: int, colour: str) -> None:
    table = load_circuit(DEFAULT, channels)
    low, high = working_range(table, THRESHOLD_NATS)
    levels = levels_between(low * 1.001, high * 0.999, 24)
    exact = [stopping_posterior(table, level, THRESHOLD_NATS, gain_of(table)) for level in levels]
    ax.plot(
        levels, exact, lw=0.8, color=colour, label=f"N = {channels}: fixed point (a), MSPRT (b)"
    )
    for engine, mark, name in ENGINES:
        points = _points(rows, engine, "mean_posterior")
        off = [points["value"] - points["low"], points["high"] - points["value"]]
        ax.errorbar(
            points.index,
            points["value"],
            off,
            fmt=mark,
            ms=3,
            lw=0.6,
            color=colour,
            mfc=colour if mark == "s" else "w",
            label=name if channels == 2 else None,
        )
        early = _points(rows, engine, "premature")["value"] > EARLY
        ax.plot(points.index[early], points["value"][early], "x", ms=6, color="k", mew=0.8)


def _tradeoff(ax: Axes, rows: pd.DataFrame, colour: str) -> None:
    line = rows[(rows["measure"] == "curve") & (rows["reference"] == MSPRT)]
    ax.plot(line["value"] / 1000, line["level"], lw=0.8, color=colour)
    for engine, mark, _ in ENGINES:
        time, known = (_points(rows, engine, name) for name in ("mean_ms", "mean_posterior"))
        face = colour if mark == "s" else "w"
        ax.plot(time["value"] / 1000, known["value"], mark, ms=3, color=colour, mfc=face)


def _gap(ax: Axes, rows: pd.DataFrame, colour: str) -> None:
    for engine, mark, _ in ENGINES:
        gap, known = (_points(rows, engine, name) for name in ("accuracy_gap", "mean_posterior"))
        off = [gap["value"] - gap["low"], gap["high"] - gap["value"]]
        face = colour if mark == "s" else "w"
        ax.errorbar(
            known["value"], gap["value"], off, fmt=mark, ms=3, lw=0.6, color=colour, mfc=face
        )


if __name__ == "__main__":
    run(compute=compute, draw=draw)
