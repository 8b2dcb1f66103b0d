"""Models and fits on known evidence by name, for Python and the command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bgmodel.fitting.fit import Fit, fit_likelihood
from bgmodel.fitting.known.circuit import FEWEST, KnownCircuit
from bgmodel.fitting.known.likelihood import OnTrials
from bgmodel.fitting.known.models import EXACT, KnownModel
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.support.checks import whole
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.fitting.settings import FitSettings
    from circuits.circuit import Circuit

MODELS = ("msprt", "leaky_sum", "run", "macaque")
"""Models that the command compares by default."""


def known_model(
    model: str | Path | Circuit, alternatives: int, asked: FitSettings, runs: int | None = None
) -> KnownModel:
    """Return a model of decisions on known evidence.

    Parameters
    ----------
    model : str, path or Circuit
        msprt, leaky_sum, run, or a circuit: by name, as a .toml file or a Circuit.
    alternatives : int
        Number of alternatives of the evidence.
    asked : FitSettings
        With the engine of a circuit and the seed of its noise.
    runs : int, optional
        Simulated runs of each trial by a circuit, at least 8.

    Raises
    ------
    ValueError
        For an unknown model, or a circuit with another number of channels.
    """
    from bgmodel.integrators.given import checked_circuit
    from circuits.anatomy import CIRCUITS
    from circuits.declaration.table_files import is_path

    if isinstance(model, str) and model in EXACT:
        return EXACT[model]
    if isinstance(model, str) and model not in CIRCUITS and not is_path(model):
        allowed = ", ".join((*EXACT, *CIRCUITS))
        raise InputError.of("models", f"must be of {allowed}, or .toml files", model)
    circuit = checked_circuit(model, alternatives)
    runs = None if runs is None else whole("runs", runs, FEWEST)
    return KnownCircuit(circuit, asked.engine, runs, asked.seed)


def fit_evidence(
    trials: KnownTrials,
    model: str | Path | Circuit,
    asked: FitSettings,
    *,
    runs: int | None = None,
    draws: bool = False,
) -> Fit:
    """Fit a model to choices and response times on known evidence; see ``bgmodel.fit``."""
    made = OnTrials(known_model(model, trials.alternatives, asked, runs), trials)
    asked.check_parameters({"model": made})
    return fit_likelihood(asked.likelihood(trials.design, made), draws=draws)
