"""Decisions at what reward taught: circuit in spikes, circuit by populations, and the test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, interval, resampled
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.sprt import Msprt, msprt_threshold_from_gap
from bgmodel.learning.dopamine_learner import CRITERION, CircuitLearned, threshold_of
from bgmodel.learning.worlds import LevelOutcomes
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.engines import Engine, engine_of
from circuits.errors import require

TEST, POPULATIONS, SPIKES = "test", "circuit, populations", "circuit in spikes"
"""Who decides."""
LOWER = 0.6
"""Lowest threshold at which spikes are tried, as a share of the learned one: lower ones take
longer, and the regret of a criterion is known once the cost rises on both sides of it."""


def decide_as_learned(
    learned: CircuitLearned,
    evidence: Evidence,
    *,
    gap: float | None = None,
    engine: Engine | str = "ensemble",
    groups: npt.ArrayLike | None = None,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Let a circuit decide at its learned threshold, in spikes too, and the test at its gap.

    All decide the same trials, which were not used for learning. The cost of a trial is its
    duration plus ``xi`` readings for an error.

    Parameters
    ----------
    learned : CircuitLearned
        The circuit and its learned threshold, as from ``learn_in_circuit``.
    evidence : Evidence
        Readings of the trials, with their truth.
    gap : float, optional
        Gap that the test has learned, nats; without it the test is left out.
    engine : Engine or str
        Engine that simulates spikes.
    groups, resamples : optional
        As for ``bootstrap.resampled``.
    seed : int
        Seed of the bootstrap.

    Returns
    -------
    DataFrame
        One row per decider and measure: who, measure, value, low, high (95 % interval, a bootstrap
        over trials or their groups). Measures: criterion (the learned OUT, nats), accuracy,
        readings (mean decision time), cost (readings), regret (excess cost over the best threshold
        on these trials, per cent) and above_test (excess cost over the test, per cent). The best
        threshold is chosen on the trials on which it is scored, which raises the regret a little.

    Raises
    ------
    ValueError
        If a level of dopamine was learned instead, or the truth is not known.
    """
    require(learned.what == CRITERION, "learned", "must be a learned criterion", learned.what)
    check_resamples(resamples, groups)
    levels = threshold_of(np.union1d(learned.fresh.levels, learned.value))
    level = learned.threshold_nats
    levels = levels[levels >= LOWER * level]
    found = {}
    if gap is not None:
        criterion = float(msprt_threshold_from_gap(gap))
        others = -np.log(np.linspace(0.55, 0.999, 60))
        falling = np.union1d(others, criterion)[::-1]
        found[TEST] = tradeoff(Msprt().run(evidence), evidence, falling), criterion
    for who, run in ((POPULATIONS, learned.model.engine), (SPIKES, engine_of(engine))):
        model = replace(learned.model, engine=run)
        swept = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        found[who] = swept, level
    weights = resampled(evidence.trials, resamples, stream(seed, "bootstrap"), groups)
    parts = {who: _measures(*one, evidence, learned.xi, weights) for who, one in found.items()}
    rows = []
    for who, part in parts.items():
        if TEST in parts and who != TEST:
            part["above_test"] = 100 * (part["cost"] / parts[TEST]["cost"] - 1)
        rows += [(who, name, *interval(values)) for name, values in part.items()]
    return pd.DataFrame(rows, columns=["who", "measure", "value", "low", "high"])


def _measures(
    swept: Tradeoff, level: float, evidence: Evidence, xi: float, weights: Array
) -> dict[str, Array]:
    """Return the measures of decisions at a threshold, one value per row of weights."""
    outcomes = LevelOutcomes.of(swept, evidence)
    k = int(np.abs(outcomes.levels - level).argmin())
    share = weights / weights.sum(axis=1, keepdims=True)
    return {
        "criterion": np.full(len(weights), level),
        "accuracy": share @ outcomes.correct[k],
        "readings": share @ outcomes.steps[k],
        "cost": -share @ outcomes.rewards(xi)[k],
        "regret": outcomes.regrets(level, xi, weights),
    }
