"""Figure R1: the same test on real taps of an edge."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.files import read_table, write_table
from bgmodel.learning.reinforce import exhaustive_search
from bgmodel.plots import speed_accuracy
from bgmodel.tactile.decoder import EDGE, train
from bgmodel.tactile.likelihood import Pool, fit_likelihood
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.recordings import read_taps
from bgmodel.tactile.task import Source
from figures.common import Settings, letter, run

# A 40 mm tip spans about 122 px of the 128; only the scale of displacements hangs on it.
MM_PER_PX = 0.33
DIFFERENCES_DEG = (2.0, 5.0, 10.0)
TOLERANCE_DEG = 0.5
T_MAX = 30


def compute(settings: Settings, recordings: Path, *, output: Path) -> None:
    """Decode held-out real taps, and decide on them."""
    taps = decoded(settings.seed, recordings)
    error_sd = wrapped(taps[:, 1] - taps[:, 0], 360).std()
    table = decide(settings, taps).assign(error_sd_deg=error_sd)
    write_table(table, output, seed=settings.seed, settings=settings, recordings=recordings.name)


def decoded(seed: int, recordings: Path) -> np.ndarray:
    """Return true and read yaw of held-out real taps, (taps, 2) degrees; trains the decoder."""
    taps = read_taps(recordings / "csv_train", mm_per_px=MM_PER_PX)
    decoder = train(taps, seed=seed, training=EDGE)
    held = read_taps(recordings / "csv_val", mm_per_px=MM_PER_PX, rest=taps.rest_mm)
    return np.stack([held.labels["yaw_deg"], decoder.decode(held)["edge_deg"]], axis=1)


def halves(seed: int, taps: np.ndarray) -> list[np.ndarray]:
    """Return two halves at random: tables of recordings are sorted by yaw."""
    order = stream(seed, "figR1", "halves").permutation(len(taps))
    return np.array_split(taps[order], 2)


def decide(settings: Settings, taps: np.ndarray) -> pd.DataFrame:
    """Decide same or different from pairs of taps (taps, 2: true and read yaw), on two halves."""
    parts = []
    for difference in DIFFERENCES_DEG:
        for half, readings in enumerate(sources(halves(settings.seed, taps), difference)):
            scores = _score(settings, readings, stream(settings.seed, "figR1", difference, half))
            parts.append(scores.assign(difference_deg=difference, half=half))
    return pd.concat(parts)


def sources(parts: list[np.ndarray], difference: float) -> list[Source]:
    """Return the readings of each half of the taps, with likelihoods fitted on the other half."""

    def from_pairs(pool: Pool) -> list[np.ndarray]:
        return pairs(difference, pool[0])

    made = []
    for scored, fitted in (parts, parts[::-1]):
        likelihood = fit_likelihood([fitted], from_pairs, (-180.0, 180.0))
        logs = [likelihood(x) for x in pairs(difference, scored)]
        made.append(Source(logs, ("same", "different"), likelihood))
    return made


def pairs(difference: float, taps: np.ndarray) -> list[np.ndarray]:
    """Return decoded differences of real pairs: true difference about 0 (S1), or as given (S2)."""
    true = wrapped(taps[None, :, 0] - taps[:, None, 0], 360)
    read = wrapped(taps[None, :, 1] - taps[:, None, 1], 360)
    other = ~np.eye(len(taps), dtype=bool)
    return [read[other & (np.abs(true - d) < TOLERANCE_DEG)] for d in (0.0, difference)]


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
            style = {"color": f"C{i}", "ls": "-" if half else "--"}
            style["label"] = f"{difference:g}°" if half else None
            speed_accuracy(ax, rows["mean_steps"], rows["accuracy"], **style)
    sd = table["error_sd_deg"].iloc[0]
    ax.set(xlabel="mean decision time (taps of each interval)", ylim=(0.45, 1.02))
    ax.legend(title="edge yaw difference, between real taps (±0.5°)", loc="lower right", ncols=3)
    letter(ax, f"real TacTip taps on an edge, decoder error sd {sd:.1f}°")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
