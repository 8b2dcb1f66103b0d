"""The decision times that Bogacz & Gurney (2007) print with their figure 3, at ten alternatives.

Their problem: one channel has a mean of 1.41 per second, the others 0, each with noise of 0.33
after a second, read every ms, and each test decides at the threshold for 1 % errors. All tests see
the same trials. Bounds on the threshold come from trials of another seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial, reduce
from operator import add
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import Msprt, stream
from bgmodel.bootstrap import RESAMPLES, resampled
from bgmodel.deciding.tradeoff import Tradeoff, curve, levels, time_at, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.baselines import Lca, LinearGpe, MaxVsNext, Race
from bgmodel.integrators.sprt import Integrator
from bgmodel.simulated_evidence import separated_evidence
from circuits.anatomy import DEFAULT
from figures.pieces import Made, Piece, Score

SCORING_SEED, TUNING_SEED = 72_001, 72_002
"""Of the trials, and of those that only say about where the thresholds lie."""
MEAN, NOISE, STEP_MS = 1.41, 0.33, 1.0
"""Mean a second of the true channel, noise after a second, and time between readings."""
ACCURACY = 0.99
"""Share of right choices at which times are printed."""
SHOWN = 10
"""Alternatives at which times are printed."""
TRIALS, COARSE_TRIALS, BATCH = 10_000, 2000, 250
STEPS = 2000
SECONDS = 0.001
"""CPU time of a trial and alternative, about, with all tests."""
MODELS: dict[str, Integrator] = {
    "MSPRT": Msprt(),
    "MSPRTb": MaxVsNext(),
    "UM": Lca(),
    "race": Race(),
    "linear GPe": LinearGpe(),
    "linear GPe, gain 0.4, a 0.84": LinearGpe(0.4, 0.84),
}
"""Tests by name: MSPRTb is the limit of the MSPRT for a high gain, UM of Usher & McClelland."""
PRINTED_MS = {"UM": 628, "race": 676, "linear GPe": 607, "linear GPe, gain 0.4, a 0.84": 545}
"""Printed times at that number."""


def drawn(trials: int, alternatives: int, seed: int, first: int) -> Evidence:
    """Draw trials of their problem, in log likelihoods."""
    separation = MEAN / NOISE * np.sqrt(STEP_MS / 1000)
    rng = stream(seed, "published", str(alternatives), str(first))
    return separated_evidence(
        trials, STEPS, separation, rng=rng, hypotheses=alternatives, step_ms=STEP_MS
    )


Draw = Callable[[int, int], Evidence]
"""From a seed and the number of the first trial, a batch."""


def times(
    models: Mapping[str, Integrator], draw: Draw, trials: int, accuracy: float
) -> pd.DataFrame:
    """Return the mean time of each test at an accuracy, and its excess over that of the first.

    Intervals of 95 % by a bootstrap over trials, that of the threshold in them.
    """
    pilot = draw(TUNING_SEED, 0)
    marks = {name: levels(model.run(pilot), pilot, (accuracy,)) for name, model in models.items()}
    parts: dict[str, list[Tradeoff]] = {name: [] for name in models}
    for first in range(0, trials, BATCH):
        evidence = draw(SCORING_SEED, first)
        for name, model in models.items():
            parts[name].append(tradeoff(model.run(evidence), evidence, marks[name]))
    weights = resampled(trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"))
    by_model = {
        name: time_at([accuracy], curve(reduce(add, some), weights))[:, 0]
        for name, some in parts.items()
    }
    optimal = next(iter(by_model.values()))
    rows = []
    for name, time in by_model.items():
        row: dict[str, Any] = {"model": name}
        for what, values in (("time_ms", time), ("longer_ms", time - optimal)):
            low, high = np.quantile(values[1:], (0.025, 0.975))
            row |= {what: values[0], f"{what}_low": low, f"{what}_high": high}
        rows.append(row)
    return pd.DataFrame(rows)


def at_errors(models: Mapping[str, Integrator], alternatives: int, trials: int) -> pd.DataFrame:
    """Return times at the printed share of errors."""
    draw = partial(drawn, BATCH, alternatives)
    return times(models, draw, trials, ACCURACY).assign(alternatives=alternatives)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the one piece; threads are not used."""
    trials = COARSE_TRIALS if fast else TRIALS
    make = partial(at_errors, MODELS, SHOWN, trials)
    yield Piece("alternatives", f"N = {SHOWN}", trials, SECONDS * trials * SHOWN, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return times, with the printed numbers."""
    rows = made["alternatives"]
    return {"alternatives": ("alternatives", rows.assign(printed_ms=rows["model"].map(PRINTED_MS)))}


SCORE = Score("published", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)
