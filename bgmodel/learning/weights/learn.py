"""Learning what evidence means: weights from features to channels, taught by reward alone."""

from __future__ import annotations

import numpy as np

from bgmodel.learning.weights.critics import Affine, Critic, critic_of
from bgmodel.learning.weights.deciders import Decider, FixedPoint
from bgmodel.learning.weights.features import FeatureSource
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.learning.weights.learned import LearnedWeights, WeightCourse
from bgmodel.learning.weights.loop import Loop
from bgmodel.learning.weights.rules import Rule, rule_of
from circuits.errors import CalibrationWarning

MOST_OVERSHOOT = 0.02
"""Mean posterior at the decision beyond the criterion from which that is no critic."""


def learn_weights(
    source: FeatureSource,
    *,
    seed: int,
    rule: Rule | str = "confidence",
    critic: Critic | str | None = None,
    feedback: Feedback | None = None,
    learner: WeightLearner | None = None,
    decider: Decider | None = None,
    runs: int = 8,
    name: object = "weights",
) -> LearnedWeights:
    """Learn weights from reward, in several independent runs side by side.

    In each trial the weights turn features into drives, the decider (by default ``FixedPoint()``,
    which stops at a posterior of 0.9) turns these into a choice, and the rule changes the weights
    by the reward less what the critic expected. The critic "affine" knows the share of valid
    feedback. Warns if the critic assumes valid feedback and it is not, or if the criterion is the
    critic and decisions overshoot it; a unit that is never active raises.
    """
    rule = rule_of(rule)
    learner, decider = learner or WeightLearner(), decider or FixedPoint()
    feedback = feedback or Feedback()
    critic = critic_of(rule.critic if critic is None else critic)
    if critic == Affine():
        critic = Affine(valid=feedback.valid)
    loop = Loop(source, rule, critic, feedback, learner, decider, runs, seed, name)
    course = run_loop(loop)
    _warn_of_overshoot(critic, course, decider)
    return LearnedWeights(course.final, loop.names, decider.gain, course)


def run_loop(loop: Loop) -> WeightCourse:
    """Run all trials of a loop, and return the course of learning."""
    learner, runs = loop.learner, loop.runs
    kept = np.unique(np.linspace(0, learner.trials, learner.keep + 1).round().astype(int))[1:]
    correct = np.empty((runs, learner.trials), bool)
    readings, confidence = np.empty(correct.shape), np.empty(correct.shape)
    weights = []
    for k in range(learner.trials):
        trial, correct[:, k], readings[:, k] = loop.trial()
        confidence[:, k] = trial.of_choice(trial.posterior)
        if k + 1 in kept:
            weights.append(loop.weights.copy())
    course = np.stack(weights, axis=1)
    return WeightCourse(kept, course, correct, readings, confidence, loop.final)


def _warn_of_overshoot(critic: Critic, course: WeightCourse, decider: Decider) -> None:
    """Warn if the criterion is the critic and decisions overshoot it."""
    if critic.name != "criterion":
        return
    some = course.confidence[:, -min(500, course.confidence.shape[1]) :]
    beyond = float(some.mean()) - decider.criterion
    if beyond > MOST_OVERSHOOT:
        CalibrationWarning.warn(
            f"one reading takes the posterior {beyond:.3f} beyond the criterion of "
            f"{decider.criterion:g} on average, so the criterion is no estimate of the confidence "
            "and weights will be too large: use the critic 'settled' or 'read-out'"
        )
