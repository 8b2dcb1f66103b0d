"""Summaries of people who learn values: what is simulated is found in them."""

import numpy as np
import pytest

from bgmodel.fitting.optimum import optimum
from bgmodel.learning.value_models import MODELS, likelihood, simulated
from figures.learning.value_people import (
    GROUP,
    LAST,
    by_difference,
    courses,
    like,
    log_ratio,
    natural,
    predicted,
    recovered,
)

MODEL = MODELS["q"]
TRUE = {"rate": 0.2, "scale": 3.0, "bound": 0.9, "t0_s": 0.4, "stickiness": 0.05}
AT = np.array([float(each.scaled(TRUE[each.name])) for each in MODEL.parameters])


@pytest.fixture(scope="module")
def people():
    made = simulated(MODEL, natural(MODEL, np.tile(AT, (12, 1))), trials=LAST, seed=11)
    return made.by_participant()


@pytest.fixture(scope="module")
def fits(people):
    return {who: optimum(likelihood(MODEL, person)) for who, person in people.items()}


def test_the_right_model_predicts_choices_and_times_within_their_errors(fits):
    table = courses(fits, seed=1)
    assert len(table) == 3 * LAST // GROUP
    for name, at_least in (("share", 0.02), ("median_s", 0.05)):
        away = (table[name] - table[f"{name}_model"]) / np.hypot(table[f"{name}_se"], at_least)
        assert (away.abs() < 4).all()
    first, last = (table[table["trial"] == t].set_index("pair") for t in (2.0, LAST - 3.0))
    assert (last["share"]["AB"] - first["share"]["AB"]) > 0.05


def test_larger_differences_are_decided_better_and_sooner(fits):
    table = by_difference(fits, seed=1)
    assert table["drift"].is_monotonic_increasing
    assert table["share"].iloc[-1] > table["share"].iloc[0] + 0.1
    assert table["median_s"].iloc[-1] < table["median_s"].iloc[0]
    _, p, times = predicted(fits["0"], 1, "0")
    assert np.array_equal(times, predicted(fits["0"], 1, "0")[2])
    assert ((p > 0) & (p < 1)).all()


def test_drawn_parameters_have_the_spread_of_the_fits(fits):
    drawn = like(list(fits.values()), 2000, seed=1)
    at = np.stack([fit.likelihood.freedom.to_scale(fit.vector) for fit in fits.values()])
    middle = np.median(at, axis=0)
    spread = 1.4826 * np.median(np.abs(at - middle), axis=0)
    assert np.abs(drawn.mean(axis=0) - middle) == pytest.approx(0, abs=0.1 * spread.max())
    assert drawn.std(axis=0) == pytest.approx(spread, rel=0.1)


def test_intervals_contain_the_truth_of_most_people_and_not_another():
    true = np.tile(AT, (4, 1))
    intervals, inside = recovered(MODEL, true, seed=2)
    assert intervals.shape == inside.shape == (4, 5)
    assert inside.mean() > 0.7
    assert np.abs(intervals[:, 2] - AT[2]).max() < 0.3  # the bound


def test_the_log_ratio_is_that_of_the_rates():
    assert np.exp(log_ratio({"rate": 0.3, "rate_minus": 0.1})) == pytest.approx(3)
