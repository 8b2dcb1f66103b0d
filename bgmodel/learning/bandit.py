"""A two-armed bandit: its ideal learner, learners that play it, and a circuit that chooses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.value_learners import Number, ValueLearner, check_option, learner_of
from bgmodel.support.checks import check_finite, check_positive, check_range, reals, whole
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers, Truths
from circuits.errors import InputError, require


@dataclass(frozen=True)
class Bandit:
    """Two arms with rewards of 0 or 1; the better arm is drawn at the start of a run."""

    better: float = 0.8  # probability of a reward
    worse: float = 0.2
    reverse_every: int | None = None  # trials between reversals
    hazard: float = 0.0  # probability of a reversal after a trial; excludes reverse_every

    def __post_init__(self) -> None:
        check_probabilities(self.better, self.worse)
        check_range(0, 1, hazard=self.hazard)
        if self.reverse_every is not None:
            whole("reverse_every", self.reverse_every, 1)
            if self.hazard:
                raise InputError.of(
                    "hazard", "must be 0 if the arms reverse every few trials", self.hazard
                )

    def draw(self, trials: int, runs: int, seed: int) -> BanditDraws:
        """Return the random numbers of some runs, the same for every learner."""
        trials, runs = whole("trials", trials, 1), whole("runs", runs, 1)
        rngs = [stream(seed, "bandit", run) for run in range(runs)]
        first = np.array([rng.integers(2) for rng in rngs])
        uniform = np.stack([rng.random((trials, 3)) for rng in rngs], axis=1)
        if self.reverse_every is None:
            before = np.cumsum(uniform[:-1, :, 2] < self.hazard, axis=0)
            turned = np.concatenate([np.zeros((1, runs), dtype=np.intp), before])
        else:
            turned = (np.arange(trials) // self.reverse_every)[:, None]
        best = (first + turned) % 2
        return BanditDraws(self, best, uniform[..., 0], uniform[..., 1])


@dataclass(frozen=True, eq=False)
class BanditDraws:
    """What is random in some runs of a bandit, (trials, runs) each."""

    bandit: Bandit
    best: Integers  # the better arm, 0 or 1
    chance: Array  # uniform, from which choices are drawn
    luck: Array  # uniform, from which rewards are drawn

    def reward(self, trial: int, choice: Integers) -> Array:
        """Return the rewards of choices (runs,) in a trial, 0 or 1."""
        right = choice == self.best[trial]
        p = np.where(right, self.bandit.better, self.bandit.worse)
        return np.asarray(self.luck[trial] < p, dtype=np.float64)


def check_probabilities(better: float, worse: float) -> None:
    """Raise ValueError unless ``0 < worse < better < 1``."""
    check_finite(better=better, worse=worse)
    for name, p in (("better", better), ("worse", worse)):
        require(0 < p < 1, name, "must be between 0 and 1, both excluded", p)
    require(worse < better, "better", f"must exceed worse, {worse:g}", better)


@dataclass(frozen=True, eq=False, kw_only=True)
class IdealLearner(ValueLearner):
    """The posterior that either arm is the better one, given all choices and rewards so far.

    A hidden Markov filter: optimal if ``better + worse = 1`` and reversals have the hazard.
    """

    name: ClassVar[str] = "ideal"
    better: float = 0.8
    worse: float = 0.2
    hazard: float = 0.02
    beta: Number = np.inf

    def __post_init__(self) -> None:
        check_probabilities(self.better, self.worse)
        check_option("hazard", self.hazard, 0.0, 1.0)

    def start(self, shape: tuple[int, ...]) -> Array:
        """Return posteriors of 0.5."""
        return np.full((1, *shape, 2), 0.5)

    def learn(self, state: Array, chosen: Array, reward: Array) -> Array:
        """Return the posteriors for the next trial."""
        if_better = np.where(chosen > 0, self.better, self.worse)  # if arm i is the better one
        r = reward[..., None]
        joint = state[0] * np.where(r > 0, if_better, 1 - if_better)
        posterior = joint / joint.sum(axis=-1, keepdims=True)
        return np.asarray(posterior + self.hazard * (1 - 2 * posterior))[None]


def ideal_of(bandit: Bandit) -> IdealLearner:
    """Return the ideal learner of a bandit; reversals at fixed times enter by their mean hazard."""
    hazard = bandit.hazard if bandit.reverse_every is None else 1 / bandit.reverse_every
    return IdealLearner(better=bandit.better, worse=bandit.worse, hazard=hazard)


Chooser = Callable[[Array, int], tuple[Integers, Array]]
"""Takes the values (runs, 2) and the number of the trial; returns choices and times, ms."""


@dataclass(frozen=True, eq=False)
class Played:
    """Trials of several runs of one learner, (trials, runs) each."""

    draws: BanditDraws
    choice: Integers  # chosen arm, 0 or 1
    reward: Array  # 0 or 1
    difference: Array  # value of the better arm minus the other, before the choice
    time_ms: Array  # NaN if choices take no time

    @property
    def correct(self) -> Truths:
        """Whether the better arm was chosen, (trials, runs)."""
        return np.asarray(self.choice == self.draws.best)

    @property
    def regret(self) -> Array:
        """Expected rewards forgone in each run, (runs,)."""
        lost = self.draws.bandit.better - self.draws.bandit.worse
        return np.asarray(lost * (~self.correct).sum(axis=0))


def play(
    learner: ValueLearner | str,
    bandit: Bandit,
    *,
    trials: int = 1000,
    runs: int = 400,
    seed: int,
    chooser: Chooser | None = None,
) -> Played:
    """Let several runs of a learner play a bandit, with draws that depend on the seed alone."""
    learner, draws = learner_of(learner), bandit.draw(trials, runs, seed)
    state, every = learner.start((runs,)), np.arange(runs)
    choice = np.empty(draws.best.shape, np.int8)
    reward, difference = np.empty(choice.shape), np.empty(choice.shape)
    time_ms = np.full(choice.shape, np.nan)
    for k in range(trials):
        values = learner.values(state)
        best = draws.best[k]
        difference[k] = values[every, best] - values[every, 1 - best]
        if chooser is None:
            choice[k] = draws.chance[k] < learner.probability(state)
        else:
            choice[k], time_ms[k] = chooser(values, k)
        reward[k] = draws.reward(k, choice[k])
        state = learner.learn(state, np.eye(2)[choice[k]], reward[k])
    return Played(draws, choice, reward, difference, time_ms)


def relative_regret(played: Played, reference: Played) -> tuple[float, float]:
    """Return mean regret over that of a reference, and the error of the ratio (delta method)."""
    ours, other = played.regret, reference.regret
    same = "must have as many runs as the other"
    require(len(ours) == len(other), "reference", same, len(other))
    require(other.sum() > 0, "reference", "must have some regret", 0.0)
    ratio = ours.mean() / other.mean()
    error = (ours - ratio * other).std(ddof=1) / np.sqrt(len(ours)) / other.mean()
    return float(ratio), float(error)


@dataclass(frozen=True)
class ValueCircuit:
    """A circuit of two channels that receives noisy readings of two values.

    Readings ``x_i = d' V_i / difference`` plus unit noise are the evidence ``d' x_i``, exact if
    values differ by ``difference``.
    """

    model: BasalGanglia  # any engine that has times
    posterior: float = 0.85
    difference: float = 0.6  # of values, at which readings are scaled correctly: 0.8 - 0.2
    d_prime: float = 0.5  # of one reading at that difference
    step_ms: float = 40.0  # between readings
    t_max: int = 120  # readings, after which the response is forced
    seed: int = 0

    def __post_init__(self) -> None:
        must = "must have times: population, rate or a spiking engine"
        require(self.model.engine.timed, "model", must, self.model.engine.id)
        two = "must be a circuit of two channels"
        require(self.model.circuit.channels == 2, "model", two, self.model.circuit.channels)
        check_positive(difference=self.difference, d_prime=self.d_prime, step_ms=self.step_ms)
        whole("t_max", self.t_max, 1)
        self.model.warn_of_noise(self.model.threshold(None, self.posterior))

    def evidence(self, values: npt.ArrayLike, number: int = 0) -> Evidence:
        """Return evidence of trials with values (trials, 2); each block has its own noise."""
        pairs = np.asarray(reals("values", values), dtype=np.float64)
        require(
            pairs.ndim == 2 and pairs.shape[1] == 2, "values", "must be (trials, 2)", pairs.shape
        )
        rng = stream(self.seed, "values", number)
        noise = rng.standard_normal((len(pairs), self.t_max, 2))
        mean = self.d_prime * (pairs - pairs.mean(axis=1, keepdims=True)) / self.difference
        nats = self.d_prime * (mean[:, None, :] + noise)
        return Evidence(
            nats,
            (pairs[:, 1] >= pairs[:, 0]).astype(np.intp),
            step_ms=self.step_ms,
            numbers=number * len(pairs) + np.arange(len(pairs)),
            baseline=0.0,
        )

    def decide(self, values: npt.ArrayLike, number: int = 0) -> Decision:
        """Return the decisions of the circuit, not compared with the proportion correct."""
        evidence = self.evidence(values, number)
        level = self.model.threshold(None, self.posterior)
        return self.model.unadapted.decided(evidence, level, first_trial=number * evidence.trials)

    def __call__(self, values: Array, number: int) -> tuple[Integers, Array]:
        """Choose in one trial of every run of ``play``; return choices and times, ms."""
        decision = self.decide(values, number)
        return decision.choice, np.asarray(decision.time_ms, dtype=np.float64)
