"""Recorded striatal cells and choices: held-out nats of models and regressions, and controls."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from figures.cells.compared import (
    CHOICES_ALONE,
    MODELS,
    NO_RECENT,
    REFERENCE,
    SHIPPED,
    chosen_alone,
    chosen_elsewhere,
    controls,
    courses,
    delayed,
    recovered,
    regressed,
    scored,
)
from figures.pieces import Made, Piece, Score

SEED, RECOVERY_SEED, TRIALS = 76_001, 76_004, 8601
SESSIONS, SETS, SHUFFLES = (0, 3, 5, 8, 11), 10, 8
"""Sessions whose trials are simulated, and how often each; how often spikes are shuffled."""
Z90, FEWEST_CELLS = 1.6449, 20
"""Half of a 90 % interval in standard errors; fewest cells whose mean is shown."""


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield regressions with and without recent rates and by delay, models, and controls."""
    for past in (True, False):
        name = "recent rate" if past else "course"
        yield Piece("regressed", name, TRIALS, 5, partial(regressed, SHIPPED, past))
    yield Piece("delays", "clicks", TRIALS, 15, partial(delayed, SHIPPED))
    yield Piece("scored", CHOICES_ALONE, TRIALS, 3, partial(chosen_alone, SHIPPED))
    for model in (REFERENCE,) if fast else MODELS:
        yield Piece("scored", model, TRIALS, 80, partial(scored, SHIPPED, model))
    yield Piece("courses", REFERENCE, TRIALS, 25, partial(courses, SHIPPED))
    some = 1 if fast else SHUFFLES
    yield Piece("controls", "spikes", TRIALS, 120, partial(controls, SHIPPED, SEED, some))
    yield Piece("scored", "shuffled", TRIALS, 80, partial(chosen_elsewhere, SHIPPED, SEED))
    for session in SESSIONS[:1] if fast else SESSIONS:
        make = partial(recovered, SHIPPED, session, RECOVERY_SEED, 2 if fast else SETS)
        yield Piece("recovered", f"session {session}", TRIALS, 20, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return nats by model and by delay, gains, courses, and recovery."""
    scores, described = made["scored"], made["regressed"]
    by_course, by_recent = (
        _by(described[described["past"] == past], "cell", "apart") for past in (False, True)
    )
    regressions = pd.concat([
        pd.DataFrame({"past": past, "nats": nats.sub(nats["psth"], axis=0).sum()}).reset_index()
        for past, nats in ((False, by_course), (True, by_recent))
    ])  # fmt: skip
    cells = _by(scores[scores["cell"].notna()], "cell", "apart")
    trials = scores[scores["trial"].notna()]
    choices = _by(trials, "trial", "choices")
    everything = choices + _by(trials, "trial", "together")
    models = []
    for model, rows in scores.groupby("model", sort=False):
        base = (by_course if model == NO_RECENT else by_recent)["psth"]
        row: dict[Any, Any] = rows.drop(columns=["trial", "cell", "apart"]).iloc[0].to_dict()
        row |= rows[["together", "choices", "told"]].sum(min_count=1).to_dict()
        row["together"] -= base.sum()
        if model in cells:
            row |= _against(cells[model] - base, "")
            row |= _against(cells[model] - cells[REFERENCE], "_reference")
            row |= _against(everything[model] - everything[REFERENCE], "_all")
        if rows["choices"].notna().any():
            row |= _against(choices[model] - choices[CHOICES_ALONE], "_choices")
        models.append(row)
    delays = made["delays"].groupby("delay_s")["nats"].sum().reset_index()
    best = made["delays"].groupby("cell")["nats"].max().sum()
    z = made["recovered"].groupby("number")["z"]
    recovery = pd.DataFrame({
        "covered": z.apply(lambda some: (some.abs() < Z90).mean()), "mean_z": z.mean(),
        "intervals": z.size(),
    })  # fmt: skip
    return {
        "regressions": ("regressed", regressions),
        "models": ("scored", pd.DataFrame(models)),
        "delays": ("delays", delays.assign(best_of_each=best)),
        "gains": ("controls", made["controls"]),
        "courses": ("courses", made["courses"][made["courses"]["cells"] >= FEWEST_CELLS]),
        "recovery": ("recovered", recovery.reset_index()),
    }


def _by(table: pd.DataFrame, unit: str, nats: str) -> pd.DataFrame:
    """Return nats by cell or trial, a column per model."""
    return table.pivot(index=unit, columns="model", values=nats)


def _against(apart: pd.Series[float], name: str) -> dict[str, float]:
    """Return the sum of differences, and its standard error over cells or trials."""
    error = apart.std() * np.sqrt(apart.count())
    return {f"nats{name}": float(apart.sum()), f"error{name}": float(error)}


SCORE = Score("cells", SEED, (), pieces, tables, circuit="")
