"""Fits of circuits with and without urgency to monkeys and people, for whom strength varies.

The motif "urgency" lowers OUT with time by numbers that no fit moves, so that it adds no free
parameter; the falling gap has one, and so has urgency whose size is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import pandas as pd

from bgmodel.fitting.algorithms import EXPONENTIAL, GapModel, Model
from bgmodel.fitting.design import design_of
from bgmodel.fitting.simulated.circuit_model import MECHANISMS, NONE, SIMULATION_SEED
from bgmodel.trials.reader import read_trials
from circuits.anatomy import DEFAULT, load_circuit
from figures.data.measure_fits import PREDICTED, SECONDS, fitted, fitted_circuit, people
from figures.pieces import Made, Piece, Score

TRIALS, COARSE_TRIALS = 32_000, 400
"""Trials that a fitted circuit is simulated with, at each drift."""
SIZED = f"{DEFAULT}, fitted urgency"
FEWER = 0.5
"""Share of the trials where they are simulated at several sizes of urgency."""
SIZED_NATS = 1.0
"""Noise of evidence in nats where urgency is fitted. Gaps that fall begin at up to 3 sqrt(s), and
the read-out of the circuit is exact to 2.8 nats."""


def models(trials: int) -> dict[str, Model]:
    """Return the models by the names that the table has for them."""
    urgent = load_circuit(DEFAULT, 2).edited("add urgency")
    return {
        "falling gap": GapModel(EXPONENTIAL),
        "constant gap": GapModel(),
        DEFAULT: fitted_circuit(NONE, trials, SECONDS),
        f"{DEFAULT}, urgency": fitted_circuit(NONE, trials, SECONDS, circuit=urgent),
    }


def predictions(data: str, who: str, every: Mapping[str, Model]) -> pd.DataFrame:
    """Return how well each model predicts left-out trials, compared with the first."""
    design = design_of(read_trials(data, strength="coherence", participant=who))
    table = fitted(design, every)
    table = table.loc[table["kind"] == "predicted", ["model", *PREDICTED]]
    return table.assign(data=data, participant=who)


def person(data: str, who: str, trials: int) -> pd.DataFrame:
    """Return the predictions of tests and circuit, in which the motif has no free number."""
    return predictions(data, who, models(trials))


def person_sized(data: str, who: str, trials: int) -> pd.DataFrame:
    """Return the predictions of the circuit whose urgency has the size that fits best."""
    made = fitted_circuit(MECHANISMS["urgency"], trials, SECONDS, SIZED_NATS)
    table = predictions(data, who, {"falling gap": GapModel(EXPONENTIAL), SIZED: made})
    return table[table["model"] == SIZED]


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through monkeys and people."""
    trials = COARSE_TRIALS if fast else TRIALS
    for data, who, count in people():
        yield Piece("predicted", who, count, 120, partial(person, data, who, trials))
        fewer = round(FEWER * trials)
        yield Piece("sized", who, count, 240, partial(person_sized, data, who, fewer))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the one table."""
    every = pd.concat([made["predicted"], made["sized"]], ignore_index=True)
    return {"predicted": ("predicted", every)}


SCORE = Score("urgency", SIMULATION_SEED, (2,), pieces, tables, circuit=DEFAULT)
