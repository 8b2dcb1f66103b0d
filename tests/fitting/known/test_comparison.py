"""Bayes factors, the verdict, and the number of trials that they need."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.known.comparison import (
    STRONG_NATS,
    UNKNOWN,
    compared,
    trials_needed,
    verdict,
)
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.settings import fit_one
from tests.known_trials import simulated


def test_the_number_of_trials_is_that_at_which_95_of_100_sums_suffice():
    rng = np.random.default_rng(1)
    ratios = 0.1 + 0.5 * rng.standard_normal(1_000_000)
    needed = int(trials_needed(ratios))
    sums = 0.1 * needed + 0.5 * np.sqrt(needed) * rng.standard_normal(40_000)
    assert (sums > STRONG_NATS).mean() == pytest.approx(0.95, abs=0.01)


def test_models_that_do_not_differ_need_infinitely_many():
    assert trials_needed(np.random.default_rng(2).standard_normal(1000) * 0.5) == np.inf
    assert trials_needed(-np.ones(10) + 0.1 * np.arange(10)) == np.inf


def test_more_parameters_need_more_trials():
    ratios = 0.2 + 0.1 * np.random.default_rng(3).standard_normal(1000)
    assert trials_needed(ratios, 2) > trials_needed(ratios) > trials_needed(ratios, -2)


@pytest.mark.parametrize(
    ("low", "expected"), [([0, 4], "a"), ([0, 2], UNKNOWN), ([0, -1], UNKNOWN)]
)
def test_a_verdict_needs_3_nats_over_every_other(low, expected):
    table = pd.DataFrame({"model": ["a", "b"], "low": low})
    assert verdict(table) == expected


def test_the_table_ranks_by_bic_and_counts_parameters():
    trials = simulated(200, 31, "leaky_sum", leak_hz=3.0, threshold=0.7, noise=0.05)
    fits = {name: fit_one(EXACT[name], trials, (), {}) for name in ("msprt", "leaky_sum")}
    table = compared(fits).set_index("model")
    assert list(table.index) == ["leaky_sum", "msprt"]
    assert verdict(table.reset_index()) == "leaky_sum"
    for name, fit in fits.items():
        row, count = table.loc[name], len(fit.optimum.vector)
        assert row["bic"] == pytest.approx(
            count * np.log(200) - 2 * fit.optimum.log_likelihood, abs=1e-9
        )
    assert table.loc["msprt", "log_bayes_factor"] == pytest.approx(
        (table.loc["msprt", "bic"] - table.loc["leaky_sum", "bic"]) / 2
    )
