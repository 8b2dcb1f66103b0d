"""Figure T1: from a sensor's taps to decisions in spikes, for simulated and for real taps."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.learning.reinforce import Learner
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.edges import decoded_edges
from bgmodel.tactile.task import EdgeTurn, SameDifferent
from bgmodel.touch import STEPS_DEG, Story, story
from figures.common import Settings, run

STEP_MS = 50.0
AXES = {"simulated": "period of the grating (mm)", "real": "turn of the edge (deg)"}
ROWS = {"simulated": "Simulated sensor", "real": "Real sensor"}
LETTERS = {"simulated": ("a  ", "b  ", "c  ", "d  "), "real": ("e  ", "f  ", "g  ", "h  ")}


def compute(settings: Settings, simulated: Path, real: Path | None = None, *, output: Path) -> None:
    """Run test, learner and circuit on decoded taps of each sensor."""
    given: dict[str, Any] = {
        "trials": settings.circuit_trials, "step_ms": STEP_MS, "seed": settings.seed,
        "learner": Learner(episodes=settings.episodes),
    }  # fmt: skip
    told = {
        "simulated": story(
            read_table(simulated), SameDifferent, settings.periods_mm, 2.0, AXES["simulated"],
            **given,
        )
    }  # fmt: skip
    if real is not None:
        taps, task = decoded_edges(settings.seed, real), partial(EdgeTurn, 2)
        told["real"] = story(taps, task, STEPS_DEG, 5.0, AXES["real"], **given)
    rows = pd.concat([each.to_dataframe().assign(sensor=name) for name, each in told.items()])
    recordings = real.name if real else "none"
    write_table(rows, output, seed=settings.seed, settings=settings, recordings=recordings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw a row of panels for each sensor."""
    table = read_table(data)
    sensors = list(dict.fromkeys(table["sensor"]))
    figure, axes = plt.subplots(len(sensors), 4, figsize=(11, 2.6 * len(sensors)), squeeze=False)
    for row, name in enumerate(sensors):
        rows = table[table["sensor"] == name]
        one = Story.from_dataframe(rows, AXES[name], STEP_MS)
        one.draw(axes[row], LETTERS[name])
        axes[row, 0].set_ylabel(f"{ROWS[name]}\n{axes[row, 0].get_ylabel()}")
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
