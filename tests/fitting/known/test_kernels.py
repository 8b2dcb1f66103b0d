"""Psychophysical kernels: weights that are put in, and the gradient at the optimum."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.known.kernels import hazards, kernel, kernels
from bgmodel.fitting.known.known_likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.optimum import optimum
from tests.helpers import refused
from tests.known_trials import TRUTH, few, simulated


def weighted(weights, trials=4000, alternatives=2):
    """Return trials whose choice follows a conditional logit with weights by position."""
    some, rng = few(trials, len(weights), alternatives), np.random.default_rng(2)
    score = np.einsum("tki,k->ti", some.log_likelihood, weights)
    choice = (score + rng.gumbel(size=score.shape)).argmax(axis=1)
    return replace(some, choice=choice, rt_s=np.full(trials, 1.0 + 0.1 * len(weights)))


@pytest.mark.parametrize("alternatives", [2, 4])
def test_weights_are_found_again(alternatives):
    true = np.array([1.0, 0.5, 0.0, -0.3])
    weights = kernel(weighted(true, alternatives=alternatives), positions=4)
    assert (abs(weights["weight"] - true) < 4 * weights["standard_error"]).all()
    assert (weights["standard_error"] < 0.06).all()


def test_from_the_response_positions_count_backward():
    true = np.array([1.0, 0.5, 0.0, -0.3])
    trials = weighted(true)
    onset, response = (kernel(trials, positions=4, align=a) for a in ("onset", "response"))
    np.testing.assert_allclose(onset["weight"], response["weight"][::-1], rtol=1e-6)
    with refused("align"):
        kernel(trials, align="middle")


def test_a_model_has_the_kernel_of_its_probabilities():
    trials = weighted(np.array([1.0, 0.5]))
    score = np.einsum("tki,k->ti", trials.log_likelihood, [0.3, 0.9])
    chosen = np.exp(score) / np.exp(score).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(kernel(trials, chosen, positions=2)["weight"], [0.3, 0.9], atol=0.01)


@pytest.fixture(scope="module")
def likelihood():
    return known_likelihood(EXACT["msprt"], simulated(400, 41))


def test_hazards_of_the_true_model_are_calibrated(likelihood):
    table = hazards(likelihood, optimum(likelihood).vector)
    assert (table["running"].diff().dropna() <= 0).all()
    z = (table["observed"] - table["predicted"]) / table["standard_error"]
    z = z[np.isfinite(z)]
    assert abs(z.mean()) < 0.5
    assert 0.6 < z.std() < 1.5


def test_kernels_of_data_and_of_the_true_model_agree(likelihood):
    true = np.array([TRUTH.get(name, 0.0) for name in likelihood.freedom.names])
    table = kernels(likelihood, true)
    data, model = (table[table["of"] == of].reset_index(drop=True) for of in ("data", "msprt"))
    assert len(data) == len(model)
    assert (abs(data["weight"] - model["weight"]) < 4 * data["standard_error"]).all()
