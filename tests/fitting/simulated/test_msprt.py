"""The simulated test with N alternatives against exact laws."""

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated.msprt import MsprtModel

TRIALS, SEED = 2000, 11
PATHS = 4 * TRIALS
GRID = Grid(600)


def model(alternatives):
    return MsprtModel(alternatives, TRIALS, SEED)


def decided(model, strengths, grid=GRID, **values):
    every = {name: np.full(len(strengths), value) for name, value in values.items()}
    return model.decided(every, np.array(strengths, float), grid)


@pytest.mark.parametrize("posterior", [0.6, 0.8, 0.95])
def test_with_two_alternatives_it_is_the_test_with_a_constant_gap(posterior):
    """At all strengths, although one gain serves them."""
    strengths, sensitivity = [0.5, 1.0, 1.5], 2.0
    mass = decided(model(2), strengths, sensitivity=sensitivity, threshold_nats=-np.log(posterior))
    bound = np.log(posterior / (1 - posterior)) / (2 * sensitivity)
    exact = decided(GapModel(), strengths, sensitivity=sensitivity, bound=bound)
    assert np.abs(mass.cumsum(axis=2) - exact.cumsum(axis=2)).max() < 1.95 / np.sqrt(PATHS)


@pytest.mark.parametrize("alternatives", [3, 5, 12])
@pytest.mark.parametrize("posterior", [0.5, 0.8, 0.95])
def test_its_accuracy_is_the_posterior_at_which_it_decides(alternatives, posterior):
    mass = decided(model(alternatives), [1.0], sensitivity=2.0, threshold_nats=-np.log(posterior))
    accuracy, variance = moments(mass / BIN_S, GRID)["accuracy"][0], posterior * (1 - posterior)
    assert accuracy == pytest.approx(posterior, abs=3.3 * np.sqrt(variance / PATHS))


def test_sensitivity_scales_time_alone():
    once, twice = (
        decided(model(4), [1.0], sensitivity=k, threshold_nats=0.2)[0].cumsum(axis=1)
        for k in (1.0, 2.0)
    )
    assert np.allclose(twice[:, :150], once[:, 3::4], atol=1e-12)
