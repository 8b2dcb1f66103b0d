"""Bandits, learners and the ideal learner: closed forms, brute force, and bad input."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit, logit

import bgmodel as bg
from bgmodel.learning.bandit import (
    Bandit,
    IdealLearner,
    ValueCircuit,
    ideal_of,
    play,
    relative_regret,
)
from bgmodel.learning.value_learners import (
    LEARNERS,
    Confidence,
    LogitQ,
    Opal,
    QBoth,
    QLearning,
    Reinforce,
    learner_of,
)
from tests.helpers import refusing

P = st.floats(0.05, 0.95)


def one_hot(choice):
    return np.eye(2)[np.asarray(choice)]


def after(learner, choices, rewards):
    """Return the values after a sequence of choices and rewards of one learner."""
    state = learner.start(())
    for choice, reward in zip(choices, rewards, strict=True):
        state = learner.learn(state, one_hot(choice), np.float64(reward))
    return learner.values(state)


def test_arms_reverse_at_their_times_or_with_their_hazard():
    reversed_ = np.diff(Bandit(reverse_every=7).draw(30, 3, seed=1).best, axis=0) != 0
    assert (reversed_ == np.isin(np.arange(29), [6, 13, 20, 27])[:, None]).all()
    random = Bandit(hazard=0.1).draw(2000, 20, seed=1)
    share = (np.diff(random.best, axis=0) != 0).mean()
    assert share == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / 40_000))
    assert (np.diff(Bandit().draw(50, 3, seed=1).best, axis=0) == 0).all()


def test_rewards_have_their_probabilities_and_runs_their_own_draws():
    draws = Bandit(0.7, 0.4).draw(500, 40, seed=2)
    for arm, p in ((draws.best, 0.7), (1 - draws.best, 0.4)):
        mean = np.mean([draws.reward(k, arm[k]) for k in range(500)])
        assert mean == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / 20_000))
    fewer = Bandit(0.7, 0.4).draw(500, 3, seed=2)
    assert np.array_equal(fewer.luck, draws.luck[:, :3])
    assert np.array_equal(fewer.best, draws.best[:, :3])


def brute_force(choices, rewards, better, worse, hazard):
    """Return the posterior of arm 1 for the next trial, summed over all histories of reversals."""
    total = np.zeros(2)
    for history in product((0, 1), repeat=len(choices) + 1):
        p = 0.5
        for k, best in enumerate(history):
            if k:
                p *= hazard if best != history[k - 1] else 1 - hazard
            if k < len(choices):
                chance = better if choices[k] == best else worse
                p *= chance if rewards[k] else 1 - chance
        total[history[-1]] += p
    return total[1] / total.sum()


ARMS_AND_REWARDS = st.lists(st.tuples(st.integers(0, 1), st.integers(0, 1)), max_size=7)


@given(P, P, st.floats(0.0, 0.5), ARMS_AND_REWARDS)
@settings(max_examples=40)
def test_the_ideal_learner_is_the_sum_over_all_histories(one, other, hazard, seen):
    if abs(one - other) < 0.01:
        return
    p = {"better": max(one, other), "worse": min(one, other), "hazard": hazard}
    choices, rewards = [c for c, _ in seen], [r for _, r in seen]
    belief = after(IdealLearner(**p), choices, rewards)
    assert belief[1] == pytest.approx(brute_force(choices, rewards, **p), abs=1e-12)
    assert belief.sum() == pytest.approx(1)


def test_q_approaches_a_constant_reward_geometrically_and_leaves_the_other_arm():
    values = after(QLearning(rate=0.3), [1] * 5, [1] * 5)
    assert values.tolist() == pytest.approx([0.5, 1 - 0.5 * 0.7**5])
    values = after(QBoth(rate=0.3), [1] * 5, [1] * 5)
    assert values.tolist() == pytest.approx([0.5 * 0.7**5, 1 - 0.5 * 0.7**5])
    values = after(QLearning(rate=0.3, rate_minus=0.1), [1, 1], [1, 0])
    assert values[1] == pytest.approx(0.65 * 0.9)
    assert after(LogitQ(rate=0.3), [1], [1])[1] == pytest.approx(logit(0.65))
    assert after(LogitQ(rate=1.0), [1], [1])[1] == pytest.approx(logit(0.99))


@given(P, st.floats(0.2, 5.0))
def test_unequal_rates_shift_the_confidence_by_the_logarithm_of_their_ratio(p, ratio):
    """At ``logit P = logit p + ln ratio`` the mean update of the confidence rule is 0."""
    learner = Confidence(rate=0.1 * ratio, rate_minus=0.1, decay=0.0)
    w = np.array([[0.0, logit(p) + np.log(ratio)]])
    up, down = (learner.learn(w, one_hot(1), np.float64(r)) - w for r in (1, 0))
    assert p * up + (1 - p) * down == pytest.approx(np.zeros((1, 2)), abs=1e-12)
    assert abs(0.9 * p * up + (1 - 0.9 * p) * down).max() > 1e-4


@given(st.floats(-2, 2), P, P, st.floats(0, 1))
def test_reinforce_follows_the_gradient_of_the_reward_whatever_the_baseline(w, first, second, mean):
    learner = Reinforce(rate=1.0, decay=0.0)
    state = np.array([[0.0, w], [mean, mean]])

    def expected(weights):
        p = expit(weights[1] - weights[0])
        return (1 - p) * first + p * second

    update, chance = np.zeros(2), expit(w)
    for arm, p in ((0, 1 - chance), (1, chance)):
        for reward, q in ((1, (first, second)[arm]), (0, 1 - (first, second)[arm])):
            moved = learner.learn(state, one_hot(arm), np.float64(reward))[0] - state[0]
            update += p * q * moved
    steps = np.eye(2) * 1e-5
    slope = [(expected(state[0] + s) - expected(state[0] - s)) / 2e-5 for s in steps]
    assert update == pytest.approx(np.array(slope), abs=1e-8)


def test_opponent_weights_learn_in_opposite_directions_and_forget():
    gained = Opal(rate=0.5, critic_rate=0.0, decay=0.0)
    state = gained.learn(gained.start(()), one_hot(1), np.float64(1))
    assert state[:2, 1].tolist() == [1.25, 0.75]
    assert state[:2, 0].tolist() == [1.0, 1.0]
    forgets = Opal(decay=1.0, rate=0.0)
    assert forgets.learn(state, one_hot(1), np.float64(1))[:2].tolist() == [[1, 1], [1, 1]]
    assert Opal(rho=1.0).values(state)[1] == 2.5  # go alone
    assert Opal(rho=-1.0).values(state)[1] == -1.5  # no-go alone


@pytest.mark.parametrize("name", LEARNERS)
def test_learners_side_by_side_are_learners_alone_and_a_seed_gives_the_same_choices(name):
    kind, rates = type(learner_of(name)), np.array([0.1, 0.3])
    together, state = kind(rate=rates), kind(rate=rates).start((2,))
    alone = [(kind(rate=r), kind(rate=r).start(())) for r in rates]
    for choice, reward in ((1, 1.0), (0, 1.0), (1, 0.0), (1, 1.0)):
        state = together.learn(state, one_hot([choice] * 2), np.full(2, reward))
        alone = [(one, one.learn(s, one_hot(choice), np.float64(reward))) for one, s in alone]
    apart = np.stack([one.values(s) for one, s in alone])
    assert together.values(state) == pytest.approx(apart)
    first, again, few = (play(name, Bandit(), trials=20, runs=n, seed=3) for n in (5, 5, 2))
    assert np.array_equal(first.choice, again.choice)
    assert np.array_equal(few.choice, first.choice[:, :2])


test_bad_input_is_refused = refusing(
    (lambda: Bandit(1.0, 0.2), "better"),
    (lambda: Bandit(0.5, 0.0), "worse"),
    (lambda: Bandit(0.4, 0.4), "better"),
    (lambda: Bandit(reverse_every=0), "reverse_every"),
    (lambda: Bandit(reverse_every=5, hazard=0.1), "hazard"),
    (lambda: Bandit(hazard=1.5), "hazard"),
    (lambda: Bandit().draw(0, 1, 1), "trials"),
    (lambda: learner_of("sarsa"), "learner"),
    (lambda: QLearning(rate=1.2), "rate"),
    (lambda: QLearning(beta=np.nan), "beta"),
    (lambda: Opal(rho=2.0), "rho"),
    (lambda: Reinforce(beta=2.0), "beta"),
    (lambda: Confidence(rate="fast"), "rate"),
    (lambda: IdealLearner(better=0.5, worse=0.6), "better"),
)


def test_the_ideal_learner_has_the_least_regret_where_reversals_have_its_hazard():
    bandit = Bandit(hazard=0.03)
    ideal = play(ideal_of(bandit), bandit, trials=400, runs=150, seed=4)
    others = [IdealLearner(better=0.8, worse=0.2, hazard=h) for h in (0.0005, 0.4)]
    for learner in (*others, *LEARNERS):
        ratio, error = relative_regret(play(learner, bandit, trials=400, runs=150, seed=4), ideal)
        assert ratio - 1 > -2 * error
    assert relative_regret(ideal, ideal) == (1.0, 0.0)


def test_regret_counts_the_rewards_forgone():
    played = play("q", Bandit(0.9, 0.4), trials=30, runs=4, seed=5)
    wrong = (played.choice != played.draws.best).sum(axis=0)
    assert played.regret == pytest.approx(0.5 * wrong)
    assert np.isnan(played.time_ms).all()


@pytest.fixture(scope="module")
def circuit():
    return ValueCircuit(bg.BasalGanglia("macaque", seed=1), seed=2)


def test_evidence_has_a_drift_proportional_to_the_difference_of_values(circuit):
    evidence = circuit.evidence(np.tile([0.3, 0.6], (400, 1)))
    ratio = evidence.log_likelihood[..., 1] - evidence.log_likelihood[..., 0]
    error = ratio.std() / np.sqrt(ratio.size)
    assert ratio.mean() == pytest.approx(0.25 * 0.3 / 0.6, abs=4 * error)
    assert ratio.var() == pytest.approx(2 * 0.25, rel=0.03)
    assert (evidence.truth == 1).all()
    # At the stated difference the ratios are exact: exp(-ratio) has a mean of 1 under the truth.
    exact = circuit.evidence(np.tile([0.2, 0.8], (400, 1))).log_likelihood
    odds = np.exp(exact[..., 0] - exact[..., 1])
    assert odds.mean() == pytest.approx(1, abs=4 * odds.std() / np.sqrt(odds.size))


def test_the_better_action_is_chosen_more_often_and_sooner_with_the_difference(circuit):
    made = [circuit.decide(np.tile([0.5 - d / 2, 0.5 + d / 2], (400, 1))) for d in (0.1, 0.3, 0.6)]
    share = np.array([one.accuracy for one in made])
    times = [float(np.median(one.time_ms)) for one in made]
    assert (np.diff(share) > 0.03).all()
    assert (np.diff(times) < -30).all()
    # Constant noise and bound: the log-odds of a choice are proportional to the difference.
    odds = np.log(share / (1 - share)) / [0.1, 0.3, 0.6]
    error = 1 / np.sqrt(400 * share * (1 - share)) / [0.1, 0.3, 0.6]
    assert abs(odds[1] - odds[2]) < 4 * np.hypot(error[1], error[2])


def test_each_block_has_its_own_noise_and_a_seed_gives_the_same_bytes(circuit):
    values = np.tile([0.5, 0.5], (30, 1))
    first, again, other = (circuit.decide(values, k).time_ms for k in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    # The noise of cells is that of the block as well.
    evidence, level = circuit.evidence(values, 3), circuit.model.threshold(None, 0.85)
    known = circuit.model.decided(evidence, level, first_trial=90).time_ms
    assert np.array_equal(first, known)
    assert not np.array_equal(known, circuit.model.decided(evidence, level).time_ms)


def test_choices_of_the_circuit_teach_the_learner(circuit):
    played = play(QBoth(rate=0.3), Bandit(), trials=40, runs=8, seed=3, chooser=circuit)
    assert np.isfinite(played.time_ms).all()
    assert played.difference[-10:].mean() > 0.4
    assert played.correct[-10:].mean() > 0.75


test_circuits_that_cannot_choose_are_refused = refusing(
    (lambda: ValueCircuit(bg.BasalGanglia("macaque", "algebra")), "model"),
    (lambda: ValueCircuit(bg.BasalGanglia(bg.load_circuit("macaque", 3))), "model"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque"), difference=0.0), "difference"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque"), posterior=0.999), "thresholds"),
    (lambda: ValueCircuit(bg.BasalGanglia("macaque")).evidence([0.5, 0.5]), "values"),
)
