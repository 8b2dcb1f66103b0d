"""Figure D4: every experiment that ships: what was published, what the circuit does, who is right.

The predictions stand in the experiments' files, each written before its first run.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.experiment import AGREES, DISAGREES, run_experiment, shipped
from bgmodel.files import read_table, write_table
from bgmodel.outcomes import outcomes
from figures.common import Settings, run

COLOUR = {AGREES: "C2", DISAGREES: "C1"}
ARROWS = {"up": "up", "down": "down", "none": "no change"}


def compute(settings: Settings, *, output: Path) -> None:
    """Run every experiment and hold it to its predictions."""
    parts = []
    for file, experiment in shipped().items():
        one = replace(experiment, task=replace(experiment.task, trials=settings.circuit_trials))
        found = outcomes(one, run_experiment(one))
        parts.append(found.assign(file=file, name=one.name, source=one.source))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the table: a row a prediction, the change in units of the smallest that counts."""
    table = read_table(data)
    names = ["manipulation", "published or derived by", "predicted", "found, 95 %", "the model"]
    cells, colours, last = [], [], ""
    for row in table.itertuples(index=False):
        source = str(row.source).replace(", abstract only", " *")
        new = row.file != last
        cells.append(
            [
                row.name if new else "",
                source if new else "",
                f"{row.measure} {ARROWS[row.direction]} ({row.at_least:g})",
                _found(row),
                row.outcome,
            ]
        )
        colours.append(COLOUR.get(row.outcome, "0.5"))
        last = row.file
    figure, ax = plt.subplots(figsize=(7.2, 0.2 * len(cells) + 0.5))
    ax.axis("off")
    drawn = ax.table(
        cells, colLabels=names, cellLoc="left", colLoc="left", loc="center", edges="horizontal"
    )
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(6)
    drawn.auto_set_column_width(range(len(names)))
    for k, colour in enumerate(colours):
        drawn[k + 1, len(names) - 1].get_text().set_color(colour)
    for cell in drawn.get_celld().values():
        cell.set_linewidth(0.3)
    ax.set_title("* abstract only; in brackets the smallest change that counts", fontsize=6)
    return figure


def _found(row) -> str:
    form = "+.0f" if str(row.measure).endswith("_ms") else "+.3f"
    return f"{row.value:{form}} [{row.low:{form}}, {row.high:{form}}]"


if __name__ == "__main__":
    run(compute=compute, draw=draw)
