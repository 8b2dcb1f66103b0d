"""Hazards per reading: calibrated under the true model, and not under another."""

import numpy as np
import pytest

from bgmodel.fitting.known.kernels import hazards
from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.optimum import optimum
from tests.known_trials import simulated


@pytest.fixture(scope="module")
def peak():
    return optimum(known_likelihood(EXACT["msprt"], simulated(400, 41)))


def scores(likelihood, vector):
    table = hazards(likelihood, vector)
    assert (table["running"].diff().dropna() <= 0).all()
    z = (table["observed"] - table["predicted"]) / table["standard_error"]
    return z[np.isfinite(z)]


def test_hazards_of_the_true_model_are_calibrated(peak):
    z = scores(peak.likelihood, peak.vector)
    assert abs(z.mean()) < 0.5
    assert 0.6 < z.std() < 1.5
