"""Parameters that are put into trials and found again."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.optimum import known_optimum
from tests.known_trials import TRUTH, simulated


def fitted(trials, model="msprt", **options):
    optimum = known_optimum(known_likelihood(EXACT[model], trials, **options))
    names = optimum.likelihood.freedom.names
    pairs = zip(optimum.vector, optimum.standard_errors, strict=True)
    return optimum, dict(zip(names, pairs, strict=True))


@pytest.mark.parametrize(("channels", "model"), [(2, "msprt"), (4, "msprt")])
def test_parameters_of_the_test_are_found_again(channels, model):
    optimum, found = fitted(simulated(300, 11, channels=channels, gain=1.0))
    for name, true in TRUTH.items():
        if name in found and name != "lapse":
            value, error = found[name]
            assert abs(value - true) < 3.5 * error
            assert error < 0.5 * true
    true = np.array([TRUTH.get(name, 0.0) for name in optimum.likelihood.freedom.names])
    assert optimum.log_likelihood >= optimum.likelihood(true) - 1e-6


def test_a_leak_and_its_absence_are_found():
    with_it = fitted(simulated(300, 12, "leaky_sum", leak_hz=2.0, threshold=0.8), "leaky_sum")[1]
    without = fitted(simulated(300, 12, "leaky_sum", leak_hz=0.0, threshold=0.8), "leaky_sum")[1]
    assert with_it["leak_hz"][0] == pytest.approx(2.0, abs=3.5 * with_it["leak_hz"][1])
    assert without["leak_hz"][0] < 0.3


def test_evidence_of_other_trials_has_no_gain():
    trials = simulated(300, 13)
    order = np.roll(np.arange(300), 7)
    shuffled = replace(trials, log_likelihood=trials.log_likelihood[order])
    assert fitted(shuffled, free=["+gain"])[1]["gain"][0] < 0.1
    assert fitted(trials, free=["+gain"])[1]["gain"][0] > 0.4


def test_an_effect_of_runs_is_found_and_is_not_where_there_is_none():
    found = fitted(simulated(300, 14, run_effect=0.03), free=["+run_effect"])[1]["run_effect"]
    absent = fitted(simulated(300, 14), free=["+run_effect"])[1]["run_effect"]
    assert found[0] > 3 * found[1]
    assert abs(absent[0]) < 3 * absent[1]


def test_the_same_trials_give_the_same_numbers():
    trials = simulated(60, 15)
    np.testing.assert_array_equal(fitted(trials)[0].vector, fitted(trials)[0].vector)
