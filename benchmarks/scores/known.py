"""Fits on known evidence: which model simulated observers prefer, and from how many trials on.

Observers are the optimal test, a leaky sum and the default circuit, on Gaussian evidence with two
alternatives and on designed trials with four. The expected log Bayes factor per trial, on many
trials with a seed of its own, gives the number of trials at which one model should be told from
another; at that number, and at far fewer, observers with other seeds are fitted by all models.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from benchmarks.methods.known import (
    CIRCUIT,
    DESIGNED,
    LEAKY,
    OBSERVERS,
    RANDOM,
    TEST,
    expected,
    preferred,
    recovered,
    runs_found,
    shuffled,
)
from benchmarks.scores.pieces import Made, Piece, Score, main
from circuits.anatomy import DEFAULT

PLANNING_SEED, SCORING_SEED = 47_101, 47_201
"""Seeds of the expected factors, which give the numbers of trials, and of scored observers."""
MANY = {RANDOM: 1000, DESIGNED: 600}
"""Trials from which factors are expected."""
NEEDED = {RANDOM: 520, DESIGNED: 80}
"""Trials that the expected factors imply for those pairs of models that can be told apart."""
FEW = 30
"""Trials at which no model should be preferred."""
EACH = 8
"""Number of observers of each model: 24 for each kind of evidence."""
EFFECT, TRIALS, REPEATS = 0.02, 400, 24
"""Effect of a run, nats per further cue, and trials and observers of it and of recovery."""


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield expected factors, preferences at two numbers of trials, and recoveries."""
    observers, repeats = (1, 2) if fast else (EACH, REPEATS)
    share = 0.2 if fast else 1.0
    for kind in OBSERVERS:
        for who in OBSERVERS[kind]:
            many = int(share * MANY[kind])
            make = partial(expected, kind, who, many, PLANNING_SEED)
            yield Piece("expected", f"{kind}, {who}", many, 45, make)
    for kind in OBSERVERS:
        for who in OBSERVERS[kind]:
            for name, trials in (("needed", NEEDED[kind]), ("few", FEW)):
                make = partial(preferred, kind, who, trials, observers, SCORING_SEED)
                seconds = observers * (30 if name == "needed" else 10)
                yield Piece("preferred", f"{kind}, {who}, {name}", trials, seconds, make)
        make = partial(recovered, kind, TRIALS, repeats, SCORING_SEED)
        yield Piece("recovered", kind, TRIALS, 4 * repeats, make)
    for effect in (0.0, EFFECT):
        make = partial(runs_found, RANDOM, effect, TRIALS, repeats, SCORING_SEED)
        yield Piece("runs", f"effect {effect:g}", TRIALS, 8 * repeats, make)
    for kind in OBSERVERS:
        make = partial(shuffled, kind, TRIALS, repeats, SCORING_SEED)
        yield Piece("shuffled", kind, TRIALS, 8 * repeats, make)


def counted(preferences: pd.DataFrame, factors: pd.DataFrame) -> pd.DataFrame:
    """Return how often each observer's own model is preferred over each rival.

    Columns evidence, observer, rival, trials, observers, needed, own (log Bayes factor of at least
    3 for the own model), other (for the rival), neither, mean (log Bayes factor).
    """
    rows = []
    keys = ["evidence", "observer", "trials"]
    for (kind, who, trials), part in preferences.groupby(keys, sort=False):
        for rival in (TEST, LEAKY, CIRCUIT):
            if rival == who:
                continue
            over = part[f"over_{rival}"]
            own, other = int((over > 3).sum()), int((over < -3).sum())
            same = (factors["evidence"] == kind) & (factors["observer"] == who)
            needed = float(factors.loc[same & (factors["rival"] == rival), "needed"].iloc[0])
            counts = (own, other, len(part) - own - other, over.mean())
            rows.append((kind, who, rival, trials, len(part), needed, *counts))
    names = ["evidence", "observer", "rival", "trials", "observers", "needed"]
    return pd.DataFrame(rows, columns=[*names, "own", "other", "neither", "mean"])


def summed(preferences: pd.DataFrame) -> pd.DataFrame:
    """Return the verdicts of all observers.

    Columns evidence, observer, trials, observers, right (the own model is preferred over both
    others), wrong (another one is), open ("cannot tell"), cpu_s (longest fit of the circuit).
    """
    rows = []
    keys = ["evidence", "observer", "trials"]
    for (kind, who, trials), part in preferences.groupby(keys, sort=False):
        right = int((part["verdict"] == who).sum())
        unknown = int((part["verdict"] == "cannot tell").sum())
        wrong = len(part) - right - unknown
        rows.append((kind, who, trials, len(part), right, wrong, unknown, part["cpu_s"].max()))
    names = ["evidence", "observer", "trials", "observers", "right", "wrong", "open", "cpu_s"]
    return pd.DataFrame(rows, columns=names)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return expected factors, counts of pairs and of verdicts, and recoveries."""
    runs, mixed = made["runs"], made["shuffled"]
    found = runs.assign(found=runs["log_bayes_factor"] > 3, absent=runs["log_bayes_factor"] < 0)
    effects = found.groupby(["effect", "trials"], as_index=False).agg(
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
        "pairs": ("preferred", counted(made["preferred"], factors)),
        "verdicts": ("preferred", summed(made["preferred"])),
        "recovered": ("recovered", made["recovered"]),
        "runs": ("runs", effects),
        "shuffled": ("shuffled", gains),
    }


SCORE = Score("known", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
