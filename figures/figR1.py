"""Figure R1: the sequential test on real taps of an edge."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.learning.reinforce import exhaustive_search
from bgmodel.plots import speed_accuracy
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.edges import decoded_edges
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.source import Source, folds
from bgmodel.tactile.task import EdgeTurn
from figures.common import Settings, letter, run

DIFFERENCES_DEG = (2.0, 5.0, 10.0)
T_MAX = 30


def compute(settings: Settings, recordings: Path, *, output: Path) -> None:
    """Decode held-out real taps, and make decisions from them."""
    taps = decoded_edges(settings.seed, recordings)
    error_sd = wrapped((taps["edge_deg"] - taps["yaw_deg"]).to_numpy(), 360).std()
    table = decide(settings, taps).assign(error_sd_deg=error_sd)
    write_table(table, output, seed=settings.seed, settings=settings, recordings=recordings.name)


def decide(settings: Settings, taps: pd.DataFrame) -> pd.DataFrame:
    """Decide same or different from pairs of decoded taps, on each fold of the taps."""
    parts = []
    for difference in DIFFERENCES_DEG:
        for fold, readings in enumerate(folds(taps, EdgeTurn(2, difference)).sources):
            scores = _score(settings, readings, stream(settings.seed, "figR1", difference, fold))
            parts.append(scores.assign(difference_deg=difference, fold=fold))
    return pd.concat(parts)


def _score(settings: Settings, readings: Source, rng: np.random.Generator) -> pd.DataFrame:
    evidence = readings.draw(settings.sweep_trials, T_MAX, rng=rng)
    counts = exhaustive_search(evidence, settings.separations)
    return pd.DataFrame(
        {
            "boundary_separation": settings.separations,
            "accuracy": counts.accuracy,
            "mean_steps": counts.mean_steps,
            "pairs": min(len(x) for x in readings.log_likelihood),
        }
    )


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw accuracy against mean taps: the mean and range over folds of taps."""
    table = read_table(data)
    figure, ax = plt.subplots(figsize=(4.2, 3.0))
    for i, difference in enumerate(DIFFERENCES_DEG):
        by_fold = table[table["difference_deg"] == difference].groupby("boundary_separation")
        mean = by_fold[["mean_steps", "accuracy"]].mean()
        speed_accuracy(
            ax, mean["mean_steps"], mean["accuracy"], color=f"C{i}", label=f"{difference:g}°"
        )
        ends = by_fold["accuracy"].agg(["min", "max"])
        ax.fill_between(mean["mean_steps"], ends["min"], ends["max"], color=f"C{i}", alpha=0.2)
    sd = table["error_sd_deg"].iloc[0]
    ax.set(xlabel="mean decision time (taps of each interval)", ylim=(0.45, 1.02))
    ax.plot([], [], color="0.8", lw=0.8, label="chance")
    ax.legend(
        title="difference of the edge's yaw (±0.5°)", loc="lower right", bbox_to_anchor=(1, 0.12)
    )
    letter(ax, f"real TacTip taps on an edge, decoder error SD {sd:.1f}°")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
