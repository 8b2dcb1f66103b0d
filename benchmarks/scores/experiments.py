"""What came of the experiments that ship, on the seeds in their files: make score."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pandas as pd

from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel.experiments.experiment import Experiment, run_experiment, shipped
from bgmodel.experiments.outcomes import outcomes

COARSE_SHARE = 0.2
"""Of the trials in an experiment's file."""
SECONDS = {2: 0.03, 4: 0.1}
"""CPU time of a trial, about, by alternatives."""


def predictions(experiment: Experiment, workers: int) -> pd.DataFrame:
    """Return the outcome of each prediction, and what was published."""
    found = outcomes(experiment, run_experiment(experiment, workers=workers).measures)
    known = {"name": experiment.name, "published": experiment.published}
    known |= {"source": experiment.source, "trials": experiment.task.trials}
    return found.assign(**known)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per experiment."""
    for name, experiment in shipped().items():
        trials = round(experiment.task.trials * (COARSE_SHARE if fast else 1))
        smaller = replace(experiment, task=replace(experiment.task, trials=trials))
        seconds = SECONDS[experiment.task.channels] * trials
        yield Piece("predictions", name, trials, seconds, partial(predictions, smaller, workers))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the outcomes of all."""
    ends = {"low": "value_low", "high": "value_high"}
    return {"predictions": ("predictions", made["predictions"].rename(columns=ends))}


SCORE = Score("experiments", None, (2, 4), pieces, tables)

if __name__ == "__main__":
    main(SCORE)
