"""Models compared on trials that they were not fitted to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.model_comparison import (
    Better,
    ModelComparison,
    ModelScore,
    Predicted,
    _divided,
    better_by,
    compare_fits,
    crossvalidated,
    draws_error,
    importance_sampled,
)
from bgmodel.fitting.person_fit import fit_likelihood
from circuits.errors import FitWarning, collected
from tests.drawn import TRUTH, drawn
from tests.helpers import refused

pytestmark = pytest.mark.usefixtures("brief_search")
MODEL = GapModel()
SEED = 24_331
HELD = {name: TRUTH[name] for name in ("t0_sd_s", "lapse")}


def fitted(some, **fixed):
    likelihood = likelihood_of(MODEL, design_of(some, pooled=True), fixed={**HELD, **fixed})
    return fit_likelihood(likelihood)


@pytest.fixture(scope="module")
def some():
    return drawn(MODEL, [0.05, 0.3], 100, SEED, seconds=1.5, sensitivity=10.0, bound=0.5)


@pytest.fixture(scope="module")
def right(some):
    return fitted(some)


@pytest.fixture(scope="module")
def twice(right):
    return compare_fits({"one": right, "two": right})


def score(trials, person=None, without=None):
    person = np.zeros(len(trials), int) if person is None else person
    parts = np.zeros((0, len(trials))) if without is None else without
    return ModelScore(Predicted(trials, parts), person, 0.0, 1)


def test_a_model_without_sensitivity_is_told_from_the_right_one(some, right):
    comparison = compare_fits({"right": right, "blind": fitted(some, sensitivity=0.1)})
    assert comparison.best == "right"
    assert comparison.table.loc["blind", "verdict"] == "right predicts better"
    assert comparison.table.loc["right", "difference"] == 0
    assert comparison.table.loc["blind", "difference"] < -10
    # A larger BIC is worse, and it includes the number of parameters.
    assert comparison.table.loc["blind", "bic"] > comparison.table.loc["right", "bic"]
    hearing, deaf = (comparison.scores[name].predicted for name in ("right", "blind"))
    assert len(hearing.each) == some.trials
    better = better_by(hearing, deaf)
    assert better.nats > 5 * better.error
    assert better.simulation_error == 0
    assert better_by(deaf, hearing) == Better(-better.nats, better.error, 0.0)


def test_held_out_trials_are_less_likely_than_fitted_ones_by_about_a_nat_per_parameter(twice):
    score = twice.scores["one"]
    lost = score.log_likelihood - score.predicted.each.sum()
    # In expectation k parameters lose k (F / (F - 1) + 1) / 2 nats or so (Stone 1977).
    assert 0 < lost < 12


def test_a_score_above_the_fit_to_all_trials_tells_of_a_failed_search(right):
    name, best = right.optimum.likelihood.freedom.names.index("bound"), right.optimum
    lower = best.vector.copy()
    lower[name] *= 1.5
    failed = replace(best, vector=lower, log_likelihood=best.likelihood(lower))
    with collected(FitWarning) as said:
        crossvalidated({"right": {"a": best}, "failed": {"a": failed}})
    (only,) = said
    assert "failed: the search failed" in only


def test_error_is_over_people_if_there_are_several():
    person = np.repeat(np.arange(10), 50)
    shift = np.random.default_rng(SEED).normal(0, 1, 10)[person]
    base, moved = score(np.zeros(500), person), score(-np.abs(shift), person)
    table = ModelComparison({"a": base, "b": moved}, list("abcdefghij"), "test").table
    by_person = np.bincount(person, moved.predicted.each)
    expected = np.sqrt(10) * by_person.std(ddof=1)
    assert table.loc["b", "standard_error"] == pytest.approx(expected)


def test_simulated_trials_are_part_of_the_error():
    parts = np.zeros((16, 50))
    parts[:, 0] = [1.0, -1.0] * 8
    scores = {"a": score(np.zeros(50)), "b": score(np.full(50, -0.1), without=parts)}
    table = ModelComparison(scores, ["all"], "test").table
    assert table.loc["b", "simulation_error"] == pytest.approx(np.sqrt(15 / 16 * 16))
    assert table.loc["b", "verdict"].startswith("cannot tell")


def test_scores_of_a_hierarchy_are_near_the_log_likelihood(group):
    comparison = compare_fits({"one": group, "two": group})
    error = comparison.scores["one"].predicted.draws_error
    assert comparison.table["simulation_error"].to_list() == [0, pytest.approx(error * 2**0.5)]
    assert comparison.method == "PSIS-LOO"
    score = comparison.scores["one"]
    per_person = np.bincount(score.person, score.predicted.each)
    highest = group.log_likelihood.max(axis=(0, 1))
    assert (per_person < highest).all()
    assert (per_person > highest - 8).all()


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_the_error_from_the_number_of_draws_is_the_spread_over_sets_of_draws(correlation):
    # A regression with known noise: the posterior is Gaussian, and scores of it are sums of logs.
    rng = np.random.default_rng(SEED)
    x, fresh = rng.normal(size=(60, 3)), rng.normal(size=(100, 4, 250, 3))
    y = x.sum(axis=1) + rng.normal(size=60)
    spread = np.linalg.inv(x.T @ x)
    for draw in range(1, fresh.shape[2]):
        more = np.sqrt(1 - correlation**2) * fresh[:, :, draw]
        fresh[:, :, draw] = correlation * fresh[:, :, draw - 1] + more
    scores, errors = [], []
    for chains in spread @ x.T @ y + fresh @ np.linalg.cholesky(spread).T:
        log = -0.5 * (y - chains @ x.T) ** 2
        scores.append(-np.log(np.exp(-log).mean(axis=(0, 1))).sum())
        errors.append(draws_error(log))
    assert np.mean(errors) == pytest.approx(np.std(scores), rel=0.2)


@pytest.mark.parametrize(("share", "k"), [(1.0, -np.inf), (0.5, np.inf)])
def test_trials_that_are_as_likely_in_many_draws_have_a_score(share, k):
    # Such as go trials of stop signals, which are certain, and trials that a model rules out.
    log = np.random.default_rng(SEED).normal(-1, 0.1, (2, 100, 3))
    alone, _ = importance_sampled(log[..., :2])
    log[:, : int(100 * share), 2] = -600.0
    scores, khat = importance_sampled(log)
    assert scores[:2].tobytes() == alone.tobytes()
    assert (scores[2], khat[2]) == (pytest.approx(-600 - np.log(share)), k)
    assert np.isfinite(draws_error(log))


def test_what_is_no_fit_to_the_same_trials_is_refused(some, right):
    other = fitted(some.where(np.arange(some.trials) < 180))
    fourth = np.arange(some.trials) % 4 == 0
    turned = fitted(replace(some, response=np.where(fourth, 1 - some.response, some.response)))
    late = design_of(some, rt_window=(0.0, 60.0), pooled=True)
    windowed = fit_likelihood(likelihood_of(MODEL, late, fixed=HELD))
    wrong_fits = ({"one": right, "two": each} for each in (other, turned, windowed))
    for wrong in ({}, {"one": 1, "two": 2}, *wrong_fits):
        with refused("fits"):
            compare_fits(wrong)


def test_the_figure_has_a_row_for_each_model(twice):
    figure = twice.plot()
    total, each = figure.axes
    assert [label.get_text() for label in total.get_yticklabels()] == ["one", "two"]
    assert len(each.lines) >= 2


@given(st.lists(st.integers(0, 4), min_size=1, max_size=200), st.integers(2, 6), st.integers(0, 99))
def test_folds_divide_each_cell_and_all_trials_evenly(cell, folds, seed):
    part = _divided(cell, folds, seed)
    assert np.array_equal(part, _divided(cell, folds, seed))
    for heard in [np.full(len(cell), True), *(np.array(cell) == each for each in set(cell))]:
        count = np.bincount(part[heard], minlength=folds)
        assert len(count) == folds
        assert count.max() - count.min() <= 1


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
