"""Trials predicted by a fit to others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.model_comparison import Better, Predicted, _divided, better_by, predicted
from tests.drawn import TRUTH, drawn

pytestmark = pytest.mark.usefixtures("brief_search")
MODEL = GapModel()
VALUES = {"sensitivity": 12.0, "bound": 0.6}
HELD = {name: TRUTH[name] for name in ("t0_sd_s", "lapse")}


@given(st.lists(st.integers(0, 4), min_size=1, max_size=200), st.integers(2, 6), st.integers(0, 99))
def test_folds_divide_each_cell_and_all_trials_evenly(cell, folds, seed):
    part = _divided(cell, folds, seed)
    assert np.array_equal(part, _divided(cell, folds, seed))
    for some in [np.full(len(cell), True), *(np.array(cell) == each for each in set(cell))]:
        count = np.bincount(part[some], minlength=folds)
        assert len(count) == folds
        assert count.max() - count.min() <= 1


@pytest.fixture(scope="module")
def some():
    return drawn(MODEL, [0.05, 0.4], 200, 51, seconds=2.0, **VALUES)


def likelihood(choices, **held):
    return likelihood_of(MODEL, design_of(choices), fixed={**HELD, **held})


@pytest.fixture(scope="module")
def predictions(some):
    """Return predictions of the right and of an insensitive model."""
    return [predicted(likelihood(some, **held), folds=3) for held in ({}, {"sensitivity": 0.06})]


def test_the_model_that_made_the_data_predicts_better_than_one_that_hears_nothing(
    some, predictions
):
    hearing, deaf = predictions
    assert len(hearing.each) == some.trials
    better = better_by(hearing, deaf)
    assert better.nats > 5 * better.error
    assert better.simulation_error == 0
    assert better_by(deaf, hearing) == Better(-better.nats, better.error, 0.0)


NONE_LEFT = np.empty((0, 400))


def test_the_error_of_a_sum_is_that_of_independent_trials():
    rng = np.random.default_rng(0)
    first, second = rng.normal(1, 1, 400), rng.normal(0, 1, 400)
    better = better_by(Predicted(first, NONE_LEFT), Predicted(second, NONE_LEFT))
    assert better.nats == pytest.approx((first - second).sum())
    assert better.error == pytest.approx(np.sqrt(2 * 400), rel=0.1)


def test_simulation_error_adds_as_a_square_and_cancels_where_it_is_shared():
    rng = np.random.default_rng(1)
    each, without = rng.normal(0, 0.1, 400), rng.normal(0, 0.1, (16, 400))
    first, exact = Predicted(each, without), Predicted(np.zeros(400), NONE_LEFT)
    alone = better_by(first, exact)
    sums = without.sum(axis=1)
    assert alone.simulation_error == pytest.approx(np.sqrt(15) * sums.std())
    sampling = better_by(Predicted(each, NONE_LEFT), exact).error
    assert alone.error == pytest.approx(np.hypot(sampling, alone.simulation_error))
    assert better_by(first, Predicted(each - 1, without)).simulation_error == pytest.approx(0)
