"""The experiments on conflict, run with the circuit fitted to Cavanagh's patients.

The circuit is fitted to each of 14 patients, with a sensitivity per level of conflict, and with
stimulation as a partial loss of STN's output. The median parameters define one subject, whose
decisions are simulated on new evidence, used neither for the fits nor in their stored trials, and
paired, so that the effect of stimulation is known to a few ms. The size of the loss was fitted to
the patients' times; the difference between conflict levels and the effect on accuracy were not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import t as student

from benchmarks.scores.fits import COARSE_TRIALS, FEWER, TRIALS, fitted_circuit
from benchmarks.scores.pieces import Made, Piece, Score, main
from benchmarks.scores.stimulation import LONGEST_S, MOVES, SLOW_NATS, STIMULATED, stimulated
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.record import Changes
from bgmodel.fitting.exact.responses import BIN_S
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.trials.design import design_of
from bgmodel.task import Gaussian
from bgmodel.trials.reading import read_trials
from circuits.anatomy import DEFAULT
from circuits.declaration.edits import Edits

SCORING_SEED = 71_001
"""Seed of the evidence and the noise of the decisions."""
DECISIONS, COARSE_DECISIONS = 10_000, 500
SECONDS = 0.006
"""Approximate CPU time per decision in all conditions."""
FITS_SECONDS = 150
MEASURED = ("accuracy", "mean_ms")
INTERACTION = "high less low"
EXPERIMENTS = {"high": "stn_conflict", "low": "stn_no_conflict"}
"""The built-in experiment for each level of conflict."""


def patients(trials: int) -> pd.DataFrame:
    """Return the fitted parameters of each patient, a column for each."""
    whole = read_trials("cavanagh_2011", conditions=STIMULATED)
    mechanism, vary = MOVES["stn_loss"]
    model = fitted_circuit(mechanism, trials, LONGEST_S, SLOW_NATS)
    rows = {}
    for who in whole.people():
        design = design_of(whole.where(whole.participant == who), ["conflict", "stimulation"])
        rows[who] = optimum(stimulated(model, design, vary)).values
    return pd.DataFrame.from_dict(rows, orient="index")


def asked(numbers: pd.Series, conflict: str, trials: int) -> Experiment:
    """Return an experiment with a subject's parameters: evidence and threshold.

    With sensitivity v, in 1/sqrt(s), and noise of n nats after a second, the two channels of a
    Gaussian problem with R readings per second have a separation of d' = 2 v / sqrt(R), and a nat
    of its evidence is n / 2 v of the circuit's.
    """
    v = numbers[f"sensitivity[conflict={conflict}]"]
    task = Gaussian(
        trials=trials, t_max=round(LONGEST_S / BIN_S), step_ms=1000 * BIN_S,
        d_prime=2 * v * BIN_S**0.5,
    )  # fmt: skip
    return replace(
        Experiment.from_toml(EXPERIMENTS[conflict]), seed=SCORING_SEED, task=task,
        posterior=float(np.exp(-numbers["threshold_nats"])), gain=SLOW_NATS / (2 * v),
        manipulation=Changes(Edits([f"lesion STN {numbers['stn_loss[stimulation=on]']:.4f}"])),
    )  # fmt: skip


def of_the_data() -> pd.DataFrame:
    """Return the mean changes by stimulation over patients, with 95 % intervals of t."""
    choices = read_trials("cavanagh_2011", conditions=STIMULATED)
    table = pd.DataFrame(
        {"who": choices.participant, **choices.conditions, "accuracy": choices.response,
         "mean_ms": 1000 * choices.rt_s}
    )  # fmt: skip
    each = table.groupby(["who", "conflict", "stimulation"])[["accuracy", "mean_ms"]].mean()
    by = each.unstack("stimulation")
    changes = by.xs("on", axis=1, level=1) - by.xs("off", axis=1, level=1)
    apart = changes.xs("high", level="conflict") - changes.xs("low", level="conflict")
    rows = []
    for conflict, found in (*changes.groupby("conflict"), (INTERACTION, apart)):
        half = student.ppf(0.975, len(found) - 1) * found.sem()
        for name in found:
            value = found[name].mean()
            rows.append((conflict, name, value, value - half[name], value + half[name]))
    columns = ["conflict", "measure", "data", "data_low", "data_high"]
    return pd.DataFrame(rows, columns=columns)


def decided(trials: int, decisions: int, workers: int) -> pd.DataFrame:
    """Return the effects of the loss in the median subject and in the patients."""
    numbers = patients(trials).median()
    rows = []
    for conflict in EXPERIMENTS:
        outcome = asked(numbers, conflict, decisions).run(workers=workers)
        found = outcome.measures.set_index(["condition", "measure"])
        for name in MEASURED:
            row = {"conflict": conflict, "measure": name}
            row |= {"off": found.loc[("control", name), "value"]}
            row |= {"on": found.loc[("manipulation", name), "value"]}
            rows.append(row | _interval(found.loc[("change", name)]))
    table = pd.DataFrame(rows)
    table = pd.concat([table, _interactions(table)], ignore_index=True)
    return table.merge(of_the_data(), on=["conflict", "measure"]).assign(**numbers)


def _interval(row: pd.Series) -> dict[str, float]:
    return {"change": row["value"], "low": row["low"], "high": row["high"]}


def _interactions(table: pd.DataFrame) -> pd.DataFrame:
    """Return the change with conflict less that without: trials of both are independent."""
    rows = []
    for name, some in table.groupby("measure", sort=False):
        by = some.set_index("conflict")
        value = by["change"]["high"] - by["change"]["low"]
        half = np.hypot(*(by["high"] - by["low"]) / 2)
        rows.append((INTERACTION, name, value, value - half, value + half))
    return pd.DataFrame(rows, columns=["conflict", "measure", "change", "low", "high"])


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the one piece."""
    decisions = COARSE_DECISIONS if fast else DECISIONS
    make = partial(decided, round(FEWER * (COARSE_TRIALS if fast else TRIALS)), decisions, workers)
    yield Piece("decided", "patients", decisions, FITS_SECONDS + SECONDS * decisions, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the table that pages read."""
    return {"fitted": ("decided", made["decided"])}


SCORE = Score("conflict", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
