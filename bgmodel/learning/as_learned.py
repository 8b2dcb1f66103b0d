"""Decisions with settings learned from reward: circuit in spikes or populations, and the test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, interval, resampled
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.dopamine_learner import CRITERION, CircuitLearned, threshold_of
from bgmodel.learning.worlds import LevelOutcomes
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.engines import Engine, engine_of
from circuits.errors import require

TEST, POPULATIONS, SPIKES = "test", "circuit, populations", "circuit in spikes"
"""Who decides."""


def decide_as_learned(
    learned: CircuitLearned,
    evidence: Evidence,
    *,
    gaps: tuple[float, float] | None = None,
    engine: Engine | str = "ensemble",
    groups: npt.ArrayLike | None = None,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Let a circuit decide at its learned threshold, in spikes too, and the test at its gap.

    All decide the same trials, which were not used for learning; ``gaps`` are the learned and the
    best gap of the test, nats. One row per decider and measure, with 95 % bootstrap intervals:
    criterion (nats of OUT), accuracy, readings, cost (duration plus ``xi`` per error), regret and
    above_test (excess cost over the best criterion and over the test, per cent). The best criterion
    is that of the trials of learning, so that regret can fall below 0 by chance.
    """
    require(learned.what == CRITERION, "learned", "must be a learned criterion", learned.what)
    check_resamples(resamples, groups)
    decisions: dict[str, tuple[Tradeoff, float, float]] = {}
    if gaps is not None:
        learned_nats, best = (float(Msprt.threshold(gap)) for gap in gaps)
        swept = tradeoff(Msprt().run(evidence), evidence, _falling(learned_nats, best))
        decisions[TEST] = swept, learned_nats, best
    learned_nats = learned.threshold_nats
    best = float(threshold_of(learned.outcomes.best(learned.xi)[0]))
    for who, run in ((POPULATIONS, learned.model.engine), (SPIKES, engine_of(engine))):
        model = replace(learned.model, engine=run)
        levels = _falling(learned_nats, best)
        swept = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        decisions[who] = swept, learned_nats, best
    weights = resampled(evidence.trials, resamples, stream(seed, "bootstrap"), groups)
    parts = {who: _measures(*one, evidence, learned.xi, weights) for who, one in decisions.items()}
    rows = []
    for who, part in parts.items():
        if TEST in parts and who != TEST:
            part["above_test"] = 100 * (part["cost"] / parts[TEST]["cost"] - 1)
        rows += [(who, name, *interval(values)) for name, values in part.items()]
    return pd.DataFrame(rows, columns=["who", "measure", "value", "low", "high"])


def _measures(
    swept: Tradeoff, threshold: float, best: float, evidence: Evidence, xi: float, weights: Array
) -> dict[str, Array]:
    """Return the measures of decisions at a threshold, one value per row of weights."""
    outcomes = LevelOutcomes.of(swept, evidence)
    k, top = (int(np.abs(outcomes.levels - each).argmin()) for each in (threshold, best))
    share = weights / weights.sum(axis=1, keepdims=True)
    cost, least = (-share @ outcomes.rewards(xi)[each] for each in (k, top))
    return {
        "criterion": np.full(len(weights), threshold),
        "accuracy": share @ outcomes.correct[k],
        "readings": share @ outcomes.steps[k],
        "cost": cost,
        "regret": 100 * (cost / least - 1),
    }


def _falling(*levels: float) -> Array:
    return np.unique(levels)[::-1]
