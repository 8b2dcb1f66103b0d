"""Bayes factors, the verdict, and the number of trials that they need."""

import numpy as np
import pytest

from bgmodel.fitting.known.models import EXACT
from figures.known.fitted import (
    LEAKY,
    RANDOM,
    STRONG_NATS,
    TEST,
    UNKNOWN,
    fitted,
    trials_needed,
    trials_of,
    verdict,
)


def test_the_number_of_trials_is_that_at_which_95_of_100_sums_suffice():
    rng = np.random.default_rng(1)
    ratios = 0.1 + 0.5 * rng.standard_normal(1_000_000)
    needed = int(trials_needed(ratios))
    sums = 0.1 * needed + 0.5 * np.sqrt(needed) * rng.standard_normal(40_000)
    assert (sums > STRONG_NATS).mean() == pytest.approx(0.95, abs=0.01)


def test_models_that_do_not_differ_need_infinitely_many():
    assert trials_needed(np.random.default_rng(2).standard_normal(1000) * 0.5) == np.inf
    assert trials_needed(-np.ones(10) + 0.1 * np.arange(10)) == np.inf


class Scored:
    def __init__(self, log_evidence, error):
        self.log_evidence, self.error = log_evidence, error


@pytest.mark.parametrize(
    ("other", "error", "expected"), [(-4, 0, "a"), (-2, 0, UNKNOWN), (-4, 1, UNKNOWN)]
)
def test_a_verdict_needs_3_nats_over_every_other(other, error, expected):
    assert verdict({"b": Scored(other, error), "a": Scored(0, 0)}) == expected


def test_a_leak_is_told_and_parameters_are_counted():
    trials = trials_of(RANDOM, LEAKY, 200, 31, leak_hz=3.0, threshold=0.7, noise=0.05)
    fits = {name: fitted(EXACT[name], trials) for name in (TEST, LEAKY)}
    assert verdict(fits) == LEAKY
    for fit in fits.values():
        bic = len(fit.optimum.vector) * np.log(200) - 2 * fit.optimum.log_likelihood
        assert fit.log_evidence == pytest.approx(-bic / 2)
        assert fit.error == 0
