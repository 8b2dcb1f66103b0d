"""An acute partial loss of STN against the intact circuit at the criterion that theory gives.

After a loss f OUT is lower by -ln(1 - f) whatever the evidence (``circuits.laws.family``), so the
lesioned circuit should decide like the intact one at a threshold higher by as much. All
circuits receive the same evidence and the same noise of single cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.integrators.sprt import threshold_from_posterior
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.laws.family import shift_nats
from figures.lesions.measure_loss import LesionTask, decided, evidence
from figures.pieces import Made, Piece, Score, wide

SCORING_SEED = 60_101
TRIALS, COARSE_TRIALS = 4000, 400
LOST = (0.1, 0.2, 0.3)
POSTERIOR = 0.85
TASKS = tuple(
    LesionTask(channels, 0.5, 120, float(threshold_from_posterior(POSTERIOR, channels)))
    for channels in (2, 4)
)


def compared(task: LesionTask, trials: int, workers: int) -> pd.DataFrame:
    """Return measures of lesioned and intact circuits, and their paired differences."""
    table = load_circuit(DEFAULT, task.channels)
    drawn, level = evidence(task, 0.0, trials, seed=SCORING_SEED), task.threshold_nats
    weights = resampled(trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"))
    share = weights / weights.sum(axis=1, keepdims=True)
    truth = np.asarray(drawn.truth)

    def each(tradeoff: Tradeoff) -> dict[str, Array]:
        return {"accuracy": tradeoff.choice[0] == truth, "mean_ms": tradeoff.time_ms[0]}

    intact = each(decided(table, drawn, level, workers, SCORING_SEED))
    rows = []
    for lost in LOST:
        lesioned = table.lesion("STN", lost)
        nats = shift_nats(lesioned)
        assert nats is not None
        after = decided(lesioned, drawn, level, workers, SCORING_SEED)
        moved = decided(table, drawn, level - nats, workers, SCORING_SEED)
        values = {f"{name}_intact": value for name, value in intact.items()}
        for name, value in each(after).items():
            values[name] = value
            values[f"{name}_shifted"] = each(moved)[name]
            values[f"{name}_difference"] = value - each(moved)[name].astype(np.float64)
        values["same_choice"] = after.choice[0] == moved.choice[0]
        for name, value in values.items():
            numbers = interval(share @ value.astype(np.float64))
            rows.append((task.name, POSTERIOR, lost, nats, name, *numbers))
    columns = ["evidence", "posterior", "lost", "shift_nats", "measure", "value", "low", "high"]
    return pd.DataFrame(rows, columns=columns).assign(trials=trials)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield one piece per number of alternatives."""
    trials = COARSE_TRIALS if fast else TRIALS
    for task in TASKS:
        make = partial(compared, task, trials, workers)
        yield Piece("theorem", task.name, trials, trials / 400, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a row per number of alternatives and loss."""
    index = ["evidence", "posterior", "lost", "shift_nats", "trials"]
    return {"theorem": ("theorem", wide(made["theorem"], index))}


SCORE = Score("criterion", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
