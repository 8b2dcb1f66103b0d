"""Trials of both models on the same evidence with the same noise, each kind simulated once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from bgmodel.comparison.thresholds import moved
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.discriminating.information import (
    COMPETITOR,
    CORRECT,
    MISSED,
    OTHER,
    Recorded,
    Recording,
)
from bgmodel.discriminating.space import Probe, Space
from bgmodel.evidence import Evidence
from bgmodel.experiments.models import DecisionModel, stopped
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    decide_at_thresholds,
    thresholds_about,
    without_noise_alone,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds
from bgmodel.integrators.sprt import Msprt
from bgmodel.stopping.inputs import StopSignal
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.errors import InputError
from circuits.store import once

TUNING_TRIALS, TUNING_READINGS = 1000, 120
"""Trials by which thresholds are matched, and readings in each."""
RIVALS = np.round(np.arange(-0.12, 0.125, 0.01), 2)
"""Differences in accuracy over which a free threshold is sought."""
LOWEST, HIGHEST = 0.5, 0.99
"""Range of accuracies about whose thresholds in the MSPRT those of a circuit are tried."""


@dataclass(frozen=True)
class SimulatedDecisions:
    """Decisions of one model in one kind of trials at many thresholds, up to the latest deadline.

    With conflict, the channel after the true one is the competitor. ``jitter_ms`` (trials,) are
    non-decision times less their mean, the same in both models.
    """

    tradeoff: Tradeoff
    truth: Integers
    channels: int
    conflict: bool
    jitter_ms: Array
    spikes: Integers | None = None

    def at(self, level: float, deadline_ms: float) -> Recorded:
        """Return choices and times at a threshold, with a deadline."""
        k = int(np.argmin(np.abs(self.tradeoff.settings - level)))
        decided = self.tradeoff.choices(k)
        choice = np.where(decided.choice == self.truth, CORRECT, OTHER)
        if self.conflict:
            choice[decided.choice == (self.truth + 1) % self.channels] = COMPETITOR
        choice[self.tradeoff.forced[k] | ~(decided.time_ms <= deadline_ms)] = MISSED
        return Recorded(choice, decided.time_ms + self.jitter_ms, self.spikes)


@dataclass(frozen=True)
class PairedTrials:
    """Simulated trials of two models, which share evidence and noise, in a space of tasks.

    ``trials`` is their number for each kind of trials. Thresholds are matched on other trials of
    the same seed; if ``free``, thresholds around the matched ones are simulated too.
    """

    models: tuple[DecisionModel, DecisionModel]
    space: Space
    seed: int
    trials: int
    free: bool = False
    workers: int = 1
    recording: Recording | None = None
    cache: dict[Any, Any] = field(default_factory=dict, repr=False, init=False)

    def levels(self, k: int, probe: Probe) -> dict[float, float]:
        """Return a model's thresholds by the accuracy that it has in plain trials.

        Accuracies are those of the space and, if thresholds are free, others around them;
        accuracies that it does not reach are missing.
        """
        return self._matched(k, probe.plain)[0]

    @once
    def _matched(self, k: int, plain: Probe) -> tuple[dict[float, float], float | None]:
        """Return a model's thresholds by accuracy, and the gain of a circuit."""
        rng = stream(self.seed, "discriminate", "tuning", plain.channels, plain.d_prime)
        task = self.space.task(plain, TUNING_TRIALS, TUNING_READINGS)
        evidence = task.drawn_with(rng, rng)
        model = self.models[k]
        swept = _swept(model, evidence, seed=self._noise("tuning"), workers=self.workers)
        levels = {
            accuracy: float(swept.at_accuracy(accuracy).settings[0])
            for accuracy in self._accuracies()
            if swept.reaches(accuracy)
        }
        if model.test is not None:
            return levels, None
        return levels, model.integrator(evidence.hypotheses).adapted_to(evidence).gain

    def _accuracies(self) -> list[float]:
        accuracies = np.asarray(self.space.accuracy)
        if self.free:
            accuracies = np.union1d(accuracies, np.round(accuracies[:, None] + RIVALS, 4))
        return [float(a) for a in accuracies if 0 < a < 1]

    @once
    def simulated(self, k: int, probe: Probe) -> SimulatedDecisions:
        """Return the decisions of a model in one kind of trials."""
        model = self.models[k]
        levels = np.array(list(self.levels(k, probe).values()))
        if not levels.size:
            accuracies = ", ".join(f"{a:g}" for a in self.space.accuracy)
            raise InputError(
                f"{model.name} does not reach an accuracy of {accuracies} by evidence", "accuracy"
            )
        kind = "plain" if probe == probe.plain else "probe"
        names = ("discriminate", kind, probe.channels, probe.d_prime)
        # Evidence with and without conflict differs in one mean alone.
        rng = stream(self.seed, *names)
        evidence = self.space.task(probe, self.trials).drawn_with(rng, rng)
        run: dict[str, Any] = {
            "edits": probe.lines, "stop": (probe.stop_nats, self.space.stop_delay_ms),
            "gain": self._matched(k, probe.plain)[1],
            "seed": self._noise(kind), "workers": self.workers,
        }  # fmt: skip
        if model.test is not None:
            decided = tradeoff(model.test.run(evidence), evidence, levels)
        else:
            decided = _decided(*_with_stop(model, evidence, **run), levels)
        spikes = None
        if self.recording is not None:
            readings = int(np.ceil(self.recording.window_ms[1] / evidence.step_ms))
            early = replace(evidence, log_likelihood=evidence.log_likelihood[:, :readings])
            rng = stream(self.seed, *names, "spikes")
            spikes = _spikes(*_with_stop(model, early, **run, rates=True), self.recording, rng)
        sd = self.space.non_decision_sd_ms
        jitter = sd * stream(self.seed, *names, "non-decision").standard_normal(self.trials)
        assert evidence.truth is not None
        return SimulatedDecisions(
            decided, evidence.truth, probe.channels, probe.conflict > 0, jitter, spikes
        )

    def _noise(self, kind: str) -> int:
        """Return the seed of the noise of cells in one kind of trials."""
        return int(stream(self.seed, "discriminate", "noise", kind).integers(2**31))


def _with_stop(
    model: DecisionModel,
    evidence: Evidence,
    edits: Iterable[str],
    stop: tuple[float, float],
    rates: bool = False,
    **run: Any,
) -> tuple[BasalGanglia, Evidence]:
    """Return the circuit and its evidence, with a stop signal (nats, delay in ms) if any."""
    circuit = model.integrator(evidence.hypotheses, edits, rates=rates, **run)
    if not stop[0]:
        return circuit, evidence
    return stopped(circuit, evidence, StopSignal(amount_nats=stop[0]), stop[1])


def _decided(model: BasalGanglia, evidence: Evidence, levels: Array) -> Tradeoff:
    return decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]


def _spikes(
    model: BasalGanglia, evidence: Evidence, recording: Recording, rng: np.random.Generator
) -> Integers:
    """Return the number of spikes of recorded cells in each trial, (trials,)."""
    means = []
    for part, activity, _ in model.batches(evidence):
        rate_hz = np.asarray(activity.rates_hz[recording.nucleus])
        assert part.truth is not None
        means.append(recording.mean_hz(rate_hz, activity.time_ms, part.truth))
    return recording.counts(np.concatenate(means), model.circuit, rng)


def _swept(model: DecisionModel, evidence: Evidence, *, seed: int, workers: int) -> Tradeoff:
    """Return the decisions at all thresholds at which evidence decides."""
    if model.test is not None:
        return tradeoff(model.test.run(evidence), evidence)
    circuit = model.integrator(evidence.hypotheses, seed=seed, workers=workers, rates=False)
    circuit = circuit.adapted_to(evidence)
    test = tradeoff(Msprt(circuit.gain).run(evidence), evidence)
    about = thresholds_about(test, HIGHEST, LOWEST)
    before = cast("Circuit", circuit.circuit.unedited or circuit.circuit)
    # An edit that shifts OUT shifts the counterparts of the test's thresholds.
    about = np.union1d(about, about + moved(before, circuit.circuit, about))
    levels = without_noise_alone(circuit, deciding_thresholds(circuit.circuit, about))
    if not levels.size:
        raise InputError(f"{model.name} decides without evidence at every threshold", "circuit")
    return _decided(circuit, evidence, levels)
