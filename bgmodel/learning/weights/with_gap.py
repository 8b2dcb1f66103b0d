"""Learning weights and the gap together, and the regret relative to the exact optimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.deciding.reward import mean_reward, reward_of
from bgmodel.learning.policies import SEPARATIONS, GaussianPolicy
from bgmodel.learning.reinforce import Learned, Learner, exhaustive_search, learn
from bgmodel.learning.weights.critics import Critic, critic_of
from bgmodel.learning.weights.deciders import FixedPoint
from bgmodel.learning.weights.features import Features, FeatureSource
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.learning.weights.learned import LearnedWeights
from bgmodel.learning.weights.loop import Loop
from bgmodel.learning.weights.rules import Rule, rule_of
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from bgmodel.theory.sprt import widened
from circuits.errors import InputError, require

GAPS = 161
"""Number of gaps over ``SEPARATIONS`` among which the best one is found, or of a wider range."""


@dataclass(frozen=True)
class LearnedTogether:
    """Weights and gaps of several runs."""

    weights: LearnedWeights  # averaged over the last trials
    gap: Learned  # gap.learned holds the learned gaps, (runs,), nats

    def regret(self, features: Features, xi: float) -> Array:
        """Return the excess cost over the exact optimum on held-out readings, relative, (runs,).

        The cost is ``xi`` times the share of errors plus the mean number of readings. The optimum
        is the best of ``GAPS`` gaps with the exact likelihoods of the same readings.
        """

        def exact(gaps: Array) -> Array:
            return -mean_reward(exhaustive_search(features.exact, gaps), xi)

        best = float(widened(exact, np.linspace(*SEPARATIONS, GAPS))[1].min())
        cost = [
            -float(
                mean_reward(exhaustive_search(self.weights.to_evidence(features, run), gap), xi)[0]
            )
            for run, gap in enumerate(self.gap.learned)
        ]
        return (np.array(cost) - best) / best


def learn_weights_and_gap(
    source: FeatureSource,
    *,
    xi: float,
    start_separation: float,
    seed: int,
    rule: Rule | str = "confidence",
    critic: Critic | str | None = None,
    learner: WeightLearner | None = None,
    policy: GaussianPolicy | None = None,
    gap_learner: Learner | None = None,
    runs: int = 8,
) -> LearnedTogether:
    """Learn weights and the gap from the same trials of two hypotheses.

    Whether the choice was right teaches the weights; the reward ``r = xi W - T``, with W = -1 after
    an error and 0 otherwise, teaches the gap, nats, by REINFORCE (Burguete et al. 2023). The gap of
    a trial is that at which the fixed point stops.
    """
    learner = learner or WeightLearner(trials=40_000)
    rule = rule_of(rule)
    critic = critic_of(rule.critic if critic is None else critic)
    gap_learner = gap_learner or Learner(episodes=learner.trials)
    same = f"must be those of the weights, {learner.trials}"
    require(gap_learner.episodes == learner.trials, "episodes", same, gap_learner.episodes)
    loop = Loop(source, rule, critic, Feedback(), learner, FixedPoint(), runs, seed, "together")
    if len(loop.names) != 2:
        raise InputError(f"source must have 2 hypotheses, has {len(loop.names)}", "source")

    def rewards(episode: int, gaps: Array) -> Array:
        _, correct, readings = loop.trial(1 / (1 + np.exp(-gaps / 2)))
        return reward_of(~correct, readings, xi)

    explored = [stream(seed, "together", "gap", run) for run in range(runs)]
    gap = learn(rewards, start_separation, rngs=explored, policy=policy, learner=gap_learner)
    return LearnedTogether(LearnedWeights(loop.final, loop.names), gap)
