"""Results of the built-in experiments, on the seeds in their files: make score.

Populations on all trials of a file; spikes on fewer, as measures for figure D4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pandas as pd

from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.experiments.outcomes import beside_published, outcomes
from circuits.anatomy import DEFAULT
from figures.pieces import Made, Piece, Score

COARSE_SHARE = 0.2
"""Of the trials in an experiment's file."""
SECONDS, SPIKING_SECONDS = 0.0015, 0.08
"""CPU time of a trial, about, control, manipulation and bootstrap."""
SPIKING_TRIALS = 600
PREDICTION, EFFECT = "prediction", "effect"
"""What a row of a piece is."""


def predictions(experiment: Experiment, workers: int) -> pd.DataFrame:
    """Return the outcome of each prediction, and of each effect that was published as a number."""
    measures = experiment.run(workers=workers).measures
    parts = [outcomes(experiment, measures).assign(row=PREDICTION)]
    if experiment.effects:
        parts.append(beside_published(experiment, measures).assign(row=EFFECT))
    known = {"name": experiment.name, "published": experiment.published}
    known |= {"source": experiment.source, "trials": experiment.task.trials}
    # Published numbers are in a separate column.
    numbers = {"published": "published_value"}
    return pd.concat([part.rename(columns=numbers) for part in parts]).assign(**known)


def in_spikes(name: str, experiment: Experiment, workers: int) -> pd.DataFrame:
    """Return every measure of an experiment in spikes."""
    measures = replace(experiment, engine="spikes").run(workers=workers).measures
    return measures.assign(file=name, trials=experiment.task.trials)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per experiment and engine."""
    share = COARSE_SHARE if fast else 1
    for name, experiment in shipped().items():
        if experiment.stop is not None:
            continue  # score signals
        trials = round(experiment.task.trials * share)
        smaller = replace(experiment, task=experiment.task.changed(trials=trials))
        make = partial(predictions, smaller, workers)
        yield Piece("predictions", name, trials, SECONDS * trials, make)
        few = round(SPIKING_TRIALS * share)
        smaller = replace(experiment, task=experiment.task.changed(trials=few))
        make = partial(in_spikes, name, smaller, workers)
        yield Piece("spikes", name, few, SPIKING_SECONDS * few, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return outcomes of predictions, effects with published values, and measures in spikes."""
    ends = {"low": "value_low", "high": "value_high"}
    ends |= {"published_low": "published_value_low", "published_high": "published_value_high"}
    rows = made["predictions"].rename(columns=ends)
    parts = {name: part.drop(columns="row") for name, part in rows.groupby("row")}
    shown = {
        f"{name}s": ("predictions", parts[name].dropna(axis="columns", how="all"))
        for name in (PREDICTION, EFFECT)
    }
    return shown | {"spikes": ("spikes", made["spikes"])}


SCORE = Score("experiments", None, (2,), pieces, tables, circuit=DEFAULT)
