"""Fits to monkeys and people.

The models are the sequential test with a constant gap and with one that falls, and the default
circuit as populations: with a threshold alone, with dopamine that rises within a trial, and with
cells of STN that are driven at onset and decay. Left-out trials say which predicts best.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import pandas as pd

from bgmodel.fitting.algorithms import EXPONENTIAL, GapModel, Model
from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.model_comparison import Better, better_by, predicted
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.fitting.simulated.circuit_model import (
    MECHANISMS,
    NONE,
    SIMULATION_SEED,
    CircuitModel,
    Mechanism,
)
from bgmodel.trials.reader import read_trials
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from figures.pieces import Made, Piece, Score
from figures.rooms import OUT

TRIALS, COARSE_TRIALS = 128_000, 400
"""Trials that a fitted circuit is simulated with, at each drift."""
SECONDS = 3.0
"""Length of a simulated trial."""
FEWER = 0.0234375
"""Share of them where it is simulated at many values of its mechanism."""
PREDICTED = [
    "log_likelihood", "log_likelihood_simulation_error",
    "better_nats", "error_nats", "simulation_error_nats",
]  # fmt: skip
CELLS = [
    "strength", "trials", "mean_s", "sd_s", "model_mean_s", "model_sd_s", "model_accuracy",
    "model", "accuracy", "accuracy_se", "mean_se", "q10_s", "q50_s", "q90_s",
    "model_q10_s", "model_q50_s", "model_q90_s", "data", "participant",
]  # fmt: skip


def fitted_circuit(
    mechanism: Mechanism, trials: int, seconds: float, noise_nats: float = 2.0,
    circuit: Circuit | None = None,
) -> CircuitModel:  # fmt: skip
    """Return a circuit, the default one, as a model; its simulations are stored with the pieces."""
    return CircuitModel(
        circuit or load_circuit(DEFAULT, 2), mechanism=mechanism, seconds=seconds, trials=trials,
        noise_nats=noise_nats, folder=OUT / "stored",
    )  # fmt: skip


def models(trials: int) -> dict[str, Model]:
    """Return the models by the names that tables have for them."""
    fewer = round(FEWER * trials)
    return {
        "constant gap": GapModel(),
        "falling gap": GapModel(EXPONENTIAL),
        "circuit": fitted_circuit(NONE, trials, SECONDS),
        "circuit, rising dopamine": fitted_circuit(MECHANISMS["rising_dopamine"], fewer, SECONDS),
        "circuit, STN driven at onset": fitted_circuit(MECHANISMS["onset_stn"], fewer, SECONDS),
    }


def person(data: str, who: str, trials: int) -> pd.DataFrame:
    """Return the fits to one person: parameters, cells, and predictions of left-out trials."""
    design = design_of(read_trials(data, strength="coherence", participant=who))
    return fitted(design, models(trials)).assign(data=data, participant=who)


def fitted(design: Design, every: Mapping[str, Model]) -> pd.DataFrame:
    """Return the fits of models to one person; left-out trials are compared with the first."""
    parts, left_out = [], {}
    first = next(iter(every))
    for name, model in every.items():
        likelihood = likelihood_of(model, design)
        made = fit_likelihood(likelihood)
        left_out[name] = predicted(likelihood, start=made.optimum.vector)
        parts.append(made.parameters().assign(model=name, kind="parameters"))
        parts.append(made.cells().assign(model=name, kind="cells"))
        row = {
            "model": name,
            "kind": "predicted",
            **difference(better_by(left_out[name], left_out[first])),
        }
        row["log_likelihood"] = made.optimum.log_likelihood
        row["log_likelihood_simulation_error"] = made.simulation.log_likelihood
        parts.append(pd.DataFrame([row]))
    return pd.concat(parts, ignore_index=True)


def difference(better: Better) -> dict[str, float]:
    """Return a difference of left-out predictions as columns."""
    return {
        "better_nats": better.nats, "error_nats": better.error,
        "simulation_error_nats": better.simulation_error,
    }  # fmt: skip


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the pieces of the score."""
    trials = COARSE_TRIALS if fast else TRIALS
    for data, who, count in people():
        yield Piece("people", who, count, 600, partial(person, data, who, trials))


def people() -> Iterator[tuple[str, str, int]]:
    """Go through monkeys and people: name of the data, of the participant, number of trials."""
    for data in ("roitman_shadlen_2002", "palmer_huk_shadlen_2005"):
        choices = read_trials(data, strength="coherence")
        for who in choices.people():
            yield data, who, int((choices.participant == who).sum())


def tables(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the tables that pages and figures read."""
    people = made["people"]
    by_name: dict[str, tuple[str, pd.DataFrame]] = {}
    who = ["data", "participant", "model"]
    for kind, columns in (
        ("parameters", ["parameter", "value", "standard_error", "simulation_error", "at_bound"]),
        ("predicted", PREDICTED),
    ):
        by_name[kind] = ("people", people.loc[people["kind"] == kind, [*who, *columns]])
    by_name["cells"] = ("people", people.loc[people["kind"] == "cells", CELLS])
    return by_name


SCORE = Score("fits", SIMULATION_SEED, (2,), pieces, tables, circuit=DEFAULT)
