"""The worst changes of one number of the default table, again in spikes: make score.

``sensitivity`` finds, with populations, the changes that reduce r of decision times most after
homeostasis has restored all resting rates; its table names them. Here they are repeated in spikes
on the first trials of the same evidence, each compared with the unedited circuit. If the table
names other changes than before, their pieces are computed again.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from benchmarks.pages import TABLES
from benchmarks.scores import sensitivity
from benchmarks.scores.pieces import Made, Piece, Score, main, wide
from benchmarks.scores.sensitivity import BIASES, MEASURES, SHOWN, Case
from bgmodel.comparison.edited import compare_edits
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.support.files import read_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Ensemble

TRIALS, COARSE_TRIALS = 600, 200
SECONDS = 0.15
"""CPU time of a trial of a change, about."""
SHARED = ["channels", "fraction", "variant"]


def in_spikes(
    channels: int, fraction: float, variant: str, trials: int, workers: int
) -> pd.DataFrame:
    """Return the effect of a change on each measure, in spikes.

    Parameters
    ----------
    channels : int
        Number of alternatives.
    fraction, variant : float, str
        The change, and what ``sensitivity`` calls it.
    trials, workers : int
        Trials of each circuit; threads.
    """
    table, seed = load_circuit(DEFAULT, channels), sensitivity.SCORING_SEED
    found = compare_edits(
        BasalGanglia(table, Ensemble(workers=workers), gain_of(table), seed),
        {variant: Case(channels, fraction, True, BIASES).edited()[variant]},
        sensitivity.evidence(channels, sensitivity.TRIALS)[:trials],
        seed=seed,
        accuracies=SHOWN[1:],
        resamples=200,
    )
    found = found[(found["kind"] == "change") & found["measure"].isin(MEASURES)]
    found = wide(found[found["variant"] == variant], ["variant", "accuracy"])
    return found.assign(channels=channels, fraction=fraction, trials=trials)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece for each change that the table names."""
    path = TABLES / "sensitivity_worst.csv"
    if not path.is_file():
        return
    trials = COARSE_TRIALS if fast else TRIALS
    for row in read_table(path).itertuples():
        make = partial(in_spikes, row.channels, row.fraction, row.variant, trials, workers)
        name = f"N = {row.channels}, {row.variant}"
        yield Piece("changes", name, trials, SECONDS * trials, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return each change, in spikes and with populations."""
    found = made["changes"].drop(columns="accuracy")
    for name in MEASURES:
        new = {f"{name}{end}": f"{name}_spikes{end}" for end in ("", "_low", "_high")}
        found = found.rename(columns=new)
    found = found.rename(columns={"trials": "trials_spikes"})
    named = read_table(TABLES / "sensitivity_worst.csv")
    return {"changes": ("changes", named.merge(found, on=SHARED))}


SCORE = Score("worst", sensitivity.SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
