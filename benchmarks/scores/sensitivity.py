"""Every number of spiking_msprt 20 % up and down, on scoring seeds: make score.

What a change does at the threshold that was kept, and what is left of the agreement with the MSPRT
once the threshold is tuned anew to the same accuracy. The coarse form takes every fourth change.
Figure C4 shows the same on fewer trials.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from benchmarks.scores.pieces import TABLE, Made, Piece, Score, main, wide
from bgmodel import stream
from bgmodel.comparison.circuits import compare_edits
from bgmodel.evidence import gaussian_evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from circuits.anatomy import circuit
from circuits.controls import perturbed

SCORING_SEED = 40_004
AT = 0.95
TRIALS, COARSE_TRIALS, COARSE_EVERY = 1000, 200, 4
SECONDS = 0.008
"""CPU time of a trial of a change, about."""
MEASURES = ("pearson_r", "agreement", "extra_ms")
MOST = 8
"""So many changes are shown."""


def changes(trials: int, every: int, workers: int) -> pd.DataFrame:
    """Return the effect of each change on each measure; NaN where the accuracy is not reached.

    ``lost_kept`` is the accuracy that is lost at the threshold that was kept.
    """
    rng = stream(SCORING_SEED, "sensitivity")
    evidence = gaussian_evidence(trials, 25, 1 / np.sqrt(2), rng=rng, step_ms=50.0)
    table = circuit(TABLE)
    edited = dict(list(perturbed(table).items())[::every])
    model = BasalGanglia(table, "ensemble", gain_of(table), SCORING_SEED, {"workers": workers})
    found = compare_edits(
        model, edited, evidence, seed=SCORING_SEED, accuracies=(AT,), resamples=500
    )
    change = found[(found["kind"] == "change") & found["measure"].isin(MEASURES)]
    kept = found[(found["kind"] == "fixed") & (found["measure"] == "expected_accuracy")]
    kept = kept.set_index("variant")["value"]
    by = wide(change[change["variant"] != "intact"], ["variant"])
    return by.assign(lost_kept=(kept["intact"] - kept.loc[by["variant"]]).to_numpy())


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the one piece."""
    trials, every = (COARSE_TRIALS, COARSE_EVERY) if fast else (TRIALS, 1)
    count = len(perturbed(circuit(TABLE))) / every
    make = partial(changes, trials, every, workers)
    yield Piece("changes", "all", trials, SECONDS * trials * count, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a summary in one row, the changes that move most, and those that never get there."""
    found = made["changes"]
    known = found["pearson_r"].notna()
    summary = {"accuracy": AT, "changes": len(found), "reached": known.sum()}
    summary |= {name: found[name].median() for name in MEASURES}
    summary |= {"r_falls": (found["pearson_r_high"] < 0).sum()}
    summary |= {"r_rises": (found["pearson_r_low"] > 0).sum()}
    size = found["pearson_r"].abs().sort_values(ascending=False)
    return {
        "summary": ("changes", pd.DataFrame([summary])),
        "most": ("changes", found.loc[size.index[:MOST]]),
        "not_reached": ("changes", found.loc[~known, ["variant", "lost_kept"]]),
    }


SCORE = Score("sensitivity", SCORING_SEED, (2,), pieces, tables)

if __name__ == "__main__":
    main(SCORE)
