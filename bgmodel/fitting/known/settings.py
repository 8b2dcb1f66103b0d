"""Settings of fits on known evidence, shared by Python and the command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bgmodel.fitting.known.circuit import FEWEST, KnownCircuit
from bgmodel.fitting.known.fit import KnownFit, fit_known
from bgmodel.fitting.known.likelihood import known_likelihood, parameters_of
from bgmodel.fitting.known.models import EXACT, KnownModel
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.support.checks import whole
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.circuit import Circuit

MODELS = ("msprt", "leaky_sum", "run", "macaque")
"""Models that the command compares by default."""


def known_model(
    model: str | Path | Circuit, alternatives: int, *, engine: str = "population",
    runs: int | None = None, seed: int | None = None,
) -> KnownModel:  # fmt: skip
    """Return a model of decisions on known evidence.

    Parameters
    ----------
    model : str, path or Circuit
        msprt, leaky_sum, run, or a circuit: by name, as a .toml file or a Circuit.
    alternatives : int
        Number of alternatives of the evidence.
    engine : str
        Engine of a circuit.
    runs, seed : int, optional
        Simulated runs of each trial by a circuit, at least 8, and the seed of their noise.

    Raises
    ------
    ValueError
        For an unknown model or engine, or a circuit with another number of channels.
    """
    from bgmodel.integrators.given import checked_circuit
    from circuits.anatomy import CIRCUITS
    from circuits.declaration.table_files import is_path
    from circuits.engines import engine_of

    if isinstance(model, str) and model in EXACT:
        return EXACT[model]
    if isinstance(model, str) and model not in CIRCUITS and not is_path(model):
        allowed = ", ".join((*EXACT, *CIRCUITS))
        raise InputError.of("models", f"must be of {allowed}, or .toml files", model)
    engine_of(engine)
    made = KnownCircuit(checked_circuit(model, alternatives), engine)
    runs = None if runs is None else whole("runs", runs, FEWEST)
    return KnownCircuit(made.circuit, engine, runs, made.seed if seed is None else seed)


def check_known(
    models: Mapping[str, KnownModel], trials: KnownTrials, free: Sequence[str],
    fixed: Mapping[str, float],
) -> None:  # fmt: skip
    """Raise ValueError for a parameter that no model has, before any circuit is simulated."""
    known = {each.name for m in models.values() for each in parameters_of(m, trials)}
    for option, names in (("free", [name.removeprefix("+") for name in free]), ("fix", fixed)):
        for name in names:
            if name not in known:
                there = ", ".join(sorted(known))
                raise InputError.of(option, f"must name a parameter, one of {there}", name)
    added = [name.startswith("+") for name in free]
    if any(added) and not all(added):
        must = "must have a plus before all names (in addition to the default) or before none"
        raise InputError.of("free", must, tuple(free))


def fit_one(
    model: KnownModel, trials: KnownTrials, free: Sequence[str], fixed: Mapping[str, float]
) -> KnownFit:
    """Fit a model; options for parameters that it lacks are ignored."""
    own = {each.name for each in parameters_of(model, trials)}
    chosen = [name for name in free if name.removeprefix("+") in own]
    held = {name: value for name, value in fixed.items() if name in own}
    return fit_known(known_likelihood(model, trials, free=chosen, fixed=held))


def fit_evidence(
    trials: KnownTrials,
    model: str | Path | Circuit,
    *,
    free: Sequence[str],
    fix: Mapping[str, float],
    engine: str,
    runs: int | None,
    seed: int | None,
) -> KnownFit:
    """Fit a model to choices and response times on known evidence; see ``bgmodel.fit``."""
    made = known_model(model, trials.alternatives, engine=engine, runs=runs, seed=seed)
    check_known({"model": made}, trials, free, fix)
    return fit_one(made, trials, free, fix)
