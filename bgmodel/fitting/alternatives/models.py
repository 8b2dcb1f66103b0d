"""The models of choices between any number of alternatives, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from bgmodel.fitting.alternatives.circuit import ManyCircuitModel
from bgmodel.fitting.alternatives.msprt import MsprtModel
from bgmodel.fitting.alternatives.race import LcaModel, RaceModel
from bgmodel.fitting.exact.algorithms import BIAS, DRIFT_SD, GAPS, SPREAD, START
from bgmodel.fitting.simulated.circuit import CircuitModel
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.fitting.exact.algorithms import Model
    from circuits.circuit import Circuit

MODELS: dict[str, Callable[[int, int, int, float], Model]] = {
    "msprt": lambda number, trials, seed, seconds: MsprtModel(number, trials, seed),
    "race": lambda number, trials, seed, seconds: RaceModel(number),
    "lca": LcaModel,
}
"""Models by name, from a number of alternatives, simulated trials, their seed and length, s."""
OF_TWO = {
    START.name: "a bias to one of two responses",
    BIAS.name: "a bias to one of two responses",
    SPREAD.name: "the spread of a bias between two responses",
    DRIFT_SD.name: "a parameter of the test between two alternatives",
}
"""Parameters that models of more than two alternatives do not have."""


def circuit_model(alternatives: int) -> type[CircuitModel]:
    """Return the model of a circuit that chooses between some number of alternatives."""
    return CircuitModel if alternatives == 2 else ManyCircuitModel


def check_many(
    model: str | Path | Circuit, mechanism: str, named: Iterable[str], alternatives: int
) -> None:
    """Raise ValueError for models, mechanisms and named parameters of two alternatives only."""
    if isinstance(model, str) and model in GAPS:
        allowed = ", ".join(MODELS)
        must = f"must be of {allowed} or a circuit with {alternatives} alternatives"
        raise InputError.of("models", must, model)
    if mechanism != "threshold":
        must = f"must be threshold with {alternatives} alternatives"
        raise InputError.of("mechanism", must, mechanism)
    for name in sorted(set(named) & set(OF_TWO)):
        raise InputError(
            f"{name} is {OF_TWO[name]} and has no meaning with {alternatives} alternatives: "
            "leave it out",
            name,
        )
