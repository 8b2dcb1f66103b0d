"""Parameter recovery of fits, and the coverage of their intervals.

Data sets are simulated with the test, from its density, or trial by trial with the default circuit
and the population engine, with evidence and noise that are independent of the fit's stored trials.
Parameters come from a flat prior over the range of the fits to people and monkeys; trials that are
undecided at the deadline have no response.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import kstest, norm

from benchmarks.methods.decided import (
    DEADLINE_S,
    GRID,
    TRIALS,
    decided_by_circuit,
    decided_by_test,
    responses,
)
from benchmarks.scores.fits import COARSE_TRIALS, fitted_circuit
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel import stream
from bgmodel.fitting.exact.algorithms import GapModel, Model
from bgmodel.fitting.exact.responses import BIN_S, Observed, responded
from bgmodel.fitting.fit import fit_likelihood, widened
from bgmodel.fitting.identify import directions
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.posterior import posterior
from bgmodel.fitting.simulated.circuit import NONE
from bgmodel.fitting.simulated.control import decided
from bgmodel.fitting.simulated.crossings import simulated
from bgmodel.fitting.simulated.error import simulation_error
from bgmodel.fitting.trials.design import Design
from bgmodel.support.arrays import Array
from circuits.anatomy import DEFAULT

SCORING_SEED = 70_001
"""Of the data sets, and of the circuit that decides them."""
SETS, COARSE_SETS = {"test": 200, "circuit": 100}, 8
"""Data sets by each model: those by the circuit take eight times as long to fit."""
SET_TRIALS = 1500
STRENGTHS = (0.032, 0.128, 0.512)
PRIOR = {
    "sensitivity": (8.0, 25.0), "bound": (0.45, 0.9), "threshold_nats": (0.17, 0.37),
    "t0_s": (0.25, 0.5), "t0_sd_s": (0.03, 0.1), "lapse": (0.002, 0.03),
}  # fmt: skip
"""Range from which parameters are drawn: that of the fits to people and monkeys."""
BATCH_SETS = 10
STORES, STORE_SETS, COARSE_STORES = 10, 20, 3
"""Independent stores of simulated trials, and sets that each makes and another one fits."""
WALKERS, STEPS, RANKED = 24, 300, 99
"""Of the posteriors of recovery, and draws of each among which the truth has its rank."""
DIRECT_SETS, DIRECT_TRIALS = 20, 10_000
"""Sets whose likelihood is simulated again at their own parameters, and trials at each drift."""


def drawn(names: list[str], number: int) -> Array:
    """Return the parameters of a data set, from the prior."""
    low, high = np.array([PRIOR[name] for name in names]).T
    rng = stream(SCORING_SEED, "prior", *names, number)
    return np.asarray(rng.uniform(low, high))


def data_set(by: str, names: list[str], number: int) -> tuple[Design, Array]:
    """Return a data set with the parameters that it was made from."""
    truth = drawn(names, number)
    values = dict(zip(names, truth.tolist(), strict=True))
    each = SET_TRIALS // len(STRENGTHS)
    if by == "test":
        found = decided_by_test(values, STRENGTHS, each, stream(SCORING_SEED, "test", number))
    else:
        seed = int(stream(SCORING_SEED, "circuit", number).integers(2**31))
        rng = stream(SCORING_SEED, "within a bin", number)
        found = decided_by_circuit(values, STRENGTHS, each, seed, rng)
    rng = stream(SCORING_SEED, "responses", by, number)
    return responses(values, STRENGTHS, found, rng), truth


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
    model = GapModel() if by == "test" else fitted_circuit(NONE, trials, DEADLINE_S)
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
                    "optimum": best.vector[k], "mean": draws.mean[k],
                    "low": low[k], "high": high[k],
                    "rank": int((some[:, k] < truth[k]).sum()), "effective": draws.effective,
                }
            )  # fmt: skip
    return pd.DataFrame(rows).assign(by=by)


def fitted_elsewhere(store: int, stores: int, sets: int, trials: int) -> pd.DataFrame:
    """Return fits to sets that are drawn from the densities of another store of simulated trials.

    A row per set and parameter: truth, value, standard_error and simulation_error. The two stores
    differ by chance alone, so intervals hold the truth as often as they say if their errors hold
    the error of the simulation.
    """
    ours, theirs = (
        replace(fitted_circuit(NONE, trials, DEADLINE_S), seed=SCORING_SEED + 100 + number)
        for number in (store, (store + 1) % stores)
    )
    names = [each.name for each in ours.parameters]
    rows = []
    for number in range(store * sets, (store + 1) * sets):
        truth = drawn(names, number)
        design = drawn_from(theirs, dict(zip(names, truth.tolist(), strict=True)), number)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            table = fit_likelihood(likelihood_of(ours, design, free=names)).parameters()
        rows.append(table.assign(set=number, truth=truth).drop(columns=["low", "high"]))
    return pd.concat(rows, ignore_index=True).assign(store=store)


def drawn_from(model: Model, values: Mapping[str, float], number: int) -> Design:
    """Return a data set drawn from the densities of a model."""
    each = SET_TRIALS // len(STRENGTHS)
    every = {name: np.full(len(STRENGTHS), value) for name, value in values.items()}
    response = {name: every[name] for name in ("t0_s", "t0_sd_s", "lapse")}
    density = responded(model.decided(every, np.array(STRENGTHS), GRID), GRID, **response)
    rng = stream(SCORING_SEED, "elsewhere", number)
    mass = np.maximum(density, 0).reshape(len(STRENGTHS), -1) * BIN_S
    never = np.maximum(1 - mass.sum(axis=1), 0.0)
    shares = np.column_stack([mass, never]) / (mass.sum(axis=1) + never)[:, None]
    picked = np.concatenate([rng.choice(len(row), each, p=row) for row in shares])
    choice, bins = np.divmod(picked, GRID.bins)
    rt = np.where(choice == 2, np.nan, (bins + rng.random(len(bins))) * BIN_S)
    cell = np.repeat(np.arange(len(STRENGTHS)), each)
    seen = Observed(cell, np.where(choice == 2, -1, choice), rt, GRID, DEADLINE_S)
    return Design(np.array(STRENGTHS), {}, seen)


def direct(sets: int, trials: int) -> pd.DataFrame:
    """Return log likelihoods of some sets from stored trials, and from trials simulated for them.

    At the truth, and at the parameters of the next set: their difference is the evidence of the
    data for one over the other. The trials are simulated at exactly these drifts and thresholds.
    """
    model = fitted_circuit(NONE, trials, DEADLINE_S)
    names = [each.name for each in model.parameters if each.free]
    rows = []
    for number in range(sets):
        design, truth = data_set("circuit", names, number)
        likelihood = likelihood_of(model, design, free=names)
        other = truth + 0.3 * (drawn(names, number + 1) - truth)
        for at, vector in (("truth", truth), ("other", other)):
            anew = simulated_for(likelihood, vector, number)
            rows.append(
                {
                    "set": number, "at": at, "stored_nats": likelihood(vector),
                    "direct_nats": float(design.observed.each(anew).sum()),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def simulated_for(likelihood: Likelihood, vector: Array, number: int) -> Array:
    """Return the density of responses from trials at the drifts and the threshold asked for."""
    values = likelihood.freedom.values(vector)
    drifts = values["sensitivity"] * likelihood.design.strength
    threshold = values["threshold_nats"][:1]
    seed = int(stream(SCORING_SEED, "direct", number).integers(2**31))
    model = replace(fitted_circuit(NONE, DIRECT_TRIALS, DEADLINE_S), seed=seed)
    found = []
    for cell, drift in enumerate(drifts):
        each = simulated(
            model.run((), float(threshold[0])), threshold, seconds=DEADLINE_S,
            trials=DIRECT_TRIALS, seed=seed + cell, drifts=[drift],
        )  # fmt: skip
        found.append(decided([(each, 1.0)], float(threshold[0]), [drift], GRID)[0])
    response = {name: values[name] for name in ("t0_s", "t0_sd_s", "lapse")}
    return responded(np.array(found), GRID, **response)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through batches of data sets, by the test and by the circuit."""
    trials = COARSE_TRIALS if fast else TRIALS
    for by, most in SETS.items():
        sets = COARSE_SETS if fast else most
        for first in range(0, sets, BATCH_SETS):
            some = min(BATCH_SETS, sets - first)
            make = partial(recovered, by, first, some, trials)
            seconds = some * (4 if by == "test" else 30)
            yield Piece("recovery", f"{by} {first}", SET_TRIALS, seconds, make)
    stores = COARSE_STORES if fast else STORES
    for store in range(stores):
        make = partial(fitted_elsewhere, store, stores, STORE_SETS, trials)
        yield Piece("elsewhere", f"store {store}", SET_TRIALS, 120, make)
    few = COARSE_SETS if fast else DIRECT_SETS
    yield Piece("direct", "again", SET_TRIALS, 20 * few, partial(direct, few, trials))


def tables(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the tables that pages and figures read."""
    found, again = made["recovery"], made["direct"]
    apart = (again["stored_nats"] - again["direct_nats"]).abs()
    return {
        "sets": ("recovery", found),
        "calibration": ("recovery", _calibration(found)),
        "direct": ("direct", again.assign(apart_nats=apart)),
        "elsewhere": ("elsewhere", _covered(made["elsewhere"])),
    }


def _covered(found: pd.DataFrame) -> pd.DataFrame:
    """Return how often intervals of 0.9 hold the truth, by parameter and pooled.

    With the error of the simulation and without it; ``error`` is that of the share, from sets.
    """
    half = norm.ppf(0.95)
    apart = (found["value"] - found["truth"]).abs()
    alone = np.sqrt(found["standard_error"] ** 2 - found["simulation_error"].fillna(0) ** 2)
    found = found.assign(
        inside=apart <= half * found["standard_error"], inside_without=apart <= half * alone
    )
    rows = []
    for name, some in [*found.groupby("parameter", sort=False), ("pooled", found)]:
        by_set = some.groupby("set")["inside"].mean()
        rows.append(
            {
                "parameter": name, "sets": len(by_set), "coverage": by_set.mean(),
                "error": by_set.sem(), "coverage_without": some["inside_without"].mean(),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


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

if __name__ == "__main__":
    main(SCORE)
