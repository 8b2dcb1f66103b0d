"""Figure D4: every experiment that ships: who found what, and what the circuit does.

The predictions stand in the experiments' files and were written before the first run of any.
Afterwards two things were set anew once, no prediction: the length of trials where drift and bound
are fitted, and the levels of dopamine when its gain got a pivot.
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
HEAD = ("manipulation", "source", "predicted", "found", "the circuit")
COLUMNS = (0.0, 0.35, 0.52, 0.685, 0.86)
SIZE = 5.5
ARROWS = {"up": "up", "down": "down", "none": "no change"}


def compute(settings: Settings, *, output: Path) -> None:
    """Run every experiment and hold it to its predictions."""
    parts = []
    for file, experiment in shipped().items():
        share = settings.circuit_trials / FULL.circuit_trials
        # Where one truth alone counts, half of the trials are left.
        trials = max(round(share * experiment.task.trials), 240)
        one = replace(experiment, task=replace(experiment.task, trials=trials))
        found = outcomes(one, run_experiment(one).measures)
        about = {"file": file, "name": one.name, "source": one.source, "seed": one.seed}
        parts.append(found.assign(trials=trials, **about))
    write_table(pd.concat(parts), output, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the table: a row a prediction, the found change with its interval, the verdict."""
    table = read_table(data)
    rows = len(table) + 2
    figure, ax = plt.subplots(figsize=(7.2, 0.155 * rows))
    ax.set(xlim=(0, 1), ylim=(rows, 0))
    ax.axis("off")
    for x, text in zip(COLUMNS, HEAD, strict=True):
        ax.text(x, 0.5, text, fontsize=SIZE, fontweight="bold", va="center")
    for k, row in enumerate(table.itertuples(index=False)):
        new = k == 0 or row.file != table["file"].iloc[k - 1]
        if new:
            ax.axhline(k + 1, lw=0.4, color="0.7")
        source = str(row.source).replace(", abstract only", " *").split(" from ")[0]
        cells = (
            row.name if new else "",
            source.split(",")[0] if new else "",
            f"{row.measure} {ARROWS[row.direction]} ({row.at_least:g})",
            _found(row),
            row.outcome,
        )
        for x, text in zip(COLUMNS, cells, strict=True):
            colour = COLOUR.get(row.outcome, "0.5") if text is row.outcome else "k"
            ax.text(x, k + 1.5, text, fontsize=SIZE, color=colour, va="center")
    note = "* abstract only. In brackets the smallest change that counts; intervals are of 95 %."
    ax.text(0, rows - 0.4, note, fontsize=SIZE, va="center")
    return figure


def _found(row) -> str:
    form = "+.0f" if str(row.measure).endswith("_ms") else "+.3f"
    return shown(row.value, row.low, row.high, form)


if __name__ == "__main__":
    run(compute=compute, draw=draw)
