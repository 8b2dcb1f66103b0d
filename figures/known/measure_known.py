"""Fits on known evidence: how many trials separate two models, and which parameters are recovered.

Observers are the optimal test, a leaky sum and the default circuit, on Gaussian evidence with two
alternatives and on designed trials with four. The expected log Bayes factor per trial, on many
trials drawn with another seed, gives the number of trials at which one model should be told from
another; ``observers.py`` scores observers at that number.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from circuits.anatomy import DEFAULT
from figures.known.fitted import (
    DESIGNED,
    OBSERVERS,
    RANDOM,
    expected,
    recovered,
    runs_found,
    shuffled,
)
from figures.pieces import Made, Piece, Score

PLANNING_SEED, SCORING_SEED = 47_101, 47_201
"""Seeds of the expected factors, which give the numbers of trials, and of scored observers."""
MANY = {RANDOM: 1000, DESIGNED: 600}
"""Trials from which factors are expected."""
SHUFFLES = 8
"""Number of observers whose evidence is shuffled between trials."""
EFFECT, TRIALS, REPEATS = 0.02, 400, 24
"""Effect of a run, nats per further cue, and trials and observers of it and of recovery."""


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield expected factors, recoveries, effects of runs, and shuffled evidence."""
    repeats, shuffles = (2, 2) if fast else (REPEATS, SHUFFLES)
    share = 0.2 if fast else 1.0
    for kind in OBSERVERS:
        for who in OBSERVERS[kind]:
            many = int(share * MANY[kind])
            make = partial(expected, kind, who, many, PLANNING_SEED)
            yield Piece("expected", f"{kind}, {who}", many, 45, make)
    for kind in OBSERVERS:
        make = partial(recovered, kind, TRIALS, repeats, SCORING_SEED)
        yield Piece("recovered", kind, TRIALS, repeats, make)
    for effect in (0.0, EFFECT):
        make = partial(runs_found, RANDOM, effect, TRIALS, repeats, SCORING_SEED)
        yield Piece("runs", f"effect {effect:g}", TRIALS, 2 * repeats, make)
    for kind in OBSERVERS:
        make = partial(shuffled, kind, TRIALS, shuffles, SCORING_SEED)
        yield Piece("shuffled", kind, TRIALS, 3 * shuffles, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return expected factors, recoveries, effects of runs, and gains of shuffled evidence."""
    runs, mixed = made["runs"], made["shuffled"]
    judged = runs.assign(found=runs["log_bayes_factor"] > 3, absent=runs["log_bayes_factor"] < 0)
    effects = judged.groupby(["effect", "trials"], as_index=False).agg(
        observers=("number", "size"), found=("found", "sum"), absent=("absent", "sum"),
        run_effect=("run_effect", "mean"), standard_error=("standard_error", "mean"),
    )  # fmt: skip
    gains = mixed.groupby(["evidence", "trials"], as_index=False).agg(
        observers=("number", "size"), gain=("gain", "mean"),
        shuffled_gain=("shuffled_gain", "mean"), shuffled_largest=("shuffled_gain", "max"),
    )  # fmt: skip
    factors = made["expected"].replace({"needed": {np.inf: np.nan}})
    return {
        "expected": ("expected", factors),
        "recovered": ("recovered", made["recovered"]),
        "runs": ("runs", effects),
        "shuffled": ("shuffled", gains),
    }


SCORE = Score("known", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
