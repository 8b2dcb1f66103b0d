"""Decisions of test and circuit at what reward taught each of them."""

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.dopamine_learner import (
    CRITERION,
    LEVEL,
    POPULATIONS,
    SPIKES,
    TEST,
    CircuitLearned,
    criterion_outcomes,
    decide_as_learned,
)
from bgmodel.learning.reinforce import Learned
from bgmodel.simulated_evidence import gaussian_evidence
from tests.helpers import refused

XI, GAP = 50.0, 5.0
EVIDENCE = gaussian_evidence(100, d_prime=1, t_max=30, seed=5)
EXACT = BasalGanglia("bogacz_gurney", "algebra", 1.0)
LEVELS = np.linspace(0.5, 4, 7)


def learned(value, model=EXACT, what=CRITERION):
    """Return what a circuit has learned if all runs end at a value."""
    fresh = criterion_outcomes(model, EVIDENCE, LEVELS)
    ends = Learned(*np.full((4, 2, 9), value), np.full(2, value))
    return CircuitLearned(model, ends, fresh, fresh, XI, LEVELS[0], what)


def test_an_exact_circuit_at_the_gap_of_the_test_decides_as_the_test():
    """At the fixed point OUT is -ln P: half a gap is the log odds at which both decide."""
    table = decide_as_learned(
        learned(GAP / 2), EVIDENCE, gaps=(GAP, GAP), engine="algebra", resamples=200
    )
    wide = table.set_index(["who", "measure"])
    test = Msprt().decide(EVIDENCE, float(Msprt.threshold(GAP)))
    for who in (TEST, POPULATIONS, SPIKES):
        assert wide.loc[(who, "accuracy"), "value"] == pytest.approx(test.accuracy)
        readings = test.time_ms.mean() / EVIDENCE.step_ms
        assert wide.loc[(who, "readings"), "value"] == pytest.approx(readings)
        cost = XI * (1 - test.accuracy) + readings
        assert wide.loc[(who, "cost"), "value"] == pytest.approx(cost)
    above = wide.xs("above_test", level="measure")
    np.testing.assert_allclose(above[["value", "low", "high"]], 0, atol=1e-9)
    assert set(above.index) == {POPULATIONS, SPIKES}


def test_regret_is_what_the_best_threshold_of_the_trials_for_learning_would_have_saved():
    rewards = criterion_outcomes(EXACT, EVIDENCE, LEVELS).rewards(XI).mean(axis=1)
    for k, regret in enumerate(100 * (rewards / rewards.max() - 1)):
        table = decide_as_learned(
            learned(LEVELS[k]), EVIDENCE, engine="algebra", groups=np.arange(100) % 10
        )
        rows = table.set_index(["who", "measure"])
        assert TEST not in rows.index.get_level_values("who")
        value, low, high = rows.loc[(SPIKES, "regret"), ["value", "low", "high"]]
        assert value == pytest.approx(regret)
        assert low <= value <= high


def test_a_level_of_dopamine_is_no_threshold():
    with refused("learned criterion"):
        decide_as_learned(learned(1.0, what=LEVEL), EVIDENCE, engine="algebra")
