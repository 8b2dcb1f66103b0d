"""Learning what evidence means: draw, choose, reward, change, for several runs side by side."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bgmodel.evidence import minus_log_softmax
from bgmodel.learning.critics import Critic, ReadOutConfidence, Trial, critic_of
from bgmodel.learning.deciders import Decider, FixedPoint, InCircuit, TrialOfRuns, WeightLearner
from bgmodel.learning.feature_sources import FeatureSource, source_at
from bgmodel.learning.features import Features, check_learnable
from bgmodel.learning.learned_weights import LearnedWeights, WeightCourse
from bgmodel.learning.weight_rules import Rule, rule_of
from bgmodel.support.checks import whole
from bgmodel.support.processes import advance
from bgmodel.support.seeds import stream
from circuits.arrays import Array
from circuits.errors import InputError

BLOCK = 250
"""Trials drawn at a time for each run."""
SAMPLE = 1000
"""Trials in which every unit must be active and every hypothesis true."""
RUNNING = 0.01
"""Weight of each trial in the running mean and variance of the trace."""
LEAST_VARIANCE = 1e-3
"""Least variance of the trace that a step size is divided by."""


@dataclass
class Loop:
    """Independent learners side by side; parameters are those of ``learn_weights``."""

    source: FeatureSource
    rule: Rule
    critic: Critic
    learner: WeightLearner
    decider: Decider
    runs: int
    seed: int
    name: object = "weights"
    number: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.runs = whole("runs", self.runs, 1)
        sample = self.source.draw(SAMPLE, rng=stream(self.seed, self.name, "sample"))
        check_learnable(sample)
        self.names = sample.names
        self._rngs = [stream(self.seed, self.name, run) for run in range(self.runs)]
        self._state = self.critic.start(self.runs)
        self._mean = np.zeros((self.runs, sample.units))
        self._variance = np.zeros((self.runs, 1, 1))
        self._parameters = self.rule.start((self.runs, sample.hypotheses, sample.units))

    @property
    def weights(self) -> Array:
        """Weights (runs, hypotheses, units), nats of evidence per unit of activity."""
        return self.rule.weights(self._parameters)

    def run(self) -> WeightCourse:
        """Run all trials of every run, learn from each, and return the course of learning."""
        learner, weights = self.learner, []
        kept = np.unique(np.linspace(0, learner.trials, learner.keep + 1).round().astype(int))[1:]
        correct = np.empty((self.runs, learner.trials), bool)
        readings, confidence = np.empty(correct.shape), np.empty(correct.shape)
        total = np.zeros(self.weights.shape)
        for k in range(learner.trials):
            at, self.number = k % BLOCK, k
            if at == 0:
                self._draw()
            part = self._parts[at]
            chosen = self.decider.choose(part, self.weights, self._noise[:, at], k)
            correct[:, k] = chosen.choice == part.truth
            trial = self._seen(part, chosen, correct[:, k].astype(np.float64))
            self._learn(trial)
            readings[:, k] = chosen.last + 1.0
            confidence[:, k] = trial.of_choice(trial.posterior)
            if k >= learner.trials - learner.last:
                total += self.weights
            if k + 1 in kept:
                weights.append(self.weights.copy())
            if at + 1 == BLOCK:
                advance(BLOCK)
        course = np.stack(weights, axis=1)
        return WeightCourse(kept, course, correct, readings, confidence, total / learner.last)

    def _draw(self) -> None:
        """Draw a block of trials of every run, each from its own generator."""
        source = source_at(self.source, self.number)
        drawn = [source.draw(BLOCK, rng=rng) for rng in self._rngs]
        self._parts = side_by_side(drawn)
        # More numbers than are used, so that results keep their bytes.
        shape = (BLOCK, len(self.names) + 1)
        self._noise = np.stack([r.standard_normal(shape) for r in self._rngs])[..., :-1]
        for rng in self._rngs:
            rng.random((BLOCK, 2))

    def _seen(self, part: Features, chosen: TrialOfRuns, reward: Array) -> Trial:
        """Return the trial as critic and rule see it."""
        heard = (np.arange(part.steps) <= chosen.last[:, None]).astype(np.float64)
        trace = np.asarray((heard[:, None, :] @ part.values)[:, 0], dtype=np.float64)
        posterior = np.exp(-minus_log_softmax(chosen.drive))
        surplus = trace - self._mean
        pace = max(RUNNING, 1 / (self.number + 1))
        self._mean += pace * surplus
        self._variance += pace * ((surplus**2).sum(axis=1)[:, None, None] - self._variance)
        return Trial(trace, chosen.choice, posterior, chosen.read_out, reward)

    def _learn(self, trial: Trial) -> None:
        """Change weights and critic by the reward of a trial."""
        surprise = trial.reward - self.critic.expected(self._state, trial)
        change = self.rule.change(self._parameters, trial, surprise)
        step = self.learner.step(self.number) / np.maximum(self._variance, LEAST_VARIANCE)
        moved = self._parameters + step * change
        self._parameters = self.rule.bounded(moved)
        if not np.isfinite(self._parameters).all():
            reason = (
                f"the weights are no longer finite after {self.number + 1} trials: lower the rate"
            )
            raise InputError(reason, "rate", self.learner.rate)
        self._state = self.critic.learn(self._state, trial, surprise)


def side_by_side(drawn: list[Features]) -> list[Features]:
    """Return trial k of every run as features of one trial per run, for each k."""
    first = drawn[0]
    values = np.stack([part.values for part in drawn], axis=1)
    truth = np.stack([part.truth for part in drawn], axis=1)
    lengths = np.stack([part.readings for part in drawn], axis=1)
    by_trial = []
    for k in range(len(values)):
        part = object.__new__(Features)  # already checked
        of_trial = {"values": values[k], "truth": truth[k], "lengths": lengths[k]}
        same = {"names": first.names, "step_ms": first.step_ms, "removed": first.removed}
        for name, value in (of_trial | same | {"log_likelihood": None}).items():
            object.__setattr__(part, name, value)
        by_trial.append(part)
    return by_trial


def learn_weights(
    source: FeatureSource,
    *,
    seed: int,
    rule: Rule | str = "confidence",
    critic: Critic | str | None = None,
    learner: WeightLearner | None = None,
    decider: Decider | None = None,
    runs: int = 8,
    name: object = "weights",
) -> LearnedWeights:
    """Learn weights from reward, in several independent runs side by side.

    In each trial the weights turn features into drives, the decider (by default ``FixedPoint()``,
    which stops at a posterior of 0.9) turns these into a choice, and the rule changes the weights
    by the reward, 1 or 0, less what the critic expected: by default, in a circuit, the posterior
    read from SNr, up to the highest that it can express. A unit that is never active raises.
    """
    rule = rule_of(rule)
    learner, decider = learner or WeightLearner(), decider or FixedPoint()
    if critic is None and isinstance(decider, InCircuit):
        critic = ReadOutConfidence(decider.ceiling)
    critic = critic_of(rule.critic if critic is None else critic)
    loop = Loop(source, rule, critic, learner, decider, runs, seed, name)
    course = loop.run()
    return LearnedWeights(course.final, loop.names, decider.gain, course)
