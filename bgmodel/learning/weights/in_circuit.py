"""Learning weights with a circuit in the loop: its choices, and its own confidence from SNr."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bgmodel.deciding.decision import Decision, crossing_of_each
from bgmodel.deciding.readout import threshold_from_posterior
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import curve, time_at
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds
from bgmodel.learning.weights.critics import Critic, ReadOutConfidence
from bgmodel.learning.weights.deciders import Trials
from bgmodel.learning.weights.features import Features, FeatureSource
from bgmodel.learning.weights.learn import learn_weights
from bgmodel.learning.weights.learned import LearnedWeights
from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_range
from circuits.errors import quiet, require


@dataclass(frozen=True)
class InCircuit:
    """A circuit that decides by its threshold, and whose confidence is read afterwards.

    The drive of D1 and STN is the learned one. Runs of one trial are simulated side by side, each
    with its own noise. OUT of the chosen channel is averaged over a window after the decision: at
    the decision itself it equals the threshold, whatever the evidence.
    """

    model: BasalGanglia  # any engine that has times
    criterion: float = 0.85  # posterior at which it decides
    after_ms: float = 40.0  # from the decision to the reading of OUT
    window_ms: float = 40.0

    def __post_init__(self) -> None:
        must = "must have times: population, rate or a spiking engine"
        require(self.model.engine.timed, "model", must, self.model.engine.id)
        self.model.circuit.check_nats("confidence, a posterior")
        self.model.threshold(None, self.criterion)
        check_range(0, np.inf, after_ms=self.after_ms)
        sample_ms = self.model.engine.sample_ms
        least = f"must be at least the time between samples of OUT, {sample_ms:g} ms"
        require(sample_ms <= self.window_ms < np.inf, "window_ms", least, self.window_ms)

    @property
    def gain(self) -> float:
        """Nats of drive per nat of evidence, that of the model."""
        return self.model.gain

    @property
    def ceiling(self) -> float:
        """Highest posterior that the circuit can express."""
        return float(np.exp(-self.model.circuit.readable_nats[0]))

    def choose(self, part: Features, weights: Array, noise: Array, number: int) -> Trials:
        """Choose in one trial of every run; see ``Decider``."""
        # What the channels' weights have in common is no evidence, and can exceed their range.
        weights = weights - weights.mean(axis=1, keepdims=True)
        nats = part.values @ weights.swapaxes(1, 2)
        evidence = self._evidence(part, nats)
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
        return Trials(last, choice, heard, self._confidence(trace, decision))

    def _evidence(self, part: Features, nats: Array) -> Evidence:
        """Return learned log-likelihoods as evidence, without the warnings for users' tables."""
        with quiet():
            return Evidence(nats, step_ms=part.step_ms, lengths=part.readings, baseline=0.0)

    def _confidence(self, trace: Trace, decision: Decision) -> Array:
        """Return the posterior of the choice read from OUT after the decision, (runs,)."""
        time_ms = trace.time_ms - trace.onset_ms
        end = time_ms[trace.of_trials()[0] - 1]
        start = np.minimum(decision.time_ms + self.after_ms, end - self.window_ms)
        inside = (time_ms >= start[:, None]) & (time_ms <= (start + self.window_ms)[:, None])
        out = trace.out_nats[np.arange(len(start)), :, decision.choice]
        mean = (out * inside).sum(axis=1) / inside.sum(axis=1)
        return np.asarray(np.exp(-np.maximum(mean, 0.0)))


def circuit_time_at_accuracy(model: BasalGanglia, evidence: Evidence, accuracy: float) -> float:
    """Return the mean decision time of a circuit at a proportion correct, ms.

    The threshold is set accordingly; NaN if no threshold that the circuit can use reaches it.
    """
    truth = needed_truth(evidence)
    low = model.circuit.readable_nats[0]
    levels = deciding_thresholds(model.circuit, np.geomspace(low, np.log(evidence.hypotheses), 60))
    swept = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    right = (swept.choice == truth).astype(np.float64)
    curves = curve(replace(swept, posterior=right), np.ones((1, evidence.trials)))
    return float(time_at([accuracy], curves)[0, 0])


def learn_weights_in_circuit(
    source: FeatureSource, decider: InCircuit, *, critic: Critic | str | None = None, **options: Any
) -> LearnedWeights:
    """Learn weights with a circuit in the loop, in several independent runs side by side.

    The default critic is the posterior read from SNr, up to the highest that the circuit can
    express; ``options`` are those of ``learn_weights``.
    """
    critic = ReadOutConfidence(decider.ceiling) if critic is None else critic
    return learn_weights(source, critic=critic, decider=decider, **options)
