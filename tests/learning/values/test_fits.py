"""Choices and times of people who learn values: densities, likelihoods, fits and bad input."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.exact import passage
from bgmodel.learning.values.diffusion import (
    LAPSES,
    LONGEST_S,
    choice_probability,
    draw,
    log_density,
)
from bgmodel.learning.values.fits import fit_person, left_out, log_likelihood
from bgmodel.learning.values.learners import QLearning
from bgmodel.learning.values.models import MODELS, STICKINESS, model_of, value_differences
from bgmodel.learning.values.people import PairTrials, read_pairs
from bgmodel.learning.values.simulated import simulated
from tests.helpers import refused

TRUE = {"rate": 0.3, "rate_minus": 0.15, "scale": 2.5, "bound": 0.9, "non_decision_s": 0.35,
        "stickiness": 0.15}  # fmt: skip
TWO = MODELS["q, two rates"]


@pytest.fixture(scope="module")
def person():
    return simulated(TWO, TWO.fitted(TRUE)[None], trials=60, seed=1)[0]


@pytest.mark.parametrize(("drift", "start"), [(0.0, 0.0), (1.5, 0.3), (-2.0, 0.5), (0.4, -0.6)])
def test_densities_are_those_of_first_passages_with_lapses(drift, start):
    times = np.linspace(0.0, 14.0, 14_001)[1:]
    at_rest = passage.constant_at_rest(0.9, times, start)
    exact = passage.with_drift(at_rest, np.full(14_000, 0.9), times, [drift], start)[0]
    for response in (0, 1):
        found = np.exp(log_density(times + 0.3, np.array(response), drift, 0.9, start, 0.3))
        lapse = LAPSES / (2 * LONGEST_S)
        assert found == pytest.approx((1 - LAPSES) * exact[response] + lapse, abs=1e-8)
    share = (1 - LAPSES) * exact[1].sum() * 1e-3 + LAPSES / 2
    assert float(choice_probability(drift, 0.9, start)) == pytest.approx(share, abs=1e-5)
    early = log_density(np.array(0.2), np.array(1), drift, 0.9, start, 0.3)
    assert float(early) == pytest.approx(np.log(LAPSES / (2 * LONGEST_S)))


def test_an_absurd_drift_has_a_finite_density():
    found = log_density(np.array([0.31, 3.0]), np.array([1, 0]), 500.0, 1.0, 0.0, 0.3)
    assert np.isfinite(found).all()


def test_draws_have_the_moments_of_the_closed_forms():
    n = 4000
    uniform = np.random.default_rng(1).random((4, n))
    uniform[2] = 1.0  # no lapses
    each = [np.full(n, x) for x in (1.2, 0.8, 0.0, 0.3)]
    response, rt_s = draw(*each, uniform)
    p = float(passage.accuracy(1.2, 0.8))
    assert response.mean() == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n))
    sd = float(passage.sd_time_s(1.2, 0.8))
    assert rt_s.mean() - 0.3 == pytest.approx(passage.mean_time_s(1.2, 0.8), abs=4 * sd / n**0.5)
    assert rt_s.std() == pytest.approx(sd, rel=0.06)
    lapses, _ = draw(*each, np.random.default_rng(2).random((4, n)))
    assert lapses.mean() < p


def test_values_are_those_of_a_loop_over_the_trials_of_each_pair(person):
    found = value_differences(QLearning(rate=0.3, rate_minus=0.1), person, 1)[0]
    q = np.full((3, 2), 0.5)
    for k in range(person.trials):
        pair, choice = person.pair[k], person.response[k]
        assert found[k] == pytest.approx(q[pair, 1] - q[pair, 0])
        error = person.reward[k] - q[pair, choice]
        q[pair, choice] += (0.3 if error > 0 else 0.1) * error


def test_the_start_is_towards_the_last_choice_of_the_pair(person):
    for pair in range(3):
        of_pair = person.pair == pair
        last = person.last_choice[of_pair]
        assert last[0] == 0
        assert np.array_equal(last[1:], 2 * person.response[of_pair][:-1] - 1)
    at = TWO.fitted(TRUE | {"stickiness": 0.4})[None]
    repeats = (2 * person.response - 1) == person.last_choice
    shifted = log_likelihood(TWO, person, at)[0] - log_likelihood(
        TWO, person, TWO.fitted(TRUE | {"stickiness": 0.0})[None]
    )[0]  # fmt: skip
    fast = person.rt_s < np.median(person.rt_s)
    assert shifted[repeats & fast].mean() > 0 > shifted[~repeats & fast].mean()
    assert shifted[person.last_choice == 0] == pytest.approx(0)


def test_sets_of_parameters_side_by_side_are_each_alone(person):
    for model in MODELS.values():
        rng = np.random.default_rng(2)
        middle = np.array([float(p.fitted(p.median)) for p in model.parameters])
        sets = middle + 0.3 * rng.standard_normal((3, len(middle)))
        together = log_likelihood(model, person, sets)
        assert together.shape == (3, person.trials)
        for k in range(3):
            assert together[k] == pytest.approx(log_likelihood(model, person, sets[k : k + 1])[0])


def test_parameters_of_many_trials_are_found_within_their_errors():
    many = simulated(TWO, TWO.fitted(TRUE)[None], trials=300, seed=3)[0]
    fit = fit_person(TWO, many)
    assert fit.log_likelihood > log_likelihood(TWO, many, TWO.fitted(TRUE)[None]).sum()
    found, weights = fit.posterior(seed=1)
    mean = weights @ found
    sd = np.sqrt(weights @ (found - mean) ** 2)
    assert (np.abs(mean - TWO.fitted(TRUE)) < 3.5 * sd).all()
    assert (sd < [0.4, 0.5, 0.15, 0.04, 0.03, 0.06]).all()
    assert 1 / (weights**2).sum() > 400


def test_posterior_intervals_of_one_parameter_are_those_of_a_grid(person):
    fixed = {name: value for name, value in TRUE.items() if name != "stickiness"}
    fit = fit_person(TWO, person, fixed=fixed)
    grid = np.linspace(-0.5, 0.8, 1301)
    sets = np.repeat(fit.at[None], len(grid), axis=0)
    sets[:, -1] = grid
    log_p = log_likelihood(TWO, person, sets).sum(axis=1) + TWO.log_prior(sets)
    reached = np.cumsum(np.exp(log_p - log_p.max()))
    exact = STICKINESS.natural(np.interp([0.05, 0.95], reached / reached[-1], grid))
    assert fit.intervals(seed=1) == {"stickiness": pytest.approx(tuple(exact), abs=0.02)}


def test_left_out_trials_are_predicted_worse_than_fitted_ones_and_better_than_by_the_prior(person):
    out, fit = left_out("q", person, folds=3), fit_person("q", person)
    assert out.shape == (person.trials,)
    first = person.within % 3 == 0
    others = fit_person("q", person, kept=~first)
    assert out[first] == pytest.approx(others.each[first], abs=2e-3)
    assert np.abs(out[first] - fit.each[first]).max() > 1e-2
    assert out.sum() < fit.log_likelihood
    prior = np.array([float(p.fitted(p.median)) for p in MODELS["q"].parameters])
    assert out.sum() > log_likelihood(MODELS["q"], person, prior[None]).sum()
    half = person.within % 2 == 0
    kept = fit_person("q", person, kept=half)
    assert kept.log_likelihood == pytest.approx(kept.each[half].sum())


def test_the_built_in_set_is_read_for_each_person():
    people = read_pairs()
    assert len(people) == 28
    assert sum(one.trials for one in people.values()) == 5280
    assert {one.names for one in people.values()} == {("AB", "CD", "EF")}


TABLE = pd.DataFrame(
    {
        "participant_id": "a",
        "pair": ["x", "y"] * 3,
        "response": [1, 0] * 3,
        "rt": 0.7,
        "reward": [1, 0, 0, 1, 1, 1],
    }
)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"reward": 0.5}, "reward"),
        ({"response": 2}, "response"),
        ({"response": np.nan}, "response"),
        ({"rt": 0.0}, "rt"),
        ({"pair": list("xxxxxy")}, "pair"),
    ],
)
def test_a_table_with_a_wrong_value_is_refused(change, field):
    with refused(field):
        read_pairs(TABLE.assign(**change))


@pytest.mark.parametrize("column", TABLE.columns)
def test_a_table_without_a_column_is_refused(column):
    with refused(column):
        read_pairs(TABLE.drop(columns=column))


def test_other_bad_input_is_refused(person):
    one = read_pairs(TABLE)["a"]
    for call, field in (
        (lambda: model_of("sarsa"), "model"),
        (lambda: read_pairs("nobody"), "source"),
        (lambda: fit_person("no learning", one), "person"),
        (lambda: fit_person("q", one, fixed={"rat": 0.1}), "fixed"),
        (lambda: left_out("q", one, folds=1), "folds"),
        (lambda: simulated("no learning", np.zeros((1, 6)), seed=1), "model"),
        (lambda: replace(person, reward=person.reward[1:]), "response"),
        (lambda: PairTrials(*[np.ones(3, int)] * 4, names=("a", "b")), "pair"),
    ):
        with refused(field):
            call()
