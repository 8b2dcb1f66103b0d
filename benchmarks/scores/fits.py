"""Fits to monkeys, people and patients.

The models are the sequential test with a constant gap and with one that falls, and the default
circuit as populations: with a threshold alone, with dopamine that rises within a trial, and with
cells of STN that are driven at onset and decay. Left-out trials say which predicts best.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd

from benchmarks import OUT
from benchmarks.methods.means import fit_means
from benchmarks.methods.predicted import Better, Predicted, better_by, predicted
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel.fitting.algorithms import GapModel, Model
from bgmodel.fitting.circuit import (
    CRITERIA,
    NONE,
    SIMULATION_SEED,
    CircuitModel,
    Criterion,
)
from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.fit import cells_of, fit_likelihood
from bgmodel.fitting.optimum import Likelihood, likelihood_of, optimum
from bgmodel.tables.choices import read_choices
from circuits.anatomy import DEFAULT, load_circuit

TRIALS, COARSE_TRIALS = 128_000, 400
"""Trials that a fitted circuit is simulated with, at each drift."""
FEWER = 0.0234375
"""Share of them where it is simulated at many values of its criterion."""
FEWEST = 0.015625
"""Share of them for patients, each of whom has a tenth as many trials as a monkey."""
SLOW_NATS = 1.5
"""Noise in nats where decisions take more than a second: a wider range of thresholds."""
PREDICTED = [
    "log_likelihood", "log_likelihood_simulation_error",
    "better_nats", "error_nats", "simulation_error_nats",
]  # fmt: skip
MOVES: dict[str, tuple[Criterion, dict[str, str]]] = {
    "nothing": (NONE, {}),
    "threshold": (NONE, {"threshold_nats": "stimulation"}),
    **{
        name: (CRITERIA[name], {name: "stimulation/off"})
        for name in ("dopamine", "stn_loss", "gpe_loss")
    },
}
"""What stimulation of STN may move: edits of the circuit, and what differs with stimulation."""


def fitted_circuit(
    criterion: Criterion, trials: int, seconds: float, noise_nats: float = 2.0
) -> CircuitModel:
    """Return the default circuit as a model; what it decides is kept with the pieces."""
    return CircuitModel(
        load_circuit(DEFAULT, 2), criterion=criterion, seconds=seconds, trials=trials,
        noise_nats=noise_nats, folder=OUT / "stored",
    )  # fmt: skip


def models(trials: int, seconds: float) -> dict[str, Model]:
    """Return the models by the names that tables have for them."""
    fewer = round(FEWER * trials)
    return {
        "constant gap": GapModel(),
        "falling gap": GapModel(falls=True),
        "circuit": fitted_circuit(NONE, trials, seconds),
        "circuit, rising dopamine": fitted_circuit(CRITERIA["rising_dopamine"], fewer, seconds),
        "circuit, STN driven at onset": fitted_circuit(CRITERIA["onset_stn"], fewer, seconds),
    }


def person(data: str, who: str, trials: int) -> pd.DataFrame:
    """Return the fits to one person: parameters, cells, and predictions of left-out trials."""
    choices = read_choices(data, strength="coherence", participant=who)
    design = design_of(choices)
    found = [_means(design).assign(model="closed form", kind="cells")]
    left_out = {}
    for name, model in models(trials, 3.0).items():
        likelihood = likelihood_of(model, design, free=[each.name for each in model.parameters])
        made = fit_likelihood(likelihood)
        left_out[name] = predicted(likelihood, start=made.optimum.vector)
        found.append(made.parameters().assign(model=name, kind="parameters"))
        found.append(made.cells().assign(model=name, kind="cells"))
        better = better_by(left_out[name], left_out["constant gap"])
        row = {"model": name, "kind": "predicted", **_better(better)}
        row["log_likelihood"] = made.optimum.log_likelihood
        row["log_likelihood_simulation_error"] = made.simulation.log_likelihood
        found.append(pd.DataFrame([row]))
    return pd.concat(found, ignore_index=True).assign(data=data, participant=who)


def _better(better: Better) -> dict[str, float]:
    """Return a difference of left-out predictions as columns."""
    return {
        "better_nats": better.nats, "error_nats": better.error,
        "simulation_error_nats": better.simulation_error,
    }  # fmt: skip


def _means(design: Design) -> pd.DataFrame:
    """Return the cells of Palmer's fit to accuracy and mean times, its numbers in each row."""
    found = fit_means(design)
    seen = design.observed
    rt = [seen.rt_s[seen.cell == cell] for cell in range(design.cells)]
    columns = {
        "strength": design.strength, "trials": design.trials,
        "mean_s": [each.mean() for each in rt], "sd_s": [each.std() for each in rt],
        "model_mean_s": found.mean_s, "model_sd_s": found.sd_s, "model_accuracy": found.accuracy,
        "bound": found.bound, "sensitivity": found.sensitivity, "t0_s": found.t0_s,
    }  # fmt: skip
    return pd.DataFrame(columns)


def patients(trials: int) -> pd.DataFrame:
    """Return what stimulation moves: predictions of left-out trials, and the four means."""
    data = "cavanagh_2011"
    whole = read_choices(data, conditions=["conflict", "stimulation"])
    rows = []
    for who in whole.people():
        design = design_of(whole.where(whole.participant == who), ["conflict", "stimulation"])
        left_out: dict[str, Predicted] = {}
        for name, (criterion, vary) in MOVES.items():
            model = fitted_circuit(criterion, trials, 5.0, SLOW_NATS)
            likelihood = stimulated(model, design, vary)
            made = optimum(likelihood)
            left_out[name] = predicted(likelihood, start=made.vector)
            cells = cells_of(design, made.density)
            better = _better(better_by(left_out[name], left_out["nothing"]))
            rows.append(
                cells.assign(
                    participant=who, moved=name, **better,
                    log_likelihood=made.log_likelihood,
                    **{k.partition("[")[0] + ("_on" if "=on" in k else ""): v
                       for k, v in made.values.items() if not k.startswith("sensitivity")},
                )
            )  # fmt: skip
    return pd.concat(rows, ignore_index=True)


def stimulated(model: CircuitModel, design: Design, vary: Mapping[str, str]) -> Likelihood:
    """Return the likelihood in which stimulation moves one parameter, and conflict sensitivity."""
    free = [name for name in ("threshold_nats", "t0_s", "t0_sd_s", "lapse") if name not in vary]
    return likelihood_of(model, design, free=free, vary={"sensitivity": "conflict", **vary})


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through what the score is made of."""
    trials = COARSE_TRIALS if fast else TRIALS
    for data in ("roitman_shadlen_2002", "palmer_huk_shadlen_2005"):
        choices = read_choices(data, strength="coherence")
        for who in choices.people():
            count = int((choices.participant == who).sum())
            yield Piece("people", who, count, 600, partial(person, data, who, trials))
    yield Piece("patients", "stimulation", 3988, 1800, partial(patients, round(FEWEST * trials)))


def tables(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the tables that pages and figures read."""
    people = made["people"]
    found: dict[str, tuple[str, pd.DataFrame]] = {}
    who = ["data", "participant", "model"]
    for kind, columns in (
        ("parameters", ["parameter", "value", "standard_error", "simulation_error", "at_bound"]),
        ("predicted", PREDICTED),
    ):
        found[kind] = ("people", people.loc[people["kind"] == kind, [*who, *columns]])
    cells = people[people["kind"] == "cells"]
    empty = [name for name in cells if cells[name].isna().all()]
    found["cells"] = ("people", cells.drop(columns=[*empty, "kind"]))
    found["stimulation"] = ("patients", made["patients"])
    found["stimulation_moves"] = ("patients", _moves(made["patients"]))
    return found


def _moves(cells: pd.DataFrame) -> pd.DataFrame:
    """Return each move's predictions over people, and its effects beside the data's."""
    rows = []
    for name, some in cells.groupby("moved", sort=False):
        each = some.drop_duplicates("participant")
        row = {"moved": name, "better_nats": each["better_nats"].sum()}
        # People are independent; the simulated trials are the same for all of them.
        row["simulation_error_nats"] = each["simulation_error_nats"].sum()
        sampling = each["error_nats"] ** 2 - each["simulation_error_nats"] ** 2
        row["error_nats"] = np.hypot(np.sqrt(sampling.sum()), row["simulation_error_nats"])
        row["better_people"] = int((each["better_nats"] > 0).sum())
        for who, prefix in (("data", ""), ("model", "model_")):
            wide = some.pivot(
                index="participant", columns=["conflict", "stimulation"], values=f"{prefix}mean_s"
            )
            for conflict in ("high", "low"):
                for stimulation in ("off", "on"):
                    one = wide[conflict, stimulation]
                    row[f"{who}_{conflict}_{stimulation}_s"] = one.mean()
                    row[f"{who}_{conflict}_{stimulation}_sem"] = one.sem()
            effect = {c: wide[c, "on"] - wide[c, "off"] for c in ("high", "low")}
            apart = effect["high"] - effect["low"]
            row |= {f"{who}_interaction_s": apart.mean(), f"{who}_interaction_sem": apart.sem()}
        rows.append(row)
    return pd.DataFrame(rows)


SCORE = Score("fits", SIMULATION_SEED, (2,), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
