"""A circuit that decides by values: choices, times, a loop with a learner, and bad input."""

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.learning.bandit import Bandit, ValueCircuit, play
from bgmodel.learning.value_learners import QBoth
from tests.helpers import refusing


@pytest.fixture(scope="module")
def circuit():
    return ValueCircuit(bg.BasalGanglia("macaque", seed=1), seed=2)


def test_evidence_has_a_drift_proportional_to_the_difference_of_values(circuit):
    evidence = circuit.evidence(np.tile([0.3, 0.6], (400, 1)))
    ratio = evidence.log_likelihood[..., 1] - evidence.log_likelihood[..., 0]
    error = ratio.std() / np.sqrt(ratio.size)
    assert ratio.mean() == pytest.approx(0.25 * 0.3 / 0.6, abs=4 * error)
    assert ratio.var() == pytest.approx(2 * 0.25, rel=0.03)
    assert (evidence.truth == 1).all()
    # At the stated difference the ratios are exact: exp(-ratio) has a mean of 1 under the truth.
    exact = circuit.evidence(np.tile([0.2, 0.8], (400, 1))).log_likelihood
    odds = np.exp(exact[..., 0] - exact[..., 1])
    assert odds.mean() == pytest.approx(1, abs=4 * odds.std() / np.sqrt(odds.size))


def test_the_better_action_is_chosen_more_often_and_sooner_with_the_difference(circuit):
    made = [circuit.decide(np.tile([0.5 - d / 2, 0.5 + d / 2], (400, 1))) for d in (0.1, 0.3, 0.6)]
    share = np.array([one.accuracy for one in made])
    times = [float(np.median(one.time_ms)) for one in made]
    assert (np.diff(share) > 0.03).all()
    assert (np.diff(times) < -30).all()
    # Constant noise and bound: the log-odds of a choice are proportional to the difference.
    odds = np.log(share / (1 - share)) / [0.1, 0.3, 0.6]
    error = 1 / np.sqrt(400 * share * (1 - share)) / [0.1, 0.3, 0.6]
    assert abs(odds[1] - odds[2]) < 4 * np.hypot(error[1], error[2])


def test_each_block_has_its_own_noise_and_a_seed_gives_the_same_bytes(circuit):
    values = np.tile([0.5, 0.5], (30, 1))
    first, again, other = (circuit.decide(values, k).time_ms for k in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    # The noise of cells is that of the block as well.
    evidence, level = circuit.evidence(values, 3), circuit.model.threshold(None, 0.85)
    known = circuit.model.decided(evidence, level, first_trial=90).time_ms
    assert np.array_equal(first, known)
    assert not np.array_equal(known, circuit.model.decided(evidence, level).time_ms)


test_bad_input_is_refused = refusing(
    (lambda: ValueCircuit(bg.BasalGanglia("macaque", "algebra")), "model"),
    (lambda: ValueCircuit(bg.BasalGanglia(bg.load_circuit("macaque", 3))), "model"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque"), difference=0.0), "difference"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque"), posterior=0.999), "thresholds"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque")).evidence([0.5, 0.5]), "values"),
)


def test_choices_of_the_circuit_teach_the_learner(circuit):
    played = play(QBoth(rate=0.3), Bandit(), trials=40, runs=8, seed=3, chooser=circuit)
    assert np.isfinite(played.time_ms).all()
    assert played.difference[-10:].mean() > 0.4
    assert played.correct[-10:].mean() > 0.75
