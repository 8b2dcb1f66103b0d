"""A circuit in the loop: its choices, the readings it has heard, and its confidence from SNr."""

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.evidence import minus_log_softmax
from bgmodel.learning.deciders import InCircuit, WeightLearner
from bgmodel.learning.feature_sources import tap_features
from bgmodel.learning.learned_weights import (
    circuit_time_at_accuracy,
    counted_weights,
    time_at_accuracy,
)
from bgmodel.learning.weights import learn_weights
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent
from tests.helpers import refused

MODEL = bg.BasalGanglia("macaque", seed=5)


@pytest.fixture(scope="module")
def gratings():
    return tap_features(held_out_taps(), SameDifferent(2.0), t_max=8, step_ms=200)


@pytest.fixture(scope="module")
def counted(gratings):
    return counted_weights(gratings[0].draw(300, rng=3))


def test_confidence_read_from_snr_is_that_of_the_readings_heard(gratings, counted):
    part = gratings[1].draw(200, rng=4)
    weights = np.broadcast_to(counted.weights / MODEL.gain, (200, *counted.weights.shape[1:]))
    decider = InCircuit(MODEL)
    chosen = decider.choose(part, weights, np.zeros((200, 2)), 0)
    p = np.exp(-minus_log_softmax(chosen.drive))[np.arange(200), chosen.choice]
    assert np.corrcoef(p, chosen.read_out)[0, 1] > 0.8
    assert chosen.read_out.mean() == pytest.approx(p.mean(), abs=0.02)
    assert (chosen.choice == part.truth).mean() > 0.9
    assert chosen.last.min() >= -1
    assert chosen.last.max() < 8


def test_a_circuit_learns_from_its_own_confidence(gratings):
    told = {"seed": 1, "runs": 6, "learner": WeightLearner(trials=60)}
    learned = learn_weights(gratings[0], decider=InCircuit(MODEL), **told)
    assert learned.gain == MODEL.gain
    assert learned.calibration(gratings[1].draw(200, rng=2)).r.mean() > 0.6
    assert learned.course.readings.min() >= 0


def test_a_circuit_without_times_or_nats_has_no_confidence_to_read():
    with refused("model must have times"):
        InCircuit(bg.BasalGanglia("macaque", engine="algebra"))
    with refused("thresholds macaque resolves no OUT below"):
        InCircuit(MODEL, criterion=0.999)


def test_noise_differs_between_runs_and_trials(gratings, counted):
    one = gratings[1].draw(1, rng=4).draw(2, rng=5)  # the same trial twice
    weights = np.broadcast_to(counted.weights, (2, *counted.weights.shape[1:]))
    decider = InCircuit(MODEL)
    none = np.zeros((2, 2))
    both = [*(decider.choose(one, weights, none, number).read_out for number in (0, 1))]
    assert len(np.unique(both)) == 4


def test_a_circuit_takes_longer_than_the_test_on_the_same_evidence(gratings, counted):
    test = gratings[1].draw(150, rng=2)
    evidence = counted.to_evidence(test)
    in_circuit = circuit_time_at_accuracy(MODEL, evidence, 0.9)
    assert time_at_accuracy(evidence, 0.9) < in_circuit < 600
