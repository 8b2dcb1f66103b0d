"""Weights learned with a circuit in the loop, its confidence read from SNr: make score."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
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
from bgmodel.tactile.source import Tactile, held_out_taps
from bgmodel.tactile.task import Orientation, SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Populations, Spikes
from circuits.engines.engine import Engine
from figures.learning.tasks import ACCURACY, SCORING_SEED, mean_se
from figures.pieces import Piece, Score

STEP_MS, READINGS = 200.0, 12
"""Time between readings, several times the circuit's latency, and readings in a trial."""
SCORED_RUNS, SCORED_TRIALS = 6, 2000


@dataclass(frozen=True)
class Taught:
    """A circuit that learns: task, engine, runs and trials, and CPU seconds."""

    name: str
    task: Tactile
    engine: Engine
    runs: int
    trials: int
    seconds: float


LOOPS = (
    Taught("2 mm, populations", SameDifferent(2.0), Populations(), 16, 1500, 200),
    Taught("4 orientations, populations", Orientation(4, 2.0), Populations(), 16, 2000, 500),
    Taught("2 mm, spikes", SameDifferent(2.0), Spikes(), 1, 1500, 900),
)


def in_loop(loop: Taught) -> pd.DataFrame:
    """Return times at equal accuracy of a circuit with learned weights and exact likelihoods.

    Both decide on the same held-out readings with the same noise, by populations.
    """
    options = {"t_max": READINGS, "step_ms": STEP_MS}
    taps, held_out = tap_features(held_out_taps(), loop.task, **options)
    table = load_circuit(DEFAULT, len(taps.names))
    model = BasalGanglia(table, loop.engine, gain_of(table), SCORING_SEED)
    learned = learn_weights(
        taps, decider=InCircuit(model), seed=SCORING_SEED, runs=loop.runs,
        learner=WeightLearner(trials=loop.trials),
    )  # fmt: skip
    scored = replace(model, engine=Populations(), seed=SCORING_SEED + 1)
    ratios, times, exacts = [], [], []
    for run in range(min(loop.runs, SCORED_RUNS)):
        test = held_out.draw(SCORED_TRIALS, rng=stream(SCORING_SEED, "loop", loop.name, run))
        exacts.append(circuit_time_at_accuracy(scored, test.exact, ACCURACY))
        times.append(circuit_time_at_accuracy(scored, learned.to_evidence(test, run), ACCURACY))
        ratios.append(times[-1] / exacts[-1])
    assert learned.course is not None
    row = {"task": loop.name, "runs": len(ratios), "after": loop.trials,
             "correct": learned.course.correct[:, -200:].mean(),
             "learned_ms": np.mean(times), "exact_ms": np.mean(exacts),
             "slope": learned.calibration(test).slope.mean()}  # fmt: skip
    return pd.DataFrame([row | mean_se("relative_time", ratios)])


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per task and engine; the coarse form has fewer trials and no spikes."""
    for loop in LOOPS:
        if not (fast and loop.engine.spiking):
            one = replace(loop, trials=loop.trials // 10) if fast else loop
            seconds = one.seconds / (10 if fast else 1)
            yield Piece("times", one.name, one.trials, seconds, partial(in_loop, one))


SCORE = Score("weights_loop", SCORING_SEED, (2, 4), pieces, circuit=DEFAULT)
