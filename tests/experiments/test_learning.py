"""Experiments that begin with learning: what is shared, what differs, and bad input."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.learning import Learning, heard
from bgmodel.experiments.record import Changes
from bgmodel.learning import weights
from bgmodel.learning.learned_weights import LearnedWeights
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Gaussian
from bgmodel.trials.task_trials import EvidenceTable
from circuits.declaration.edits import Edits
from circuits.errors import NoiseWarning
from tests.helpers import refusing

GRATINGS = SameDifferent(trials=120, t_max=20, step_ms=100.0)
QUICK = Learning(trials=300, runs=2)
PLAIN = Experiment(
    name="learning", note="for a test", task=GRATINGS, engine="rate", seed=3,
    manipulation=Changes(Edits(["dopamine 0.9"])),
)  # fmt: skip


def test_exact_weights_are_exact_evidence():
    """Poisson-like units with weights that give the likelihoods themselves: heard is exact."""
    features = QUICK.features(replace(GRATINGS, trials=6), seed=1)
    pinned = replace(features, values=features.log_likelihood)
    learned = LearnedWeights(np.stack([np.eye(2)] * 2), features.names)
    assert heard(learned, pinned).log_likelihood == pytest.approx(features.log_likelihood)


def test_trials_are_divided_among_the_runs():
    features = QUICK.features(replace(GRATINGS, trials=6), seed=1)
    weights = np.random.default_rng(2).normal(size=(2, 2, features.units))
    learned = LearnedWeights(weights, features.names)
    log_likelihood = heard(learned, features).log_likelihood
    for run in range(2):
        same = learned.log_likelihoods(features, run)
        assert log_likelihood[run::2] == pytest.approx(same[run::2])


def test_both_conditions_decide_on_what_was_learned():
    taught = replace(PLAIN, learning=QUICK)
    drawn = taught.given()
    models = [condition.model(2) for condition in taught.conditions]
    control, manipulation = taught.heard(models, drawn)
    # Learned at the fixed point: the edit changes the decisions, not the weights.
    assert np.array_equal(control.log_likelihood, manipulation.log_likelihood)
    assert not np.allclose(control.log_likelihood, drawn.evidence.log_likelihood)
    assert np.array_equal(control.truth, drawn.evidence.truth)
    done = taught.run()
    times = done.measures.set_index(["condition", "measure"])["value"]
    assert times["change", "mean_ms"] > 0
    assert "learned from 300 trials by the rule confidence, runs 2" in done.text()


def test_a_condition_without_learning_decides_on_the_exact_likelihoods():
    one = replace(PLAIN, manipulation=Changes(learning=QUICK))
    one.check_differs()
    drawn = one.given()
    control, manipulation = one.heard([c.model(2) for c in one.conditions], drawn)
    assert control is drawn.evidence
    assert not np.allclose(control.log_likelihood, manipulation.log_likelihood)


def test_a_truth_selects_the_same_trials_for_both():
    one = replace(PLAIN, manipulation=Changes(learning=QUICK), truth=1)
    drawn = one.given()
    _, learned = one.heard([c.model(2) for c in one.conditions], drawn)
    assert learned.trials == drawn.evidence.trials == 60
    assert (learned.truth == 1).all()


def test_a_circuit_learns_with_its_own_edits():
    quick = Learning(trials=4, runs=2, in_circuit=True)
    both = replace(PLAIN, learning=quick, manipulation=Changes(Edits(["dopamine 0.8"])))
    control, manipulation = both.heard([c.model(2) for c in both.conditions], both.given())
    assert not np.array_equal(control.log_likelihood, manipulation.log_likelihood)


EXPECTED = Gaussian(expectancy_nats=1.0, expectancy_ms=100.0)
ALIKE = replace(PLAIN, learning=QUICK, manipulation=Changes(learning=QUICK))


test_learning_that_makes_no_sense_is_refused = refusing(
    (lambda: replace(PLAIN, task=Gaussian(conflict=0.3), learning=QUICK), "conflict must be 0"),
    (lambda: replace(PLAIN, task=EXPECTED, learning=QUICK), "expectancy_nats must be 0"),
    (lambda: QUICK.check(EvidenceTable("mine.csv")), "learning .*no sensory units"),
    (lambda: replace(QUICK, posterior=0.0).check(GRATINGS), "posterior"),
    (lambda: replace(QUICK, posterior=0.5).check(GRATINGS), "posterior"),
    (lambda: replace(QUICK, posterior=1.0).check(GRATINGS), "posterior"),
    (lambda: Learning(rule=["q"]), "rule"),
    (lambda: Learning(critic=["q"]), "critic"),
    (lambda: Learning(in_circuit="yes"), "in_circuit"),
    (ALIKE.check_differs, "manipulation .*changes nothing"),
)


def test_learning_too_large_for_memory_is_refused_before_the_run():
    for huge in ({"trials": 10**12}, {"units": 10**9}):
        with pytest.raises(ValueError, match="memory"):
            replace(QUICK, **huge).check(GRATINGS)


def test_every_setting_reaches_the_learner(monkeypatch):
    seen = {}
    monkeypatch.setattr(
        weights, "learn_weights", lambda source, **kw: seen.update(kw, source=source)
    )
    asked = Learning(7, 3, "q", "mean", False, 0.7, 3.0, 2.0, 0.8, 5)
    asked.learned(Gaussian(), None, seed=4)
    learner = seen["learner"]
    assert (learner.trials, learner.gain_plus, learner.gain_minus) == (7, 3.0, 2.0)
    assert (seen["rule"], seen["critic"], seen["runs"], seen["seed"]) == ("q", "mean", 3, 4)
    assert (seen["decider"].criterion, seen["feedback"].valid) == (0.7, 0.8)
    assert seen["source"].units == 5


def test_intervals_include_the_differences_between_runs():
    taught = replace(PLAIN, learning=Learning(runs=12))
    assert np.array_equal(taught.groups(30), np.arange(30) % 12)
    assert PLAIN.groups(30) is None
    both = replace(taught, manipulation=Changes(learning=Learning(runs=8)))
    assert np.array_equal(both.groups(30), np.arange(30) % 4)
    with pytest.warns(NoiseWarning, match="differences between runs"):
        assert replace(PLAIN, learning=Learning(runs=1)).groups(30) is None
