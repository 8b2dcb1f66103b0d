"""Choices and times of people who learn values: densities, likelihoods, fits and bad input."""

from dataclasses import replace

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.fitting import passage
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.likelihood import TrialLikelihood, TrialModel
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.learning.value_learners import QLearning, pairs_of
from bgmodel.learning.value_models import (
    LAPSES,
    LONGEST_S,
    MODELS,
    PAIRS,
    choice_probability,
    draw,
    likelihood,
    log_density,
    simulated,
    value_differences,
)
from bgmodel.trials.reader import read_trials
from tests.closed_forms import accuracy, mean_time_s, sd_time_s
from tests.drawn import with_drift
from tests.helpers import refused, refusing
from tests.read import ROWS, changed, table_of, without

TRUE = {"rate": 0.3, "rate_minus": 0.15, "scale": 2.5, "bound": 0.9, "t0_s": 0.35,
        "stickiness": 0.15}  # fmt: skip
TWO = MODELS["q, two rates"]


def made(model, true, people=1, seed=1, trials=60, **changes):
    """Return simulated people with the same parameters, except for those given for each."""
    values = {name: np.full(people, value) for name, value in true.items()} | changes
    return simulated(model, values, trials=trials, seed=seed).by_participant()


def vector(fitted, **changes):
    return np.array([(TRUE | changes)[name] for name in fitted.freedom.names])


@pytest.fixture(scope="module")
def person():
    return made(TWO, TRUE)["0"]


@pytest.mark.parametrize(("drift", "start"), [(0.0, 0.0), (1.5, 0.3), (-2.0, 0.5), (0.4, -0.6)])
def test_densities_are_those_of_first_passages_with_lapses(drift, start):
    times = np.linspace(0.0, 14.0, 14_001)[1:]
    at_rest = passage.constant_at_rest(0.9, times, start)
    exact = with_drift(at_rest, np.full(14_000, 0.9), times, [drift], start)[0]
    for response in (0, 1):
        density = np.exp(log_density(times + 0.3, np.array(response), drift, 0.9, start, 0.3))
        lapse = LAPSES / (2 * LONGEST_S)
        assert density == pytest.approx((1 - LAPSES) * exact[response] + lapse, abs=1e-8)
    share = (1 - LAPSES) * exact[1].sum() * 1e-3 + LAPSES / 2
    assert float(choice_probability(drift, 0.9, start)) == pytest.approx(share, abs=1e-5)
    early = log_density(np.array(0.2), np.array(1), drift, 0.9, start, 0.3)
    assert float(early) == pytest.approx(np.log(LAPSES / (2 * LONGEST_S)))


def test_draws_have_the_moments_of_the_closed_forms():
    n = 4000
    uniform = np.random.default_rng(1).random((4, n))
    uniform[2] = 1.0  # no lapses
    each = [np.full(n, x) for x in (1.2, 0.8, 0.0, 0.3)]
    response, rt_s = draw(*each, uniform)
    p = float(accuracy(1.2, 0.8))
    assert response.mean() == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n))
    sd = float(sd_time_s(1.2, 0.8))
    assert rt_s.mean() - 0.3 == pytest.approx(mean_time_s(1.2, 0.8), abs=4 * sd / n**0.5)
    assert rt_s.std() == pytest.approx(sd, rel=0.06)
    lapses, _ = draw(*each, np.random.default_rng(2).random((4, n)))
    assert lapses.mean() < p


def test_values_are_those_of_a_loop_over_the_trials_of_each_pair(person):
    pairs = pairs_of(person)
    assert pairs.names == ("AB", "CD", "EF")
    differences = value_differences(QLearning(rate=0.3, rate_minus=0.1), pairs, ())
    q = np.full((3, 2), 0.5)
    for k in range(person.trials):
        pair, choice = pairs.pair[k], person.response[k]
        assert differences[k] == pytest.approx(q[pair, 1] - q[pair, 0])
        error = person.reward[k] - q[pair, choice]
        q[pair, choice] += (0.3 if error > 0 else 0.1) * error


def test_the_start_is_towards_the_last_choice_of_the_pair(person):
    pairs, model = pairs_of(person), likelihood(TWO, person)
    for pair in range(3):
        of_pair = pairs.pair == pair
        last = pairs.last_choice[of_pair]
        assert last[0] == 0
        assert np.array_equal(last[1:], 2 * person.response[of_pair][:-1] - 1)
        assert np.array_equal(pairs.within[of_pair], np.arange(60))
    repeats = (2 * person.response - 1) == pairs.last_choice
    shifted = model.each(vector(model, stickiness=0.4)) - model.each(vector(model, stickiness=0.0))
    fast = person.rt_s < np.median(person.rt_s)
    assert shifted[repeats & fast].mean() > 0 > shifted[~repeats & fast].mean()
    assert shifted[pairs.last_choice == 0] == pytest.approx(0)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_sets_of_parameters_side_by_side_are_each_alone(person, model):
    assert isinstance(model, TrialModel)
    asked = likelihood(model, person)
    together = asked.many(np.array(asked.starts()))
    for height, start in zip(together, asked.starts(), strict=True):
        assert height == pytest.approx(asked.each(start))
        assert asked.freedom.inside(start)
    some = np.arange(0, person.trials, 7)
    assert asked.part(some).many(np.array(asked.starts())) == pytest.approx(together[:, some])


def test_predicted_densities_are_those_of_simulated_trials(person):
    asked = likelihood(TWO, person)
    at = vector(asked)
    drawn = TrialLikelihood.density(asked, at)
    exact = asked.complete(at).density(at)
    assert exact.sum(axis=(1, 2)) * 0.01 == pytest.approx(1, abs=2e-3)
    for t in (60, 90, 130):
        low, high = (each[..., :t].sum(axis=2) * 0.01 for each in (drawn, exact))
        # 200 copies of 60 trials in each cell.
        assert low == pytest.approx(high, abs=4 * 0.5 / 12_000**0.5 + 0.005)


def test_parameters_of_many_trials_are_found_within_their_errors():
    many = made(TWO, TRUE, trials=300, seed=3)["0"]
    fit = fit_likelihood(likelihood(TWO, many))
    asked, best = fit.optimum.likelihood, fit.optimum
    assert best.log_likelihood > asked(vector(asked))
    error = fit.directions.standard_errors
    assert (np.abs(best.vector - vector(asked)) < 3.5 * error).all()
    assert min(fit.misfit.p.values()) > 0.003


def test_people_of_bg_simulate_learn_from_their_own_choices():
    true = {"rate": 0.3, "scale": 2.5, "bound": 1.0, "t0_s": 0.4, "stickiness": 0.0}
    many = made(MODELS["q"], true, trials=100, seed=3)["0"]
    new = bg.simulate("q", true, many, seed=1)
    assert 0.15 < optimum(likelihood("q", new)).values["rate"] < 0.6
    for pair, *rates in PAIRS:
        some = new.conditions["pair"].to_numpy() == pair
        for response, rate in zip((1, 0), rates, strict=True):
            rewards = new.reward[some & (new.response == response)]
            assert rewards.mean() == pytest.approx(rate, abs=4 * 0.5 / len(rewards) ** 0.5 + 0.1)
    # Choices one trial ahead, with the rewards of others, are no data of a person who learns.
    asked = likelihood("q", many)
    values = asked.values(np.array([true[name] for name in asked.freedom.names]))
    ahead = asked.model.simulate(many, values, np.random.default_rng(1))
    assert np.array_equal(ahead.reward, many.reward)
    assert optimum(likelihood("q", ahead)).values["rate"] < 0.1


def test_the_optimum_is_that_of_a_grid_with_the_prior(person):
    asked = likelihood(TWO, person, fixed={n: x for n, x in TRUE.items() if n != "stickiness"})
    grid = np.linspace(-0.4, 0.6, 2001)[:, None]
    best = optimum(asked).vector
    assert best == pytest.approx(grid[np.argmax(asked.heights(grid))], abs=1e-3)
    prior = -0.5 * (np.arctanh(best[0]) / 0.3) ** 2
    assert asked.height(best) == pytest.approx(asked(best) + prior)


def test_decisions_change_over_trials_and_learners_do_not(person):
    half = np.where(np.arange(person.trials) % 2, "b", "a")
    conditions = person.conditions.assign(half=half)
    slower = replace(person, conditions=conditions, rt_s=person.rt_s + 0.2 * (half == "b"))
    values = optimum(likelihood(TWO, slower, vary={"t0_s": "half"})).values
    assert values["t0_s[half=b]"] - values["t0_s[half=a]"] == pytest.approx(0.2, abs=0.06)
    linear = likelihood(TWO, slower, formulas=[Formula("t0_s", "half")])
    assert "t0_s[half[T.b]]" in linear.freedom.names
    for name in ("rate", "rate_minus"):
        asked = likelihood(TWO, slower, vary={name: "half"})
        with refused(name):
            optimum(asked)


ONE = table_of("pairs")[: ROWS // 2]


test_a_table_with_a_wrong_value_or_without_a_column_is_refused = refusing(
    (changed(reward=0.5), "reward"),
    (changed(response=2), "response"),
    (changed(response=np.nan), "response"),
    (changed(rt=0.0), "rt"),
    (changed(pair=lambda t: np.where(t.index == 0, "x", "AB")), "pair"),
    *((without(column), column) for column in ("pair", "response", "reward")),
    of=lambda change: pairs_of(read_trials(change(ONE), conditions="pair")),
)
