"""Learning what evidence means: weights from features to channels, taught by reward alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from bgmodel.evidence import minus_log_softmax
from bgmodel.learning.critics import Critic, Trial, critic_of
from bgmodel.learning.features import Features, FeatureSource, check_learnable
from bgmodel.learning.learned_weights import LearnedWeights, WeightCourse
from bgmodel.learning.rules import Rule, rule_of
from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.checks import check_positive, check_range, whole
from bgmodel.support.progress import advance
from bgmodel.support.seeds import stream
from circuits.errors import CalibrationWarning, InputError, NoiseWarning, require

BLOCK = 250
"""Trials drawn at a time for each run."""
SAMPLE = 1000
"""Trials in which every unit must be active and every hypothesis true."""
RUNNING = 0.01
"""Weight of each trial in the running means of the trace and of its square."""
LEAST_SQUARE = 1e-3
"""Least squared trace that a step size is divided by."""
TIE = 1e-9
"""Size of the noise that breaks ties of drives, nats."""
MOST_OVERSHOOT = 0.02
"""Mean posterior at the decision beyond the criterion from which that is no critic."""


@dataclass(frozen=True)
class Feedback:
    """What a learner is told after its choice."""

    right: float = 1.0
    """Reward for a correct choice."""
    wrong: float = 0.0
    """Reward for an error."""
    valid: float = 1.0
    """Share of trials in which the reward is that of the choice; it is reversed in the others."""
    given: float = 1.0
    """Share of trials with any reward; in the others nothing is learned."""
    reversal: int | None = None
    """Number of the trial from which labels are exchanged: hypothesis i is rewarded as i + 1."""

    def __post_init__(self) -> None:
        check_range(0, 1, valid=self.valid, given=self.given)
        require(self.right > self.wrong, "right", f"must exceed wrong, {self.wrong:g}", self.right)
        if self.given == 0:
            raise InputError(
                "without any feedback nothing can be learned: given must be > 0", "given"
            )
        if self.reversal is not None:
            whole("reversal", self.reversal, 1)

    @property
    def of_unit(self) -> bool:
        """Whether rewards are 0 and 1."""
        return (self.right, self.wrong) == (1.0, 0.0)

    def label(self, truth: Integers, hypotheses: int, number: int) -> Integers:
        """Return the hypothesis that is rewarded in trial ``number``, (runs,)."""
        turned = self.reversal is not None and number >= self.reversal
        return (truth + turned) % hypotheses

    def reward(self, correct: Truths, chance: Array) -> Array:
        """Return the reward of choices (runs,), NaN without feedback; chance (runs, 2) uniform."""
        told = correct == (chance[:, 0] < self.valid)
        reward = np.where(told, self.right, self.wrong)
        return np.where(chance[:, 1] < self.given, reward, np.nan)


@dataclass(frozen=True)
class WeightLearner:
    """How weights change: step size, gains of the two signs of the error, trace."""

    trials: int = 10_000
    """Number of trials."""
    rate: float = 0.5
    """Initial step size, divided by the running mean of the squared trace, so that it suits any
    number and activity of units; tuned on seed 1."""
    half_trials: float = 3_000.0
    """Trials after which the step size has halved; infinity keeps it constant, as required in a
    changing environment; tuned on seed 1."""
    gain_plus: float = 1.0
    """Factor on positive errors."""
    gain_minus: float = 1.0
    """Factor on negative errors."""
    trace_decay: float = 1.0
    """Factor on the trace of earlier features at each reading; 1 keeps them all."""
    averaged: float = 0.25
    """Share of the last trials over whose weights the result is averaged (Polyak & Juditsky 1992);
    0 takes the last weights."""
    keep: int = 100
    """Number of times at which weights are kept, evenly spaced."""

    def __post_init__(self) -> None:
        whole("trials", self.trials, 1)
        check_positive(rate=self.rate, gain_plus=self.gain_plus, gain_minus=self.gain_minus)
        require(self.half_trials > 0, "half_trials", "must be > 0", self.half_trials)
        check_range(0, 1, trace_decay=self.trace_decay, averaged=self.averaged)
        whole("keep", self.keep, 1)

    @property
    def last(self) -> int:
        """Number of last trials over whose weights the result is averaged."""
        return max(1, round(self.averaged * self.trials))

    def step(self, number: int) -> float:
        """Return the step size of a trial."""
        return self.rate / (1 + number / self.half_trials)

    def error(self, surprise: Array) -> Array:
        """Return the error (runs,) from reward less expectation; 0 without feedback."""
        known = np.nan_to_num(surprise, nan=0.0)
        return np.asarray(known * np.where(known > 0, self.gain_plus, self.gain_minus))


@dataclass(frozen=True)
class Choices:
    """Choices of every run in one trial.

    Parameters
    ----------
    last : int array (runs,)
        Index of the last reading before the choice.
    choice : int array (runs,)
        Chosen hypothesis.
    drive : array (runs, hypotheses), nats
        Drive by the readings up to the last one.
    read_out : array (runs,)
        Posterior of the choice as read from OUT.
    """

    last: Integers
    choice: Integers
    drive: Array
    read_out: Array


class Decider(Protocol):
    """Turns features and weights into choices, for several runs at once."""

    @property
    def criterion(self) -> float:
        """Posterior at which it decides."""
        ...

    @property
    def gain(self) -> float:
        """Nats of drive per nat of evidence, kappa."""
        ...

    def choose(
        self, part: Features, weights: Array, criterion: Array, noise: Array, number: int
    ) -> Choices:
        """Choose in one trial of every run.

        Parameters
        ----------
        part : Features
            One trial per run.
        weights : array (runs, hypotheses, units)
            Weights of each run.
        criterion : array (runs,)
            Posterior at which each run decides.
        noise : array (runs, hypotheses + 1)
            Standard normal numbers.
        number : int
            Number of the trial.
        """
        ...


@dataclass(frozen=True)
class FixedPoint:
    """The circuit's fixed point: ``OUT = -ln softmax(gain sum_t w . phi_t)``, without dynamics."""

    criterion: float = 0.9
    """Posterior at which a trial stops; otherwise it ends with its last reading."""
    gain: float = 1.0
    """Nats of drive per nat of evidence."""
    sampled: int | None = None
    """Number of readings, if this is fixed and there is no criterion."""
    read_out_sd_nats: float = 0.0
    """Standard deviation of noise on the OUT that critics read, nats."""

    def __post_init__(self) -> None:
        check_range(0, 1, criterion=self.criterion)
        check_positive(gain=self.gain)
        check_range(0, np.inf, read_out_sd_nats=self.read_out_sd_nats)
        if self.sampled is not None:
            whole("sampled", self.sampled, 1)

    def choose(
        self, part: Features, weights: Array, criterion: Array, noise: Array, number: int
    ) -> Choices:
        """Choose at the first reading at which a posterior reaches the criterion."""
        runs = np.arange(len(weights))
        drive = self.gain * np.cumsum(part.values @ weights.swapaxes(1, 2), axis=1)
        out = minus_log_softmax(drive)
        last = part.readings - 1
        if self.sampled is None:
            reached = (out <= -np.log(criterion)[:, None, None]).any(axis=2)
            last = np.where(reached.any(axis=1), reached.argmax(axis=1), last)
        else:
            last = np.minimum(last, self.sampled - 1)
        heard, read = drive[runs, last], out[runs, last]
        choice = (heard + TIE * noise[:, :-1]).argmax(axis=1)
        nats = read[runs, choice] + self.read_out_sd_nats * noise[:, -1]
        return Choices(last, choice, heard, np.exp(-nats))


@dataclass
class Loop:
    """Independent learners side by side; ``trial`` runs the next trial of each.

    Parameters are those of ``learn_weights``; ``weights`` are the current ones.
    """

    source: FeatureSource
    rule: Rule
    critic: Critic
    feedback: Feedback
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
        _check_together(self.rule, self.critic, self.feedback)
        self.names = sample.names
        self._rngs = [stream(self.seed, self.name, run) for run in range(self.runs)]
        self._state = self.critic.start(self.runs)
        self._mean = np.zeros((self.runs, sample.units))
        self._square = np.zeros((self.runs, 1, 1))
        self._total = np.zeros((self.runs, sample.hypotheses, sample.units))
        self._parameters = self.rule.start((self.runs, sample.hypotheses, sample.units))

    @property
    def weights(self) -> Array:
        """Weights (runs, hypotheses, units), nats of evidence per unit of activity."""
        return self.rule.weights(self._parameters)

    @property
    def final(self) -> Array:
        """Weights averaged over the last trials so far, (runs, hypotheses, units)."""
        count = self.number - (self.learner.trials - self.learner.last)
        return self._total / count if count > 0 else self.weights

    def trial(self, criterion: Array | None = None) -> tuple[Trial, Truths, Array]:
        """Run one trial of every run, and learn from it.

        Parameters
        ----------
        criterion : array (runs,), optional
            Posterior at which each run decides; by default that of the decider.

        Returns
        -------
        trial : Trial
        correct : bool array (runs,)
            Whether choices were right, whatever the feedback.
        readings : array (runs,)
            Number of readings before the choice.
        """
        at = self.number % BLOCK
        if at == 0:
            self._draw()
        if criterion is None:
            criterion = np.full(self.runs, self.decider.criterion)
        part, chance = self._parts[at], self._chance[:, at]
        chosen = self.decider.choose(part, self.weights, criterion, self._noise[:, at], self.number)
        label = self.feedback.label(part.truth, len(self.names), self.number)
        correct = chosen.choice == label
        trial = self._seen(part, chosen, criterion, self.feedback.reward(correct, chance))
        self._learn(trial)
        if self.number >= self.learner.trials - self.learner.last:
            self._total += self.weights
        self.number += 1
        if self.number % BLOCK == 0:
            advance(BLOCK)
        return trial, correct, chosen.last + 1.0

    def _draw(self) -> None:
        """Draw a block of trials of every run, each from its own generator."""
        drawn = [self.source.draw(BLOCK, rng=rng) for rng in self._rngs]
        self._parts = side_by_side(drawn)
        hypotheses = len(self.names)
        self._noise = np.stack([r.standard_normal((BLOCK, hypotheses + 1)) for r in self._rngs])
        self._chance = np.stack([r.random((BLOCK, 2)) for r in self._rngs])

    def _seen(self, part: Features, chosen: Choices, criterion: Array, reward: Array) -> Trial:
        """Return the trial as critic and rule see it."""
        since = chosen.last[:, None] - np.arange(part.steps)
        kept = np.where(since >= 0, self.learner.trace_decay ** np.maximum(since, 0), 0.0)
        trace = (kept[:, None, :] @ part.values)[:, 0]
        posterior = np.exp(-minus_log_softmax(chosen.drive))
        surplus = trace - self._mean
        pace = max(RUNNING, 1 / (self.number + 1))
        self._mean += pace * surplus
        self._square += pace * ((trace**2).sum(axis=1)[:, None, None] - self._square)
        return Trial(
            trace, chosen.choice, chosen.drive, posterior, chosen.read_out, criterion, reward,
            surplus,
        )  # fmt: skip

    def _learn(self, trial: Trial) -> None:
        """Change weights and critic by the reward of a trial."""
        surprise = trial.reward - self.critic.expected(self._state, trial)
        change = self.rule.change(self._parameters, trial, self.learner.error(surprise))
        step = self.learner.step(self.number) / np.maximum(self._square, LEAST_SQUARE)
        moved = self._parameters + step * change
        self._parameters = self.rule.bounded(moved)
        if not np.isfinite(self._parameters).all():
            said = (
                f"the weights are no longer finite after {self.number + 1} trials: lower the rate"
            )
            raise InputError(said, "rate", self.learner.rate)
        known = np.nan_to_num(surprise, nan=0.0)
        self._state = self.critic.learn(self._state, trial, known)


def side_by_side(drawn: list[Features]) -> list[Features]:
    """Return trial k of every run as features of one trial per run, for each k."""
    first = drawn[0]
    values = np.stack([part.values for part in drawn], axis=1)
    truth = np.stack([part.truth for part in drawn], axis=1)
    lengths = np.stack([part.readings for part in drawn], axis=1)
    found = []
    for k in range(len(values)):
        part = object.__new__(Features)  # already checked
        of_trial = {"values": values[k], "truth": truth[k], "lengths": lengths[k]}
        same = {"names": first.names, "step_ms": first.step_ms, "removed": first.removed}
        for name, value in (of_trial | same | {"log_likelihood": None}).items():
            object.__setattr__(part, name, value)
        found.append(part)
    return found


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

    In each trial the weights turn features into drives, the decider turns these into a choice, and
    the rule changes the weights by the reward less what the critic expected.

    Parameters
    ----------
    source : FeatureSource or Features
        Trials for learning.
    seed : int
        Seed of trials, noise and feedback.
    rule : Rule or str
        A name in ``RULES`` or a record with options.
    critic : Critic or str, optional
        A name in ``CRITICS`` or a record; by default that of the rule.
    feedback : Feedback, optional
        Rewards; by default 1 if the choice is right and 0 otherwise.
    learner : WeightLearner, optional
        Step size and number of trials.
    decider : Decider, optional
        By default ``FixedPoint()``, which stops at a posterior of 0.9.
    runs : int
        Number of independent runs.
    name : object
        Name of the random-number streams.

    Raises
    ------
    ValueError
        If a hypothesis is never true or a unit never active, if rewards are not 0 and 1 where a
        rule or critic needs probabilities, or if weights do not stay finite.

    Warns
    -----
    UserWarning
        If feedback is unreliable and the critic assumes that it is valid, or if the criterion is
        the critic and decisions overshoot it.
    """
    rule = rule_of(rule)
    critic = critic_of(rule.critic if critic is None else critic)
    learner, decider = learner or WeightLearner(), decider or FixedPoint()
    feedback = feedback or Feedback()
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


def _check_together(rule: Rule, critic: Critic, feedback: Feedback) -> None:
    """Refuse rewards that a rule or critic cannot use; warn of unreliable ones."""
    for part in (rule, critic):
        if part.unit_rewards and not feedback.of_unit:
            raise InputError(
                f"{part.name!r} takes rewards as 0 or 1, the outcome of a probability, got "
                f"{feedback.wrong:g} and {feedback.right:g}: rescale them, or use the rule "
                "'reinforce'",
                "right",
                feedback.right,
            )
    if feedback.valid < 1 and critic.reliable:
        CalibrationWarning.warn(
            f"the critic {critic.name!r} takes feedback as always valid, but it is so in "
            f"{feedback.valid:.0%} of trials: weights will be too small; use the critic 'affine'"
        )
    if feedback.valid == 0.5:
        NoiseWarning.warn("feedback that is valid in half of the trials tells nothing")


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
