"""Levels of dopamine as thresholds, scored: make score.

Figure D2 on a held-out seed: the posterior at each level of dopamine, and accuracy at equal time
compared with the MSPRT and the MSPRT at the circuit's gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.deciding.tradeoff import MARGIN
from bgmodel.learning.dopamine import ENGINES, LATENCY_MS, STEPS, levels_against_msprt
from circuits.anatomy import DEFAULT
from figures.pieces import Made, Piece, Score

SCORING_SEED = 40_007
TRIALS, COARSE_TRIALS, COARSE_EVERY = 2000, 200, 2
SECONDS = {"rate": 0.1, "population": 0.1, "spikes": 0.2}
"""CPU time of a trial at all levels, about, per alternative."""
ASKED = (0.75, 0.99)
"""Posteriors that dopamine should span."""
NOISE = 0.02
"""Above this share of responses before the first reading, decisions are attributed to noise."""
REFERENCES = {"": MSPRT, "own_": MSPRT_AT_GAIN}


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield numbers of alternatives by engine; threads are the engine's own."""
    trials, every = (COARSE_TRIALS, COARSE_EVERY) if fast else (TRIALS, 1)
    for channels in STEPS:
        for engine in ENGINES:
            make = partial(
                levels_against_msprt, SCORING_SEED, trials, every, (channels,), (engine,)
            )
            seconds = SECONDS[engine.id] * trials * channels
            yield Piece("levels", f"N = {channels}, {engine.id}", trials, seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return, for each circuit, the posteriors spanned and the largest gap of those asked."""
    rows = []
    index, levels = ["channels", "engine", "level"], made["levels"]
    by = {name: part.set_index(index) for name, part in levels.groupby("measure")}
    known = by["mean_posterior"]["value"]
    known = known[by["premature"]["value"].loc[known.index] <= NOISE]
    at: Any
    for at, part in known.groupby(level=[0, 1], sort=False):
        channels, engine = at
        inside = part.index[part.between(*ASKED)]
        row = {"channels": channels, "engine": engine, "latency_ms": LATENCY_MS[channels]}
        row |= {"lowest": part.min(), "highest": part.max(), "levels": len(part)}
        row["falls"] = bool(np.all(np.diff(part.sort_index()) < 0))
        for short, name in REFERENCES.items():
            gaps = by["accuracy_gap"]
            gaps = gaps[gaps["reference"] == name].loc[inside]
            # A time that the test's curve does not reach is no gap of 0.
            worst = gaps.loc[gaps["value"].abs().fillna(np.inf).idxmax()]
            row |= {f"{short}gap": worst["value"]}
            row |= {f"{short}gap_{end}": worst[end] for end in ("low", "high")}
            within = gaps[["low", "high"]].abs().max(axis=1) <= MARGIN
            row |= {f"{short}within": within.sum(), "gaps": len(gaps)}
        rows.append(row)
    return {"gaps": ("levels", pd.DataFrame(rows))}


SCORE = Score("levels", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
