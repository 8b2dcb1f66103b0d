"""The two models that are to be told apart: circuits, edited circuits, and tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np

from bgmodel.comparison.thresholds import moved
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.discriminating.recording import Recording
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES
from bgmodel.integrators.criterion import deciding_thresholds, gain_of
from bgmodel.integrators.deciding import (
    CIRCUIT,
    decide_at_thresholds,
    thresholds_about,
    without_noise_alone,
)
from bgmodel.integrators.given import checked_circuit
from bgmodel.integrators.sprt import Integrator, Msprt
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.stopping.circuit import receiving
from bgmodel.stopping.inputs import StopSignal, with_stop
from bgmodel.support.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_files import digest
from circuits.engines import engine_of
from circuits.errors import InputError, require

TESTS: dict[str, Callable[[], Integrator]] = {"msprt": Msprt, **BASELINES}
"""Tests by name: the optimal one and the baseline models."""
ROUNDING = 1e-9
"""Difference of outputs that is rounding error, nats."""
LOWEST, HIGHEST = 0.5, 0.99
"""Range of accuracies about whose thresholds in the MSPRT those of a circuit are tried."""


@dataclass(frozen=True)
class Model:
    """A model of decisions, for any number of alternatives."""

    name: str
    build: Callable[[int], Circuit] | None = None
    test: Integrator | None = None
    source: str = ""
    edits: Edits = field(default_factory=Edits)
    engine: str = "population"

    def identity(self, channels: int) -> object:
        """Return what equals that of another model if both decide alike: a hash, or the test."""
        if self.build is None:
            return self.test
        circuit = self.build(channels)
        return digest(circuit), gain_of(circuit), self.engine

    def check(self, channels: int, edits: Iterable[str] = ()) -> None:
        """Raise ValueError if the circuit cannot be built, edited, or has no nats."""
        if self.build is not None:
            circuit = self.build(channels).edited(*edits)
            circuit.check_nats("a comparison at matched thresholds", ": give a circuit in nats")
            gain_of(circuit)

    def decided(
        self,
        evidence: Evidence,
        levels: Array,
        *,
        edits: Iterable[str] = (),
        stop: tuple[float, float] = (0.0, 0.0),
        gain: float | None = None,
        seed: int = 0,
        workers: int = 1,
    ) -> Tradeoff:
        """Return the decisions at many thresholds."""
        if self.test is not None:
            return tradeoff(self.test.run(evidence), evidence, levels)
        model = self._model(evidence.hypotheses, edits, gain, seed, workers)
        model, evidence = _stopped(model, evidence, stop)
        return decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]

    def spikes(
        self,
        evidence: Evidence,
        recording: Recording,
        rng: np.random.Generator,
        *,
        edits: Iterable[str] = (),
        stop: tuple[float, float] = (0.0, 0.0),
        gain: float | None = None,
        seed: int = 0,
        workers: int = 1,
    ) -> Integers:
        """Return the number of spikes of recorded cells in each trial, (trials,).

        The parameters are those of ``decided``, and random numbers of the spikes.
        """
        readings = int(np.ceil(recording.window_ms[1] / evidence.step_ms))
        seen = replace(evidence, log_likelihood=evidence.log_likelihood[:, :readings])
        model = self._model(evidence.hypotheses, edits, gain, seed, workers, rates=True)
        model, seen = _stopped(model, seen, stop)
        means = []
        for part, activity, _ in model.batches(seen):
            rate_hz = np.asarray(activity.rates_hz[recording.nucleus])
            assert part.truth is not None
            means.append(recording.mean_hz(rate_hz, activity.time_ms, part.truth))
        return recording.counts(np.concatenate(means), model.circuit, rng)

    def swept(self, evidence: Evidence, *, seed: int, workers: int = 1) -> Tradeoff:
        """Return the decisions at all thresholds at which evidence decides."""
        if self.test is not None:
            return tradeoff(self.test.run(evidence), evidence)
        model = self._model(evidence.hypotheses, (), None, seed, workers).adapted_to(evidence)
        test = tradeoff(Msprt(model.gain).run(evidence), evidence)
        about = thresholds_about(test, HIGHEST, LOWEST)
        before = cast("Circuit", model.circuit.unedited or model.circuit)
        # An edit that shifts OUT shifts the counterparts of the test's thresholds.
        about = np.union1d(about, about + moved(before, model.circuit, about))
        levels = without_noise_alone(model, deciding_thresholds(model.circuit, about))
        if not levels.size:
            raise InputError(f"{self.name} decides without evidence at every threshold", "circuit")
        return decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]

    def gain_on(self, evidence: Evidence) -> float | None:
        """Return the gain of a circuit on some evidence; None for a test."""
        if self.build is None:
            return None
        return self._model(evidence.hypotheses, (), None, 0, 1).adapted_to(evidence).gain

    def _model(
        self,
        channels: int,
        edits: Iterable[str],
        gain: float | None,
        seed: int,
        workers: int,
        rates: bool = False,
    ) -> BasalGanglia:
        assert self.build is not None
        circuit = self.build(channels).edited(*edits)
        engine = engine_of(self.engine).tuned(workers=workers, rates=rates)
        noise = seed if engine.noisy else None
        return BasalGanglia(circuit, engine, gain, noise)  # type: ignore[arg-type]


def _stopped(
    model: BasalGanglia, evidence: Evidence, stop: tuple[float, float]
) -> tuple[BasalGanglia, Evidence]:
    """Return a model and its evidence, with a stop signal if there is one."""
    if not stop[0]:
        return model, evidence
    signal = StopSignal(amount_nats=stop[0])
    late = np.full(evidence.trials, stop[1])
    return receiving(model, signal), with_stop(evidence, late, signal)


def model_of(
    given: Circuit | Integrator | str | Path,
    edits: Iterable[str] = (),
    *,
    engine: str = "population",
    argument: str = "second",
) -> Model:
    """Return a circuit, given as such, by name or as a file, or a test, as a model."""
    of_lines = isinstance(edits, (list, tuple)) and all(isinstance(x, str) for x in edits)
    require(of_lines, "edits", "must be a list of lines", edits)
    lines = Edits(edits)
    test, name = None, str(given)
    if isinstance(given, str) and given in TESTS:
        test = TESTS[given]()
    elif not isinstance(given, (str, Path, Circuit)):
        must = 'must be a circuit, its name or file, or a test, such as "msprt"'
        require(hasattr(given, "run"), argument, must, given)
        test, name = given, repr(given)
    if test is not None:
        require(not lines, "edits", "are for a circuit, and a test is given", [*lines])
        return Model(name, test=test)
    source = "" if isinstance(given, Circuit) else name
    title = given.name if isinstance(given, Circuit) else Path(name).stem

    def built(channels: int) -> Circuit:
        circuit = checked_circuit(given, channels)  # type: ignore[arg-type]
        if circuit.channels != channels:
            said = f"{circuit.name} is of {circuit.channels} alternatives, the task of {channels}"
            raise InputError(f"{said}: give its name or file", "circuit")
        return circuit.edited(*lines)

    title = f"{title}, {'; '.join(lines)}" if lines else title
    return Model(title, built, None, source, lines, engine)


def same_rule(first: Model, second: Model, *, channels: int) -> bool:
    """Whether two tests are one rule at different thresholds, for a number of alternatives.

    They are if the output of one increases with that of the other over all alternatives, readings
    and trials: each threshold of one then has a threshold of the other that decides alike, so that
    no choices and times tell them apart. It is checked on every output of 200 trials.
    """
    if first.test is None or second.test is None:
        return False
    evidence = gaussian_evidence(200, channels=channels, t_max=40, seed=0)
    one, other = (np.ravel(each.test.run(evidence).out_nats) for each in (first, second))  # type: ignore[union-attr]
    order = np.argsort(one)
    return bool((np.diff(other[order]) >= -ROUNDING).all())
