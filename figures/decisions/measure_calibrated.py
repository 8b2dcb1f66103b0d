"""Calibration of taps: posteriors compared with the share of correct choices.

If the likelihoods are correct, the share of correct choices among decisions with a posterior p is
p, and the MSPRT with the criterion P errs in at most 1 - P of the decisions that cross it. Taps are
simulated ones of gratings and real ones of an edge; likelihoods are fitted and scored on different
taps.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel import Msprt, stream
from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.tactile.source import Folds, folds
from bgmodel.tactile.task import EdgeTurn, Orientation
from figures.decisions.kinds import gratings
from figures.pieces import Piece, Score

SCORING_SEED = 75_001
TACTILE = (2, 4, 8)
"""Alternatives: orientations of a grating, or differences of an edge's yaw."""
GRATINGS_MM = (2.0, 2.5)
SPACING_DEG = 5.0
"""Spacing of the yaw differences of pairs of real taps."""
EDGE = f"real taps, edge {SPACING_DEG:g} degrees"
TAPS = 60
TRIALS, COARSE_TRIALS = 12_000, 1200
POSTERIORS = (0.6, 0.7, 0.8, 0.9, 0.95, 0.97, 0.99)


@cache
def edges(alternatives: int) -> Folds:
    """Return readings of pairs of real taps of an edge; the decoder is trained here."""
    return folds(decoded(), EdgeTurn(alternatives, SPACING_DEG))


@cache
def decoded() -> pd.DataFrame:
    """Return decoded real taps."""
    from bgmodel.tactile.source import decoded_edges

    return decoded_edges(SCORING_SEED, Path(os.environ["BGMODEL_RECORDINGS"]))


def sources_of(evidence: str, alternatives: int) -> Folds:
    """Return the readings of a kind of taps."""
    if evidence == EDGE:
        return edges(alternatives)
    return gratings(Orientation(alternatives, float(evidence.split()[1])))


def tapped(
    evidence: str, alternatives: int, trials: int, seed: int
) -> tuple[Evidence, npt.NDArray[np.intp]]:
    """Draw trials of a kind of taps; return them with the number of each trial's fold."""
    source = sources_of(evidence, alternatives)
    rng = stream(seed, "taps", evidence, str(alternatives))
    taps = source.draw(trials, TAPS, rng=rng)
    return taps, np.arange(trials) % len(source.sources)


def criteria(evidence: Evidence, groups: npt.NDArray[np.intp]) -> pd.DataFrame:
    """Return accuracy, mean posterior and mean number of taps of the MSPRT at each criterion.

    Intervals are over whole groups of taps.
    """
    decided = tradeoff(Msprt().run(evidence), evidence, -np.log(POSTERIORS))
    weights = resampled(evidence.trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"), groups)
    rows = []
    for k, level in enumerate(np.exp(-decided.settings)):
        row = {"criterion": level, "forced": decided.forced[k].mean()}
        right = decided.choice[k] == evidence.truth
        measures = {
            "accuracy": right,
            "expected": decided.posterior[k],
            "taps": decided.time_ms[k] / evidence.step_ms,
            "excess": right - decided.posterior[k],
        }
        for name, values in measures.items():
            mean, low, high = interval(weights @ values / weights.sum(axis=1))
            row |= {name: mean, f"{name}_low": low, f"{name}_high": high}
        rows.append(row)
    return pd.DataFrame(rows)


def kinds() -> list[str]:
    """Return the kinds of taps; real ones if ``BGMODEL_RECORDINGS`` names their folder."""
    simulated = [f"grating, {period:g} mm" for period in GRATINGS_MM]
    return simulated + [EDGE] * ("BGMODEL_RECORDINGS" in os.environ)


def scored(evidence: str, alternatives: int, trials: int) -> pd.DataFrame:
    """Return the criteria on a kind of taps."""
    table = criteria(*tapped(evidence, alternatives, trials, SCORING_SEED))
    return table.assign(evidence=evidence, alternatives=alternatives)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the criteria of each kind of taps; threads are not used."""
    trials = COARSE_TRIALS if fast else TRIALS
    for evidence in kinds():
        for count in TACTILE:
            make = partial(scored, evidence, count, trials)
            yield Piece("criteria", f"{evidence} N = {count}", trials, 5, make)


SCORE = Score("calibrated", SCORING_SEED, (), pieces)
