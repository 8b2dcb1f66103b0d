"""Deciders, which turn features and weights into choices, and step sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.deciding.decision import Decision, crossing_of_each
from bgmodel.deciding.readout import threshold_from_posterior
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, minus_log_softmax
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.features import Features
from bgmodel.support.checks import check_flag, check_positive, check_range, is_number, whole
from circuits.arrays import Array, Integers
from circuits.errors import quiet, require

TIE = 1e-9
"""Size of the noise that breaks ties of drives, nats."""
AFTER_MS, WINDOW_MS = 40.0, 40.0
"""Time from a circuit's decision to the reading of its confidence from OUT, and how long it is
read."""


@dataclass(frozen=True)
class TrialOfRuns:
    """Trials of every run in one trial."""

    last: Integers  # (runs,), index of the last reading before the choice
    choice: Integers  # (runs,)
    drive: Array  # (runs, hypotheses), nats, by the readings up to the last one
    read_out: Array  # (runs,), posterior of the choice as read from OUT


@dataclass(frozen=True)
class FixedPoint:
    """The circuit's fixed point: ``OUT = -ln softmax(gain sum_t w . phi_t)``, without dynamics."""

    criterion: float = 0.9
    """Posterior at which a trial stops; otherwise it ends with its last reading."""
    gain: float = 1.0
    """Nats of drive per nat of evidence."""
    sampled: int | None = None
    """Number of readings, if this is fixed and there is no criterion."""
    drawn: bool = False
    """Whether the choice is drawn from the posterior, as REINFORCE assumes; otherwise it is the
    leader."""

    def __post_init__(self) -> None:
        check_range(0, 1, criterion=self.criterion)
        check_positive(gain=self.gain)
        check_flag("drawn", self.drawn)
        if self.sampled is not None:
            whole("sampled", self.sampled, 1)

    def choose(self, part: Features, weights: Array, noise: Array, number: int) -> TrialOfRuns:
        """Choose in trial ``number`` of every run; ``part`` holds one trial per run.

        At the first reading at which a posterior reaches the criterion. ``weights`` is (runs,
        hypotheses, units), and ``noise`` standard normal, (runs, hypotheses).
        """
        runs = np.arange(len(weights))
        drive = self.gain * np.cumsum(part.values @ weights.swapaxes(1, 2), axis=1)
        out = minus_log_softmax(drive)
        last = part.readings - 1
        if self.sampled is None:
            reached = out.min(axis=2) <= -np.log(self.criterion)
            last = np.where(reached.any(axis=1), reached.argmax(axis=1), last)
        else:
            last = np.minimum(last, self.sampled - 1)
        heard, read = drive[runs, last], out[runs, last]
        choice = (heard + self._disturbance(noise)).argmax(axis=1)
        return TrialOfRuns(last, choice, heard, np.exp(-read[runs, choice]))

    def _disturbance(self, noise: Array) -> Array:
        """Return noise on the drives (runs, hypotheses) whose leader is the choice, nats."""
        if not self.drawn:
            return TIE * noise
        from scipy.special import log_ndtr

        # The leader of drives with Gumbel noise is a draw from their softmax.
        return np.asarray(-np.log(-log_ndtr(noise)))


@dataclass(frozen=True)
class InCircuit:
    """A circuit that decides by its threshold, and whose confidence is read afterwards.

    The drive of D1 and STN is the learned one. Runs of one trial are simulated side by side, each
    with its own noise. OUT of the chosen channel is averaged over a window after the decision: at
    the decision itself it equals the threshold, whatever the evidence.
    """

    model: BasalGanglia  # any engine that has times
    criterion: float = 0.85  # posterior at which it decides

    def __post_init__(self) -> None:
        must = "must have times: population, rate or a spiking engine"
        require(self.model.engine.timed, "model", must, self.model.engine.id)
        self.model.circuit.check_nats("confidence, a posterior")
        self.model.threshold(None, self.criterion)
        must = f"must sample OUT every {WINDOW_MS:g} ms or more often"
        sample_ms = self.model.engine.sample_ms
        require(sample_ms <= WINDOW_MS, "model", must, sample_ms)

    @property
    def gain(self) -> float:
        """Nats of drive per nat of evidence, that of the model."""
        return self.model.gain

    @property
    def ceiling(self) -> float:
        """Highest posterior that the circuit can express."""
        return float(np.exp(-self.model.circuit.readable_nats[0]))

    def choose(self, part: Features, weights: Array, noise: Array, number: int) -> TrialOfRuns:
        """Choose in one trial of every run; see ``FixedPoint``."""
        # What the channels' weights have in common is no evidence, and can exceed their range.
        weights = weights - weights.mean(axis=1, keepdims=True)
        nats = part.values @ weights.swapaxes(1, 2)
        with quiet():  # learned log-likelihoods are no user's table
            evidence = Evidence(nats, step_ms=part.step_ms, lengths=part.readings, baseline=0.0)
        first = number * len(weights)
        drive = self.model.drive(evidence)
        trace = self.model.trace(self.model.run_drive(drive, evidence.step_ms, first), evidence)
        levels = threshold_from_posterior(np.full(len(weights), self.criterion), len(part.names))
        decision = crossing_of_each(trace, levels, checked=False)
        last = np.floor(decision.time_ms / part.step_ms + 1e-9).astype(np.intp) - 1
        last = np.clip(last, -1, part.readings - 1)
        total = self.gain * np.cumsum(nats, axis=1)
        heard = np.where(last[:, None] < 0, 0.0, total[np.arange(len(last)), last])
        choice = np.asarray(decision.choice, dtype=np.intp)
        return TrialOfRuns(last, choice, heard, self._confidence(trace, decision))

    def _confidence(self, trace: Trace, decision: Decision) -> Array:
        """Return the posterior of the choice read from OUT after the decision, (runs,)."""
        time_ms = trace.time_ms - trace.onset_ms
        end = time_ms[trace.of_trials()[0] - 1]
        start = np.minimum(decision.time_ms + AFTER_MS, end - WINDOW_MS)
        inside = (time_ms >= start[:, None]) & (time_ms <= (start + WINDOW_MS)[:, None])
        out = trace.out_nats[np.arange(len(start)), :, decision.choice]
        mean = (out * inside).sum(axis=1) / inside.sum(axis=1)
        return np.asarray(np.exp(-np.maximum(mean, 0.0)))


Decider = FixedPoint | InCircuit
"""What turns features and weights into choices, for several runs at once."""


@dataclass(frozen=True)
class WeightLearner:
    """How weights change: number of trials, step size, and what is kept."""

    trials: int = 10_000
    """Number of trials."""
    rate: float = 0.5
    """Initial step size, divided by the running variance of the trace (summed over units), so
    that it suits any number and activity of units; tuned on seed 1."""
    half_trials: float = 3_000.0
    """Trials after which the step size has halved; infinity keeps it constant, as required in a
    changing environment; tuned on seed 1."""
    averaged: float = 0.25
    """Share of the last trials over whose weights the result is averaged (Polyak & Juditsky 1992);
    0 takes the last weights."""
    keep: int = 100
    """Number of times at which weights are kept, evenly spaced."""

    def __post_init__(self) -> None:
        whole("trials", self.trials, 1)
        check_positive(rate=self.rate)
        require(is_number(self.half_trials), "half_trials", "must be a number", self.half_trials)
        require(self.half_trials > 0, "half_trials", "must be > 0", self.half_trials)
        check_range(0, 1, averaged=self.averaged)
        whole("keep", self.keep, 1)

    @property
    def last(self) -> int:
        """Number of last trials over whose weights the result is averaged."""
        return max(1, round(self.averaged * self.trials))

    def step(self, number: int) -> float:
        """Return the step size of a trial."""
        return self.rate / (1 + number / self.half_trials)
