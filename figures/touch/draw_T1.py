"""Figure T1: from a sensor's taps to decisions in spikes, for simulated and for real taps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.from_taps import Touched, touch
from bgmodel.learning.reinforce import Learner
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import decoded_edges
from bgmodel.tactile.task import EdgeTurn, SameDifferent
from figures.common import Settings

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
        "simulated": touch(
            SameDifferent(2.0), read_table(simulated), values=settings.periods_mm, **given
        )
    }  # fmt: skip
    if real is not None:
        told["real"] = touch(EdgeTurn(2, 5.0), decoded_edges(settings.seed, real), **given)
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
        one = Touched.from_dataframe(rows, AXES[name], STEP_MS)
        one.draw(axes[row], LETTERS[name])
        axes[row, 0].set_ylabel(f"{ROWS[name]}\n{axes[row, 0].get_ylabel()}")
    return figure
