"""Fits of circuits with and without urgency to monkeys and people, for whom strength varies.

The motif "urgency" lowers OUT with time by numbers that no fit moves, so that it adds no free
parameter; the falling gap has one. The default circuit and ``macaque_small`` are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from bgmodel.fitting.algorithms import EXPONENTIAL, GapModel, Model
from bgmodel.fitting.design import design_of
from bgmodel.fitting.simulated.circuit_model import NONE, SIMULATION_SEED
from bgmodel.trials.reader import read_trials
from circuits.anatomy import DEFAULT, load_circuit
from figures.data.measure_fits import PREDICTED, SECONDS, fitted, fitted_circuit, people
from figures.pieces import Made, Piece, Score, main

TRIALS, COARSE_TRIALS = 32_000, 400
"""Trials that a fitted circuit is simulated with, at each drift."""
CIRCUITS = (DEFAULT, "macaque_small")


def models(trials: int) -> dict[str, Model]:
    """Return the models by the names that the table has for them."""
    every: dict[str, Model] = {"falling gap": GapModel(EXPONENTIAL), "constant gap": GapModel()}
    for name in CIRCUITS:
        circuit = load_circuit(name, 2)
        for title, one in ((name, circuit), (f"{name}, urgency", circuit.edited("add urgency"))):
            every[title] = fitted_circuit(NONE, trials, SECONDS, circuit=one)
    return every


def person(data: str, who: str, trials: int) -> pd.DataFrame:
    """Return how well each model predicts left-out trials, compared with the falling gap."""
    design = design_of(read_trials(data, strength="coherence", participant=who))
    table = fitted(design, models(trials))
    table = table.loc[table["kind"] == "predicted", ["model", *PREDICTED]]
    return table.assign(data=data, participant=who)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through monkeys and people."""
    trials = COARSE_TRIALS if fast else TRIALS
    for data, who, count in people():
        yield Piece("predicted", who, count, 120, partial(person, data, who, trials))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the one table."""
    return {"predicted": ("predicted", made["predicted"])}


SCORE = Score(
    "urgency", SIMULATION_SEED, (2,), pieces, tables, circuit=DEFAULT, others=CIRCUITS[1:]
)

if __name__ == "__main__":
    main(SCORE)
