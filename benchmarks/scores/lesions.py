"""Effects of edits on OUT versus theory, and control circuits, on scoring seeds: make score.

Shifts of OUT under constant evidence in spikes, compared with the fixed points of three sets of
laws; the noise of OUT and its sources, by theory; and three controls, each without one
computational component, compared with max-vs-average.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from benchmarks.scores.pieces import TABLE, Made, Piece, Score, main, wide
from bgmodel import stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.comparison.matched import matched_measures
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import MaxVsAverage
from bgmodel.integrators.sprt import Msprt
from bgmodel.integrators.steady import leader_drive, lesions, steady_shifts
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import load_circuit
from circuits.engines import Ensemble
from circuits.laws.controls import linear_stn, shuffled_stn
from circuits.laws.spectra import out_variance

SCORING_SEED = 40_002
CHANNELS, GAIN, AT = 4, 0.5, 0.95
LOG_ODDS = (1.75, 2.25, 2.75)
HELD, COARSE_HELD = 40, 10
"""Trials of held evidence."""
TRIALS, COARSE_TRIALS = 1000, 200
LAWS = {"table": "exact_nats", "cells": "own_laws_nats", "finite": "finite_nats"}
POSTERIOR = 0.85
"""Condition in which the noise of OUT is computed."""


def shifts(trials: int) -> pd.DataFrame:
    """Return the shift of OUT by each edit, measured and by theory."""
    table = load_circuit(TABLE, CHANNELS)
    return steady_shifts(table, lesions(table), LOG_ODDS, seed=SCORING_SEED, trials=trials)


def controls(trials: int, workers: int) -> pd.DataFrame:
    """Return the cost of removing each component, and of max-vs-average versus the MSPRT."""
    table = load_circuit(TABLE, CHANNELS)
    edited = {
        "GPe held at its rest": table.clamp("GPe"),
        "a linear STN": linear_stn(table),
        "STN's sum to the wrong channel": shuffled_stn(table),
    }
    rng = stream(SCORING_SEED, "control")
    evidence = gaussian_evidence(trials, d_prime=1.0, channels=CHANNELS, seed=rng)
    model = BasalGanglia(table, Ensemble(workers=workers), GAIN, SCORING_SEED)
    found = compare_edits(model, edited, evidence, seed=SCORING_SEED, accuracies=(AT,))
    change = found[(found["kind"] == "change") & (found["variant"] != "intact")]
    tests = (tradeoff(one.run(evidence), evidence) for one in (Msprt(GAIN), MaxVsAverage()))
    other = matched_measures(*tests, rng=stream(SCORING_SEED, "bootstrap"), accuracies=(AT,))
    # Max-vs-average has no circuit to compare with, so only its extra time is informative.
    other = other[other["measure"] == "extra_ms"].assign(variant="max-vs-average against the MSPRT")
    return pd.concat([change, other], ignore_index=True)


def noise() -> pd.DataFrame:
    """Return the scatter of OUT for two alternatives by theory, one row per population."""
    odds = np.log(POSTERIOR / (1 - POSTERIOR))
    drive = leader_drive(odds, 2)[0, 0]
    variance = {name: own[0] for name, own in out_variance(load_circuit(TABLE), drive).items()}
    total = sum(variance.values())
    rows = [(name, POSTERIOR, np.sqrt(total), own / total) for name, own in variance.items()]
    return pd.DataFrame(rows, columns=["population", "posterior", "sd_nats", "share"])


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the shifts, the controls and the scatter."""
    held, trials = (COARSE_HELD, COARSE_TRIALS) if fast else (HELD, TRIALS)
    yield Piece("shifts", "held evidence", held, 2 * held, partial(shifts, held))
    make = partial(controls, trials, workers)
    yield Piece("controls", "decisions", trials, 0.15 * trials, make)
    yield Piece("noise", "theory", 0, 1, noise)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the distance of each law from spikes, the controls and the scatter."""
    found, rows = made["shifts"], []
    for law, column in LAWS.items():
        off = (found["value"] - found[column]).abs()
        held = found[column].between(found["low"], found["high"])
        worst = found.loc[off.idxmax()]
        row = {"laws": law, "median_nats": off.median(), "most_nats": off.max()}
        row |= {"worst": worst["variant"], "within": held.sum(), "measured": len(found)}
        rows.append(row | {"interval_nats": ((found["high"] - found["low"]) / 2).median()})
    shown = made["controls"]
    shown = shown[shown["measure"].isin(("within_50_ms", "extra_ms"))]
    return {
        "laws": ("shifts", pd.DataFrame(rows)),
        "controls": ("controls", wide(shown, ["variant", "accuracy"])),
        "noise": ("noise", made["noise"]),
    }


SCORE = Score("lesions", SCORING_SEED, (2, 4), pieces, tables)

if __name__ == "__main__":
    main(SCORE)
