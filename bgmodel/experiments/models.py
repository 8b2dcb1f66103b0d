"""Models that an exam scores and a discrimination compares: circuits with edits, and tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.sprt import Integrator, Msprt
from bgmodel.stopping.inputs import StopSignal, receiving, with_stop
from circuits.anatomy import checked_circuit
from circuits.circuit import Circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import digest
from circuits.engines import Engine, engine_of
from circuits.errors import InputError, require

TESTS: dict[str, Callable[[], Integrator]] = {"msprt": Msprt, **BASELINES}
"""Tests by name: the optimal one and the baseline models."""


@dataclass(frozen=True)
class DecisionModel:
    """A model of decisions for any number of alternatives: a circuit, or a test.

    Parameters
    ----------
    name : str
        Its name in tables.
    build : function, optional
        Takes the number of alternatives and returns the edited circuit; None for a test.
    engine : str, optional
        Engine; by default populations, or rates without noise for sparse connections.
    gain : float, optional
        Nats in the circuit per nat of evidence; by default that of the circuit.
    source : str
        Name or file of the circuit before its edits; empty for an object.
    edits : Edits
        Its edits.
    test : Integrator, optional
        The test, if it is not a circuit.
    """

    name: str
    build: Callable[[int], Circuit] | None = None
    engine: str | None = None
    gain: float | None = None
    source: str = ""
    edits: Edits = field(default_factory=Edits)
    test: Integrator | None = None

    def circuit(self, channels: int) -> Circuit:
        """Return the circuit for a number of alternatives; ValueError for a test."""
        if self.build is None:
            raise InputError(f"{self.name} is a test, which has no circuit", "circuit")
        return self.build(channels)

    def circuits(self, channels: Iterable[int]) -> tuple[dict[int, Circuit], dict[int, ValueError]]:
        """Return circuits by number of alternatives, and why others can't be built.

        Raises the first error if none can be built.
        """
        built: dict[int, Circuit] = {}
        errors: dict[int, ValueError] = {}
        for number in channels:
            try:
                built[number] = self.circuit(number)
            except ValueError as error:
                errors[number] = error
        if not built:
            raise next(iter(errors.values()))
        return built, errors

    def key(self, channels: int) -> object:
        """Return a key that is equal for models with identical decisions: a hash, or the test."""
        if self.build is None:
            return self.test
        circuit = self.build(channels)
        return digest(circuit), gain_of(circuit), self.engine

    def tuned(self, circuit: Circuit, **options: Any) -> Engine:
        """Return the engine of a circuit, with options as for ``Engine.tuned``."""
        sparse = any(row.probability < 1 for row in circuit.projections)
        return engine_of(self.engine or ("rate" if sparse else "population")).tuned(**options)

    def integrator(
        self,
        channels: int,
        edits: Iterable[str] = (),
        *,
        gain: float | None = None,
        seed: int = 0,
        **options: Any,
    ) -> BasalGanglia:
        """Return the circuit with further edits as an integrator; options as for ``tuned``."""
        circuit = self.circuit(channels).edited(*edits)
        engine = self.tuned(circuit, **options)
        gain = self.gain if gain is None else gain
        return BasalGanglia(circuit, engine, gain, seed if engine.noisy else None)  # type: ignore[arg-type]


def model_of(
    model: Circuit | Integrator | str | Path,
    edits: Iterable[str] = (),
    engine: str | None = None,
    gain: float | None = None,
    *,
    argument: str = "circuit",
) -> DecisionModel:
    """Return a circuit (an object, a name or a file) or a test as a model."""
    of_lines = isinstance(edits, (list, tuple)) and all(isinstance(x, str) for x in edits)
    require(of_lines, "edits", "must be a list of lines", edits)
    lines = Edits(edits)
    test, name = None, str(model)
    if isinstance(model, str) and model in TESTS:
        test = TESTS[model]()
    elif not isinstance(model, (str, Path, Circuit)):
        must = 'must be a circuit, its name or file, or a test, such as "msprt"'
        require(hasattr(model, "run"), argument, must, model)
        test, name = model, repr(model)
    if test is not None:
        require(not lines, "edits", "are for a circuit, and a test is given", [*lines])
        return DecisionModel(name, test=test)

    def build(channels: int) -> Circuit:
        circuit = checked_circuit(model, channels)  # type: ignore[arg-type]
        if circuit.channels != channels:
            raise InputError(
                f"the circuit has {circuit.channels} alternatives, {channels} are needed: give its "
                "name or file, from which others are built",
                "circuit",
            )
        return circuit.edited(*lines)

    known = isinstance(model, Circuit)
    title = model.name if isinstance(model, Circuit) else Path(name).stem
    title = f"{title}, {'; '.join(lines)}" if lines else title
    return DecisionModel(title, build, engine, gain, "" if known else name, lines)


def stopped(
    model: BasalGanglia, evidence: Evidence, signal: StopSignal, onset_ms: float
) -> tuple[BasalGanglia, Evidence]:
    """Return a model that receives a stop signal, and evidence with the signal in every trial."""
    onsets = np.full(evidence.trials, onset_ms)
    return receiving(model, signal), with_stop(evidence, onsets, signal)
