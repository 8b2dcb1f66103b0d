"""Figure D4: every experiment that ships: who found what, and what the circuit does.

The predictions stand in the experiments' files and were written before the first run of any.
Afterwards two things were set anew once, no prediction: the length of trials where drift and bound
are fitted, and the levels of dopamine when its gain got a pivot. What is found is found by the
population engine on all trials of a file; beside it stands what spikes give on fewer.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.comparison.compare import shown
from bgmodel.experiments.experiment import AGREES, DISAGREES, WITHOUT, run_experiment, shipped
from bgmodel.experiments.outcomes import outcomes
from bgmodel.files import read_table, write_table
from figures.common import FULL, Settings, run

COLOUR = {AGREES: "C2", DISAGREES: "C1", WITHOUT: "C3"}
HEAD = ("manipulation", "source", "predicted", "found", "in spikes", "the circuit")
KEY = ["file", "measure", "direction"]
COLUMNS = (0.0, 0.32, 0.45, 0.585, 0.735, 0.885)
SPIKING_SHARE = 0.5
"""Spiking trials, as a share of what the figures of circuits have; with all of an experiment's they
would take as long as all other figures."""
SIZE = 5.5
ARROWS = {"up": "up", "down": "down", "none": "no change"}


def compute(settings: Settings, *, output: Path) -> None:
    """Run every experiment on both engines and hold it to its predictions."""
    parts = []
    for k, (file, experiment) in enumerate(shipped().items()):
        share = settings.circuit_trials / FULL.circuit_trials
        # Where one truth alone counts, half of the trials are left.
        engines = {"population": max(round(share * experiment.task.trials), 240)}
        if k % settings.held_to_spikes == 0:
            engines["ensemble"] = max(round(SPIKING_SHARE * settings.circuit_trials), 240)
        for engine, trials in engines.items():
            task = replace(experiment.task, trials=trials)
            one = replace(experiment, task=task, engine=engine)
            found = outcomes(one, run_experiment(one).measures)
            about = {"file": file, "name": one.name, "source": one.source, "seed": one.seed}
            parts.append(found.assign(trials=trials, engine=engine, **about))
    write_table(pd.concat(parts), output, settings=settings)


def _both(data: Path) -> pd.DataFrame:
    """Return the changes by populations, a row a prediction, beside those in spikes."""
    by_engine = dict(list(read_table(data).groupby("engine")))
    spikes = by_engine["ensemble"][[*KEY, "value", "low", "high", "trials"]]
    return by_engine["population"].merge(spikes, on=KEY, how="left", suffixes=("", "_spikes"))


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the table: a row a prediction, the found change with its interval, the verdict."""
    table = _both(data)
    rows = len(table) + 3
    figure, ax = plt.subplots(figsize=(8.2, 0.155 * rows))
    ax.set(xlim=(0, 1.01), ylim=(rows, 0))
    ax.axis("off")
    for x, text in zip(COLUMNS, HEAD, strict=True):
        ax.text(x, 0.5, text, fontsize=SIZE, fontweight="bold", va="center")
    for k, row in enumerate(table.itertuples(index=False)):
        new = k == 0 or row.file != table["file"].iloc[k - 1]
        if new:
            ax.axhline(k + 1, lw=0.4, color="0.7")
        for x, text in zip(COLUMNS, _cells(row, new), strict=True):
            colour = COLOUR.get(row.outcome, "0.5") if text is row.outcome else "k"
            ax.text(x, k + 1.5, text, fontsize=SIZE, color=colour, va="center")
    note = (
        "* abstract only. In brackets the smallest change that counts; intervals are of 95 %. "
        "Found, and the verdict: population engine; in spikes: "
        f"{table['trials_spikes'].max():.0f} trials.\n"
        "mean_ms in ms; criterion (posterior), accuracy, missed and anticipatory from 0 to 1; "
        "drift (1/s) and bound by EZ-diffusion with s = 0.1."
    )
    ax.text(0, rows - 0.9, note, fontsize=SIZE, va="center")
    return figure


def _cells(row, new: bool) -> tuple[str, ...]:
    """Return the texts of a row; an experiment is named once."""
    source = str(row.source).replace(", abstract only", " *").split(" from ")[0]
    return (
        row.name if new else "",
        source.split(",")[0] if new else "",
        f"{row.measure} {ARROWS[row.direction]} ({row.at_least:g})",
        _found(row.measure, row.value, row.low, row.high),
        _found(row.measure, row.value_spikes, row.low_spikes, row.high_spikes),
        row.outcome,
    )


def _found(measure: str, value: float, low: float, high: float) -> str:
    if pd.isna(value):
        return ""
    return shown(value, low, high, "+.0f" if measure.endswith("_ms") else "+.3f")


if __name__ == "__main__":
    run(compute=compute, draw=draw)
