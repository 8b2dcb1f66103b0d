"""Results of the built-in experiments with stop signals, on the seeds in their files: make score.

By populations, on all trials of a file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pandas as pd

from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.experiments.outcomes import outcomes
from circuits.anatomy import DEFAULT
from figures.effects.measure_experiments import COARSE_SHARE
from figures.pieces import Piece, Score

SECONDS = 0.0012
"""CPU time of a trial, about, control, manipulation and bootstrap."""
SHOWN = ("mean_ms", "p_respond", "ssrt_ms", "failed_minus_go_ms", "accuracy", "missed")
"""Measures in the table."""


def measured(experiment: Experiment, workers: int) -> pd.DataFrame:
    """Return measures of both conditions and their change, with the outcome of each prediction."""
    measures = experiment.run(workers=workers).measures
    shown = measures[measures["measure"].isin(SHOWN) & (measures["condition"] != "percent")]
    judged = outcomes(experiment, measures)[["measure", "direction", "at_least", "outcome"]]
    table = shown.merge(judged.assign(condition="change"), how="left", on=["condition", "measure"])
    known = {"name": experiment.name, "published": experiment.published}
    return table.assign(**known, source=experiment.source)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per experiment."""
    for name, experiment in shipped().items():
        if experiment.stop is None:
            continue
        trials = round(experiment.task.trials * (COARSE_SHARE if fast else 1))
        one = replace(experiment, task=experiment.task.changed(trials=trials))
        make = partial(measured, one, workers)
        yield Piece("measures", name, trials, SECONDS * trials, make)


SCORE = Score("signals", None, (2,), pieces, circuit=DEFAULT)
