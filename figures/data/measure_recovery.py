"""Parameter recovery of fits, and the coverage of their intervals.

Data sets are simulated trial by trial with the default circuit and the population engine, with
evidence and noise that are independent of the fit's stored trials, which every ten sets have anew.
Parameters come from a flat prior over the range of the fits to people and monkeys; trials that are
undecided at the deadline have no response.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import kstest

from bgmodel import stream
from bgmodel.fitting.design import Design
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.person_fit import widened
from bgmodel.fitting.posterior import directions, posterior
from bgmodel.fitting.simulated.circuit_model import NONE
from bgmodel.fitting.simulated.error import simulation_error
from circuits.anatomy import DEFAULT
from circuits.arrays import Array
from figures.data.decided import DEADLINE_S, TRIALS, decided_by_circuit, responses
from figures.data.measure_fits import COARSE_TRIALS, fitted_circuit
from figures.pieces import Made, Piece, Score

SCORING_SEED = 70_001
"""Of the data sets, of the circuit that decides them, and of the stored trials of its fits."""
SETS, COARSE_SETS = 200, 8
"""Numbers of data sets."""
SET_TRIALS = 1500
CIRCUIT = "circuit"
"""What decides: also a name of random numbers."""
STRENGTHS = (0.032, 0.128, 0.512)
PRIOR = {
    "sensitivity": (8.0, 25.0), "threshold_nats": (0.17, 0.37), "t0_s": (0.25, 0.5),
    "t0_sd_s": (0.03, 0.1), "lapse": (0.002, 0.03),
}  # fmt: skip
"""Range from which parameters are drawn: that of the fits to people and monkeys."""
BATCH_SETS = 10
"""Data sets that are fitted with the same stored trials: others have other simulation errors."""
WALKERS, STEPS, RANKED = 24, 300, 99
"""Of the posteriors of recovery, and draws of each among which the truth has its rank."""


def drawn(names: list[str], number: int) -> Array:
    """Return the parameters of a data set, from the prior."""
    low, high = np.array([PRIOR[name] for name in names]).T
    rng = stream(SCORING_SEED, "prior", *names, number)
    return np.asarray(rng.uniform(low, high))


def data_set(by: str, names: list[str], number: int) -> tuple[Design, Array]:
    """Return a data set with the parameters that it was made from; ``by`` names its noise."""
    truth = drawn(names, number)
    values = dict(zip(names, truth.tolist(), strict=True))
    each = SET_TRIALS // len(STRENGTHS)
    seed = int(stream(SCORING_SEED, by, number).integers(2**31))
    rng = stream(SCORING_SEED, "within a bin", number)
    decisions = decided_by_circuit(values, STRENGTHS, each, seed, rng)
    rng = stream(SCORING_SEED, "responses", by, number)
    return responses(values, STRENGTHS, decisions, rng), truth


def within_prior(likelihood: Likelihood) -> Likelihood:
    """Return the likelihood with the prior's range as bounds."""
    moved = tuple(
        replace(each, parameter=replace(
            each.parameter, low=PRIOR[each.name][0], high=PRIOR[each.name][1],
            start=sum(PRIOR[each.name]) / 2))
        for each in likelihood.freedom.moved
    )  # fmt: skip
    return replace(likelihood, freedom=replace(likelihood.freedom, moved=moved))


def recovered(by: str, first: int, sets: int, trials: int) -> pd.DataFrame:
    """Return the truth, the optimum and the posterior of each parameter of some data sets."""
    seed = int(stream(SCORING_SEED, "stored trials", first).integers(2**31))
    model = replace(fitted_circuit(NONE, trials, DEADLINE_S), seed=seed)
    rows = []
    for number in range(first, first + sets):
        names = [each.name for each in model.parameters if each.free]
        design, truth = data_set(by, names, number)
        likelihood = within_prior(likelihood_of(model, design, free=names))
        best = optimum(likelihood)
        there = directions(likelihood, best.vector)
        draws = posterior(
            likelihood, there, walkers=WALKERS, steps=STEPS, most_steps=STEPS, seed=number
        )
        low, high = widened(draws, simulation_error(likelihood, there).parameters)
        some = draws.draws[np.linspace(0, len(draws.draws) - 1, RANKED).astype(int)]
        for k, name in enumerate(names):
            rows.append(
                {
                    "set": number, "parameter": name, "truth": truth[k],
                    "optimum": best.vector[k], "mean": draws.draws.mean(axis=0)[k],
                    "low": low[k], "high": high[k],
                    "rank": int((some[:, k] < truth[k]).sum()), "effective": draws.effective,
                }
            )  # fmt: skip
    return pd.DataFrame(rows).assign(by=by)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through batches of data sets."""
    trials = COARSE_TRIALS if fast else TRIALS
    sets = COARSE_SETS if fast else SETS
    for first in range(0, sets, BATCH_SETS):
        some = min(BATCH_SETS, sets - first)
        make = partial(recovered, CIRCUIT, first, some, trials)
        yield Piece("recovery", f"{CIRCUIT} {first}", SET_TRIALS, 12 * some, make)


def tables(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the one table."""
    return {"calibration": ("recovery", _calibration(made["recovery"]))}


def _calibration(recovery: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (by, name), some in recovery.groupby(["by", "parameter"], sort=False):
        inside = (some["low"] <= some["truth"]) & (some["truth"] <= some["high"])
        spread = some["truth"].mean()
        uniform = kstest((some["rank"] + 0.5) / (RANKED + 1), "uniform")
        rows.append(
            {
                "by": by, "parameter": name, "sets": len(some),
                "bias": (some["mean"] - some["truth"]).mean() / spread,
                "bias_optimum": (some["optimum"] - some["truth"]).mean() / spread,
                "error": (some["mean"] - some["truth"]).std() / np.sqrt(len(some)) / spread,
                "coverage": inside.mean(), "uniform_p": uniform.pvalue,
                "correlation": np.corrcoef(some["truth"], some["mean"])[0, 1],
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


SCORE = Score("recovery", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)
