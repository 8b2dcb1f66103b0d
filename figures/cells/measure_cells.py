"""Recorded striatal cells and choices: held-out nats of models and regressions, and controls."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from figures.cells.compared import MODELS, SHIPPED, controls, regressed, scored
from figures.pieces import Made, Piece, Score, main

SEED, TRIALS = 76_001, 8601


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield regressions with and without recent rates, models, and shuffled spikes."""
    for past in (True, False):
        name = "recent rate" if past else "course"
        yield Piece("regressed", name, TRIALS, 20, partial(regressed, SHIPPED, past))
    yield Piece("controls", "shuffled", TRIALS, 120, partial(controls, SHIPPED, SEED))
    for model in ("exponential",) if fast else MODELS:
        yield Piece("scored", model, TRIALS, 300, partial(scored, SHIPPED, model))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return nats by model and by cell, and gains."""
    regressions, scores = made["regressed"], made["scored"]
    known = regressions[regressions["past"]]
    base = known[known["model"] == "psth"].set_index("cell")["apart"]
    total = regressions.groupby(["model", "past"], as_index=False)["apart"].sum()
    plain = total[(total["model"] == "psth") & ~total["past"]]["apart"].iloc[0]
    total["over_course"] = total["apart"] - plain
    total["over_recent"] = total["apart"] - base.sum()
    whole = scores[scores["cell"] == "all"].drop(columns=["cell", "apart"]).set_index("model")
    cells = scores[scores["cell"] != "all"][["model", "cell", "apart"]]
    whole["apart"] = cells.groupby("model")["apart"].sum() - base.sum()
    whole["over_course"] = whole["together"] - plain
    whole["together"] -= base.sum()
    both = pd.concat([cells, known[known["model"] != "psth"][["model", "cell", "apart"]]])
    both["apart"] -= both["cell"].map(base)
    return {
        "regressions": ("regressed", total.drop(columns="apart")),
        "models": ("scored", whole.reset_index()),
        "each": ("scored", both.rename(columns={"apart": "nats"})),
        "gains": ("controls", made["controls"]),
    }


SCORE = Score("cells", SEED, (), pieces, tables, circuit="")

if __name__ == "__main__":
    main(SCORE)
