"""Figure 2b: from the state of the world to a response, and evidence accumulation to a bound."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel import Sprt, first_crossing, stream
from bgmodel.learning.gap import fold_sources
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import Source
from circuits.arrays import Array
from figures.common import Settings, letter

PERIOD_MM, GAP, SHOWN = 2.0, 4.0, 24


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Follow some trials of one grating."""
    table = follow(fold_sources(read_table(taps), PERIOD_MM)[0], settings)
    write_table(table, output, seed=settings.seed, settings=settings, gap=GAP, period_mm=PERIOD_MM)


def follow(readings: Source, settings: Settings, trials: int = 2000) -> pd.DataFrame:
    """Return one row per trial and reading: Z, with the trial's truth, choice and steps."""
    evidence = readings.draw(trials, settings.t_max, rng=stream(settings.seed, "fig2b"))
    trace = Sprt().run(evidence)
    decision = first_crossing(trace, float(Sprt.threshold(GAP)))
    z = trace.out_nats[..., 0]  # OUT of R1 is Z itself
    assert evidence.truth is not None
    trial, step = np.indices(z.shape)
    table = pd.DataFrame({"trial": trial.ravel(), "step": step.ravel(), "z": z.ravel()})
    table["truth"] = evidence.truth[table["trial"]]
    table["choice"] = decision.choice[table["trial"]]
    table["steps"] = decision.steps[table["trial"]]
    return table


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the mapping of states to responses, and trajectories of both states."""
    table = read_table(data)
    figure, axes = plt.subplots(1, 2, figsize=(6.2, 2.7), width_ratios=[1, 1.7])
    first = table[table["step"] == 0]
    counts = pd.crosstab(first["truth"], first["choice"], normalize="index").to_numpy()
    axes[0].imshow(counts, cmap="Blues", vmin=0, vmax=1)
    for (i, j), share in np.ndenumerate(counts):
        axes[0].text(
            j, i, f"{share:.2f}", ha="center", va="center", color="k" if share < 0.6 else "w"
        )
    axes[0].set(xticks=[0, 1], yticks=[0, 1], xticklabels=["R1", "R2"], xlabel="response")
    axes[0].set_yticklabels(["S1 (AA)", "S2 (AB)"])
    axes[0].spines[:].set_visible(False)
    count = f"{len(first):,}".replace(",", " ")
    letter(axes[0], f"share of responses, {count} trials")
    for truth, colour in ((0, "C0"), (1, "C1")):
        some = table[(table["truth"] == truth) & (table["trial"] < 2 * SHOWN)]
        z = some.pivot(index="trial", columns="step", values="z").to_numpy()
        steps = some.groupby("trial")["steps"].first().to_numpy()
        trajectories(axes[1], z, steps, colour)
        axes[1].plot([], [], color=colour, label=f"S{truth + 1} ({'AA' if truth == 0 else 'AB'})")
    axes[1].axhline(0, color="0.8", lw=0.8, zorder=0)
    axes[1].plot([], [], "o", ms=2.5, color="0.4", label="decision")
    axes[1].plot([], [], color="k", lw=0.8, label="bounds")
    low, high = axes[1].get_ylim()
    axes[1].set_ylim(low, high + 0.2 * (high - low))
    axes[1].legend(loc="upper right", ncols=4, columnspacing=1, handlelength=1.2)
    letter(axes[1], f"evidence of {2 * SHOWN} trials, {PERIOD_MM:g} mm, gap δ = {GAP:g} nats")
    return figure


def trajectories(ax: Axes, z: Array, steps: Array, colour: str) -> None:
    """Draw evidence Z (trials, 1 + readings), each until its decision, with both bounds."""
    for path, stop in zip(z, steps.astype(int), strict=True):
        ax.plot(np.arange(stop + 1), path[: stop + 1], color=colour, lw=0.7, alpha=0.8)
        ax.plot(stop, path[stop], "o", ms=2.5, color=colour)
    for bound in (-GAP / 2, GAP / 2):
        ax.axhline(bound, color="k", lw=0.8)
    ax.set(xlabel="readings", ylabel="evidence Z (nats)")
