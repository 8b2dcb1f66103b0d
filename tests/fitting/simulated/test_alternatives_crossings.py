"""Stored crossings of N channels: reweighting against the continuous test, files, and parts."""

from functools import cache

import numpy as np
import pytest

from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated.alternatives import ManyCircuitModel, simulated_many
from bgmodel.fitting.simulated.msprt import MsprtModel
from circuits.anatomy import load_circuit
from tests.drawn import GAIN, ideal
from tests.helpers import refused

GRID = Grid(300)
STEP = GAIN * np.sqrt(BIN_S)
OVERSHOOT = 0.5826 * STEP
"""Mean overshoot of the log odds of two channels at a reading (Siegmund 1985), nats."""
ODDS = 1.2
ARRAYS = ("bins", "choice", "evidence")


@cache
def stored():
    threshold = np.log1p(np.exp(-np.array([ODDS])))
    return simulated_many(ideal, threshold, 3, seconds=3.0, trials=1500, seed=7)


@pytest.mark.parametrize("drift", [0.5, 1.5])
def test_a_drift_that_was_not_simulated_is_decided_as_by_the_continuous_test(drift):
    """At a threshold higher by the overshoot of readings; noise of readings reweights to it."""
    mass = stored().decided([(0, 1.0)], drift)
    values = {"sensitivity": GAIN / 2, "threshold_nats": np.log1p(np.exp(-ODDS - OVERSHOOT))}
    # A gain of twice the mean drift: strengths of mean 1.
    strengths = np.array([drift, 2 - drift])
    every = {name: np.full(2, value) for name, value in values.items()}
    exact = MsprtModel(3, 16_000, 5).decided(every, strengths, GRID)[0]
    one, other = (moments(each[None] / BIN_S, GRID) for each in (mass, exact))
    assert one["accuracy"][0] == pytest.approx(other["accuracy"][0], abs=0.025)
    # The test of the readings decides half a reading after it crosses, on average.
    assert one["mean_s"][0] == pytest.approx(other["mean_s"][0], rel=0.04)


def model(folder=None, channels=3):
    circuit = load_circuit("macaque", channels)
    return ManyCircuitModel(circuit, "rate", seconds=1.0, trials=16, folder=folder)


def test_stored_files_are_read_back_as_they_were(tmp_path, monkeypatch):
    first = model(tmp_path)._crossings
    monkeypatch.setattr("bgmodel.fitting.simulated.alternatives.simulated_many", None)
    again = model(tmp_path)._crossings
    for name in ARRAYS:
        one, other = getattr(first, name), getattr(again, name)
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype


def test_a_circuit_of_two_channels_belongs_to_the_other_model():
    with refused("circuit"):
        model(channels=2)


def test_the_threshold_reaches_the_prior():
    high = model().thresholds_nats[-1]
    assert np.exp(-high) == pytest.approx(1 / 3, abs=0.05)
    assert np.exp(-high) > 1 / 3
