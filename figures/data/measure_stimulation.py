"""Effect of STN stimulation in patients: the default circuit fitted to choices and times.

The patients of Cavanagh et al. (2011) chose under high and low conflict, with the stimulator on
and off. In each fit one parameter of the circuit may change with stimulation. Held-out trials show
which parameter predicts best, and the fitted means whether times change as in the patients.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd

from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.model_comparison import Predicted, better_by, predicted
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.person_fit import cells_of
from bgmodel.fitting.simulated.circuit_model import (
    MECHANISMS,
    NONE,
    SIMULATION_SEED,
    CircuitModel,
    Mechanism,
)
from bgmodel.trials.reader import read_trials
from bgmodel.trials.record import Trials
from circuits.anatomy import DEFAULT
from figures.data.measure_fits import difference, fitted_circuit
from figures.pieces import Made, Piece, Score

SLOW_NATS = 1.5
"""Noise in nats where decisions take more than a second: a wider range of thresholds."""
PATIENT_TRIALS, COARSE_PATIENT_TRIALS = 2000, 6
"""Trials that a fitted circuit is simulated with, at each drift: a patient has few."""
LONGEST_S = 5.0
"""Length of a simulated trial, s: longer than any response of a patient."""
STIMULATED = ["conflict", "stimulation"]
"""What differs between trials of the patients."""
MOVES: dict[str, tuple[Mechanism, dict[str, str]]] = {
    "nothing": (NONE, {}),
    "threshold": (NONE, {"threshold_nats": "stimulation"}),
    **{
        name: (MECHANISMS[name], {name: "stimulation/off"})
        for name in ("dopamine", "stn_loss", "gpe_loss")
    },
}
"""What stimulation of STN may move: edits of the circuit, and what differs with stimulation."""


def patient(recorded: Trials, who: str, trials: int) -> pd.DataFrame:
    """Return the effects of stimulation: predictions of left-out trials, and the four means."""
    design = design_of(recorded.where(recorded.participant == who), STIMULATED)
    left_out: dict[str, Predicted] = {}
    rows = []
    for name, (mechanism, vary) in MOVES.items():
        model = fitted_circuit(mechanism, trials, LONGEST_S, SLOW_NATS)
        likelihood = stimulated(model, design, vary)
        made = optimum(likelihood)
        left_out[name] = predicted(likelihood, start=made.vector)
        cells = cells_of(design, made.density)
        better = difference(better_by(left_out[name], left_out["nothing"]))
        rows.append(cells.assign(participant=who, moved=name, **better))
    return pd.concat(rows, ignore_index=True)


def stimulated(model: CircuitModel, design: Design, vary: Mapping[str, str]) -> Likelihood:
    """Return the likelihood in which stimulation moves one parameter, and conflict sensitivity."""
    free = [name for name in ("threshold_nats", "t0_s", "t0_sd_s", "lapse") if name not in vary]
    return likelihood_of(model, design, free=free, vary={"sensitivity": "conflict", **vary})


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through the patients."""
    recorded = read_trials("cavanagh_2011", conditions=STIMULATED)
    for who in recorded.people():
        count = int((recorded.participant == who).sum())
        make = partial(patient, recorded, who, COARSE_PATIENT_TRIALS if fast else PATIENT_TRIALS)
        yield Piece("patients", who, count, 400, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the predictions of each change over people, and its effect on times."""
    return {"moves": ("patients", _moves(made["patients"]))}


def _moves(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the predictions of each change over people, and its effect with that in the data."""
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
            effect = {c: wide[c, "on"] - wide[c, "off"] for c in ("high", "low")}
            apart = effect["high"] - effect["low"]
            row |= {f"{who}_interaction_s": apart.mean(), f"{who}_interaction_sem": apart.sem()}
        rows.append(row)
    return pd.DataFrame(rows)


SCORE = Score("stimulation", SIMULATION_SEED, (2,), pieces, tables, circuit=DEFAULT)
