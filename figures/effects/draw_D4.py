"""Figure D4: all built-in experiments: published results and the circuit's results.

Predictions and published numbers are in the experiments' files and were committed before the first
run. The results are those of the population engine on all trials of a file; results in spikes, with
fewer trials, come from a score's table.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bgmodel.experiments.expected import (
    AGREES,
    COMPATIBLE,
    DIFFERS,
    DISAGREES,
    OPEN,
    PERCENT,
    WITHOUT,
)
from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.experiments.outcomes import beside_published, outcomes
from bgmodel.support.files import read_table, write_table
from circuits.engines import engine_of
from figures.common import FULL, Settings, say_if_older, where

AGREE, NOT = "C2", "C1"
COLOUR = {AGREES: AGREE, COMPATIBLE: AGREE, DISAGREES: NOT, DIFFERS: NOT, WITHOUT: "C3"}
SHORT = {
    "mean_ms": "time", "anticipatory": "anticipation", "boundary_separation": "boundary",
    "mean_posterior": "posterior",
}  # fmt: skip
ARROWS = {"up": "↑", "down": "↓", "none": "="}
PANELS = {
    ("mean_ms", PERCENT): ("change of time, %", (-140.0, 420.0)),
    ("accuracy", "change"): ("change of accuracy", (-0.34, 0.23)),
}
"""Measures drawn for every experiment, and their axis limits."""
LINEAR_PERCENT = 20.0
"""The time axis is linear up to here, and logarithmic beyond."""
TICKS_PERCENT = (-100, -20, -10, 0, 10, 20, 100, 300)
SIZE = 6.0
PER_LINE = 2
"""Number of predictions per line."""


def compute(settings: Settings, spikes: Path, *, output: Path) -> None:
    """Run every experiment with populations; compare it and its spikes with published results."""
    in_spikes = read_table(spikes)
    parts = []
    for file, experiment in shipped().items():
        if experiment.stop is not None:
            continue  # figure G4
        share = settings.circuit_trials / FULL.circuit_trials
        # If only one truth counts, half of the trials remain.
        trials = max(round(share * experiment.task.trials), 240)
        one = replace(experiment, task=experiment.task.changed(trials=trials))
        by_engine = {
            "population": one.run().measures.assign(trials=trials),
            "spikes": where(in_spikes, file=file).drop(columns="file"),
        }
        source = one.source.rsplit(", ", 1)[0].removeprefix("derived from ")
        about = {"file": file, "name": one.name, "by": source, "seed": one.seed}
        for engine, measures in by_engine.items():
            known: dict[str, Any] = about | {"engine": engine, "trials": measures["trials"].iloc[0]}
            parts.append(_rows(one, measures).assign(**known))
    write_table(pd.concat(parts), output, settings=settings)


def _rows(experiment: Experiment, measures: pd.DataFrame) -> pd.DataFrame:
    """Return a row per panel, with the published number if there is one, and per prediction."""
    predictions = outcomes(experiment, measures).assign(kind="prediction")
    keys = pd.DataFrame(list(PANELS), columns=["measure", "condition"])
    drawn = keys.merge(measures, how="left", on=["measure", "condition"]).assign(kind="effect")
    held = beside_published(experiment, measures).drop(columns=["value", "low", "high"])
    drawn = drawn.merge(held, how="left", on=["measure", "condition"])
    return pd.concat([drawn.drop(columns="effect_source"), predictions])


def draw(settings: Settings, data: Path, spikes: Path, *, output: Path) -> Figure:
    """Draw a row per experiment: time, accuracy, and the predictions in words."""
    table = read_table(data)
    numbers = table["file"][table["published"].notna()].unique()
    files = [*numbers, *(file for file in table["file"].unique() if file not in numbers)]
    size = (8.2, 0.34 * len(files) + 0.9)
    figure, axes = plt.subplots(1, 2, sharey=True, figsize=size, width_ratios=(1.4, 1.0))
    for ax, ((measure, condition), (label, ends)) in zip(axes, PANELS.items(), strict=True):
        ax.axvline(0, lw=0.5, color="0.6", zorder=0)
        for k in range(len(files)):
            ax.axhline(k + 0.5, lw=0.3, color="0.85", zorder=0)
        rows = where(table, kind="effect", measure=measure, condition=condition)
        for row in rows.to_dict("records"):
            _marks(ax, files.index(row["file"]), row)
        ax.set(xlim=ends, ylim=(len(files) - 0.5, -0.5), yticks=[])
        ax.set_xlabel(label, fontsize=SIZE + 1)
        ax.tick_params(labelsize=SIZE)
    axes[0].set_xscale("symlog", linthresh=LINEAR_PERCENT)
    axes[0].set_xticks(TICKS_PERCENT, [f"{tick:+d}" if tick else "0" for tick in TICKS_PERCENT])
    axes[0].minorticks_off()
    for k, file in enumerate(files):
        _words(axes, k, where(table, file=file, engine="population"))
    axes[0].text(-0.02, -0.8, "experiment, source", **_at(axes[0], "right", weight="bold"))
    axes[1].text(1.03, -0.8, "predicted", **_at(axes[1], "left", weight="bold"))
    _key(figure)
    say_if_older(figure, spikes)
    return figure


def _at(ax: Axes, side: str, **more: Any) -> dict[str, Any]:
    """Return the coordinates of a text next to the panel, in its rows."""
    across = ax.get_yaxis_transform()
    return {"transform": across, "ha": side, "va": "center", "fontsize": SIZE, **more}


def _marks(ax: Axes, k: int, row: Mapping[Hashable, Any]) -> None:
    """Draw the published number at the top of a row, the model's below it."""
    spikes = engine_of(row["engine"]).spiking
    if not spikes and np.isfinite(row["published"]):
        _interval(ax, k - 0.22, row, "published", color="k", marker="s")
    colour = COLOUR.get(row["comparison"], "0.45")
    fill = {"markerfacecolor": "w"} if spikes else {}
    _interval(ax, k + (0.28 if spikes else 0.06), row, "value", color=colour, marker="o", **fill)


def _interval(ax: Axes, y: float, row: Mapping[Hashable, Any], name: str, **style: Any) -> None:
    """Draw a value with its interval."""
    prefix = "published_" if name == "published" else ""
    value, low, high = row[name], row[f"{prefix}low"], row[f"{prefix}high"]
    ax.errorbar(value, y, xerr=[[value - low], [high - value]], ms=3, lw=0.9, capsize=1.5, **style)


def _words(axes: Sequence[Axes], k: int, rows: pd.DataFrame) -> None:
    """Write the name of an experiment at the left, its predictions at the right, coloured."""
    first = rows.iloc[0]
    axes[0].text(-0.02, k - 0.17, first["name"], **_at(axes[0], "right"))
    axes[0].text(-0.02, k + 0.2, first["by"], **_at(axes[0], "right", color="0.4"))
    predictions = where(rows, kind="prediction").to_dict("records")
    for n, row in enumerate(predictions):
        line, place = divmod(n, PER_LINE)
        lines = -(-len(predictions) // PER_LINE)
        y = k + 0.37 * (line - (lines - 1) / 2)
        word = f"{SHORT.get(row['measure'], row['measure'])} {ARROWS[row['direction']]}"
        colour = COLOUR.get(row["outcome"], "0.45")
        axes[1].text(1.03 + 0.42 * place, y, word, **_at(axes[1], "left", color=colour))


def _key(figure: Figure) -> None:
    """Draw the key below the panels."""
    marks = [
        Line2D([], [], ls="", marker="s", color="k", ms=3, label="published"),
        Line2D([], [], ls="", marker="o", color="0.45", ms=3, label="model"),
        Line2D([], [], ls="", marker="o", color="0.45", mfc="w", ms=3, label="model, spikes"),
        Line2D([], [], color=AGREE, lw=3, label="agrees, compatible"),
        Line2D([], [], color=NOT, lw=3, label="disagrees, differs"),
        Line2D([], [], color=COLOUR[WITHOUT], lw=3, label=WITHOUT),
        Line2D([], [], color="0.45", lw=3, label=f"no number; {OPEN}"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=7, fontsize=SIZE, frameon=False)
