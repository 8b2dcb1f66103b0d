"""Weights learned with a circuit in the loop, its confidence read from SNr: make score."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.deciders import InCircuit, WeightLearner
from bgmodel.learning.feature_sources import tap_features
from bgmodel.learning.learned_weights import circuit_time_at_accuracy
from bgmodel.learning.weights import learn_weights
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Populations
from figures.learning.tasks import ACCURACY, SCORING_SEED, mean_se
from figures.pieces import Piece, Score

STEP_MS, READINGS = 200.0, 12
"""Time between readings, several times the circuit's latency, and readings in a trial."""
SCORED_RUNS, SCORED_TRIALS = 6, 2000


LEARNED_RUNS, LEARNED_TRIALS = 16, 1500
NAME = "2 mm, populations"
"""The task and the engine: they name the readings too."""


def in_loop(trials: int) -> pd.DataFrame:
    """Return times at equal accuracy of a circuit with learned weights and exact likelihoods.

    Both decide on the same held-out readings with the same noise.
    """
    options = {"t_max": READINGS, "step_ms": STEP_MS}
    taps, held_out = tap_features(held_out_taps(), SameDifferent(2.0), **options)
    table = load_circuit(DEFAULT, len(taps.names))
    model = BasalGanglia(table, Populations(), gain_of(table), SCORING_SEED)
    learned = learn_weights(
        taps, decider=InCircuit(model), seed=SCORING_SEED, runs=LEARNED_RUNS,
        learner=WeightLearner(trials=trials),
    )  # fmt: skip
    scored = replace(model, seed=SCORING_SEED + 1)
    ratios, times, exacts = [], [], []
    for run in range(SCORED_RUNS):
        test = held_out.draw(SCORED_TRIALS, rng=stream(SCORING_SEED, "loop", NAME, run))
        exacts.append(circuit_time_at_accuracy(scored, test.exact, ACCURACY))
        times.append(circuit_time_at_accuracy(scored, learned.to_evidence(test, run), ACCURACY))
        ratios.append(times[-1] / exacts[-1])
    assert learned.course is not None
    row = {"task": NAME, "runs": len(ratios), "after": trials,
           "correct": learned.course.correct[:, -200:].mean(),
           "learned_ms": np.mean(times), "exact_ms": np.mean(exacts),
           "slope": learned.calibration(test).slope.mean()}  # fmt: skip
    return pd.DataFrame([row | mean_se("relative_time", ratios)])


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the one piece."""
    trials = LEARNED_TRIALS // (10 if fast else 1)
    seconds = 200 / (10 if fast else 1)
    yield Piece("times", NAME, trials, seconds, partial(in_loop, trials))


SCORE = Score("weights_loop", SCORING_SEED, (2,), pieces, circuit=DEFAULT)
