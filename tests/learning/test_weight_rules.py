"""Rules and critics against gradients by finite differences and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.learning.critics import ConfidenceCritic, ReadOutConfidence, RunningMean, Trial
from bgmodel.learning.weight_rules import (
    ChosenRule,
    ConfidenceRule,
    Hebbian,
    OpponentActor,
    ReinforceRule,
)

RUNS, UNITS = 6, 4


def posterior_of(drive):
    p = np.exp(drive - drive.max(axis=1, keepdims=True))
    return p / p.sum(axis=1, keepdims=True)


def trial_of(weights, choice=None, reward=None, seed=1):
    """Return a trial of every run under some weights (runs, hypotheses, units)."""
    rng = np.random.default_rng(seed)
    runs, hypotheses, units = weights.shape
    trace = rng.exponential(1, (runs, units))
    drive = (weights @ trace[:, :, None])[..., 0]
    chosen = rng.integers(hypotheses, size=runs) if choice is None else np.asarray(choice)
    posterior = posterior_of(drive)
    rewards = rng.integers(2, size=runs).astype(float) if reward is None else reward
    read_out = posterior[np.arange(runs), chosen]
    return Trial(trace, chosen, posterior, read_out, rewards)


def numerical_gradient(log_probability, weights):
    """Return the gradient of each run's log probability by central differences."""
    gradient = np.zeros_like(weights)
    for index in np.ndindex(weights.shape[1:]):
        step = np.zeros_like(weights)
        step[(slice(None), *index)] = 1e-5
        rise = log_probability(weights + step) - log_probability(weights - step)
        gradient[(slice(None), *index)] = rise / 2e-5
    return gradient


def some_weights(hypotheses):
    return np.random.default_rng(3).normal(0, 0.4, (RUNS, hypotheses, UNITS))


@pytest.mark.parametrize("hypotheses", [2, 4])
def test_the_confidence_rule_is_the_gradient_of_the_log_probability_of_the_reward(hypotheses):
    weights = some_weights(hypotheses)
    trial = trial_of(weights)

    def log_probability(w):
        p = posterior_of((w @ trial.eligibility[:, :, None])[..., 0])
        p = p[np.arange(RUNS), trial.choice]
        return np.where(trial.reward == 1, np.log(p), np.log1p(-p))

    error = trial.reward - ConfidenceCritic().expected(np.zeros((RUNS, 0)), trial)
    change = ConfidenceRule().change(weights, trial, error)
    assert change == pytest.approx(numerical_gradient(log_probability, weights), abs=1e-8)


def test_the_chosen_rule_is_the_confidence_rule_in_the_chosen_channel():
    weights = some_weights(3)
    trial = trial_of(weights)
    error = trial.reward - 0.6
    chosen = np.eye(3)[trial.choice][:, :, None]
    every = ConfidenceRule().change(weights, trial, error)
    assert ChosenRule().change(weights, trial, error) == pytest.approx(every * chosen)


def test_reinforce_is_the_gradient_of_the_log_probability_of_the_choice():
    weights = some_weights(3)
    trial = trial_of(weights)

    def log_probability(w):
        p = posterior_of((w @ trial.eligibility[:, :, None])[..., 0])
        return np.log(p[np.arange(RUNS), trial.choice])

    known = 0.3 * numerical_gradient(log_probability, weights)
    change = ReinforceRule().change(weights, trial, np.full(RUNS, 0.3))
    assert change == pytest.approx(known, abs=1e-8)


def test_the_hebbian_rule_rests_at_the_log_odds_of_a_reward():
    w = np.full((RUNS, 2, UNITS), np.log(0.7 / 0.3))
    after = [Hebbian().change(w, trial_of(w, reward=np.full(RUNS, r)), None) for r in (1.0, 0.0)]
    assert 0.7 * after[0] + 0.3 * after[1] == pytest.approx(0, abs=1e-12)


def test_opponent_weights_grow_in_proportion_to_themselves_and_dopamine_weighs_them():
    rule = OpponentActor(rho=0.5)
    start = rule.start((RUNS, 2, UNITS))
    trial = trial_of(some_weights(2))
    gained = rule.change(3 * start, trial, np.full(RUNS, 0.1))
    assert gained[0] == pytest.approx(-gained[1])
    assert gained[0] == pytest.approx(3 * rule.change(start, trial, np.full(RUNS, 0.1))[0])
    assert rule.weights(start) == pytest.approx(1.5 - 0.5)
    assert rule.bounded(start - 2).min() == 0


def test_critics_of_confidence_are_capped_where_the_circuit_is():
    trial = trial_of(5 * some_weights(2), choice=[0] * RUNS)
    trial = replace(trial, read_out=np.linspace(0.5, 1.2, RUNS))
    nothing, p = np.zeros((RUNS, 0)), trial.posterior[:, 0]
    assert ConfidenceCritic().expected(nothing, trial) == pytest.approx(p)
    critic, value = ReadOutConfidence(0.9, rate=0.5), trial.read_out
    state = critic.start(RUNS)
    assert critic.expected(state, trial) == pytest.approx(np.minimum(value, 0.9))
    moved = critic.learn(state, trial, np.full(RUNS, 0.1))
    assert (moved[:, 0] > 0.9).tolist() == (value >= 0.9).tolist()


def test_the_running_mean_is_the_mean_of_the_first_rewards():
    critic, state = RunningMean(), RunningMean().start(1)
    for reward in (1.0, 0.0, 1.0):
        trial = replace(trial_of(some_weights(2)[:1]), reward=np.array([reward]))
        state = critic.learn(state, trial, np.zeros(1))
    assert state.tolist() == [[pytest.approx(2 / 3), 3]]
