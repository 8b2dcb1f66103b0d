"""Figure R1: the same test on real taps of an edge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.learning.reinforce import exhaustive_search
from bgmodel.plots import speed_accuracy
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.edges import decoded_yaw, halves, sources
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.task import Source
from figures.common import Settings, letter, run

DIFFERENCES_DEG = (2.0, 5.0, 10.0)
T_MAX = 30


def compute(settings: Settings, recordings: Path, *, output: Path) -> None:
    """Decode held-out real taps, and decide on them."""
    taps = decoded_yaw(settings.seed, recordings)
    error_sd = wrapped(taps[:, 1] - taps[:, 0], 360).std()
    table = decide(settings, taps).assign(error_sd_deg=error_sd)
    write_table(table, output, seed=settings.seed, settings=settings, recordings=recordings.name)


def decide(settings: Settings, taps: np.ndarray) -> pd.DataFrame:
    """Decide same or different from pairs of taps (taps, 2: true and read yaw), on two halves."""
    parts = []
    for difference in DIFFERENCES_DEG:
        for half, readings in enumerate(sources(halves(settings.seed, taps), (0.0, difference))):
            scores = _score(settings, readings, stream(settings.seed, "figR1", difference, half))
            parts.append(scores.assign(difference_deg=difference, half=half))
    return pd.concat(parts)


def _score(settings: Settings, readings: Source, rng: np.random.Generator) -> pd.DataFrame:
    evidence = readings.draw(settings.sweep_trials, T_MAX, rng=rng)
    counts = exhaustive_search(evidence, settings.deltas)
    return pd.DataFrame(
        {
            "delta": settings.deltas,
            "accuracy": counts.accuracy,
            "mean_steps": counts.mean_steps,
            "pairs": min(len(x) for x in readings.log_likelihood),
        }
    )


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw accuracy against mean taps, a line for each half of the taps scored on."""
    table = read_table(data)
    figure, ax = plt.subplots(figsize=(4.2, 3.0))
    for i, difference in enumerate(DIFFERENCES_DEG):
        here = table[table["difference_deg"] == difference]
        for half, rows in here.groupby("half"):
            style: dict[str, Any] = {"color": f"C{i}", "ls": "-" if half else "--"}
            style["label"] = f"{difference:g}°" if half else None
            speed_accuracy(ax, rows["mean_steps"], rows["accuracy"], **style)
    sd = table["error_sd_deg"].iloc[0]
    ax.set(xlabel="mean decision time (taps of each interval)", ylim=(0.45, 1.02))
    ax.plot([], [], color="0.8", lw=0.8, label="chance")
    for half, ls in enumerate(("--", "-")):
        ax.plot([], [], color="0.4", ls=ls, label=f"scored on half {half + 1} of the taps")
    ax.legend(
        title="difference of the edge's yaw (±0.5°)",
        loc="lower right",
        bbox_to_anchor=(1, 0.12),
        ncols=2,
    )
    letter(ax, f"real TacTip taps on an edge, decoder error sd {sd:.1f}°")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
