"""Preferences of simulated observers whose every reading is known.

At the numbers of trials that the expected Bayes factors imply (``known.py``), and at far fewer,
observers drawn with other seeds are fitted by the optimal test, a leaky sum and the default
circuit.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from circuits.anatomy import DEFAULT
from figures.known.fitted import CIRCUIT, DESIGNED, LEAKY, OBSERVERS, RANDOM, TEST, preferred
from figures.known.measure_known import SCORING_SEED
from figures.pieces import Made, Piece, Score

NEEDED = {RANDOM: 560, DESIGNED: 80}
"""Trials that the expected factors imply for those pairs of models that can be told apart, rounded
up."""
FEW = 30
"""Trials at which no model should be preferred."""
EACH = 8
"""Number of observers of each model: 24 for each kind of evidence."""


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the preferences of observers of each model at two numbers of trials."""
    observers = 1 if fast else EACH
    for kind in OBSERVERS:
        for who in OBSERVERS[kind]:
            for name, trials in (("needed", NEEDED[kind]), ("few", FEW)):
                make = partial(preferred, kind, who, trials, observers, SCORING_SEED)
                seconds = observers * (20 if name == "needed" else 5)
                yield Piece("preferred", f"{kind}, {who}, {name}", trials, seconds, make)


def counted(preferences: pd.DataFrame) -> pd.DataFrame:
    """Return how often each observer's own model is preferred over each rival.

    Columns evidence, observer, rival, trials, observers, own (log Bayes factor of at least 3 for
    the own model), other (for the rival), neither, mean (log Bayes factor).
    """
    rows = []
    keys = ["evidence", "observer", "trials"]
    for (kind, who, trials), part in preferences.groupby(keys, sort=False):
        for rival in (TEST, LEAKY, CIRCUIT):
            if rival == who:
                continue
            over = part[f"over_{rival}"]
            right, other = int((over > 3).sum()), int((over < -3).sum())
            counts = (right, other, len(part) - right - other, over.mean())
            rows.append((kind, who, rival, trials, len(part), *counts))
    names = ["evidence", "observer", "rival", "trials", "observers"]
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
    """Return counts of pairs and of verdicts."""
    preferred = made["preferred"]
    return {
        "pairs": ("preferred", counted(preferred)),
        "verdicts": ("preferred", summed(preferred)),
    }


SCORE = Score("observers", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
