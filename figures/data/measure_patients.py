"""Effects of conflict and of stimulation of STN on the threshold of patients, in a hierarchy.

The patients of Cavanagh et al. (2011) in a hierarchy: sensitivity differs with conflict, and the
threshold with stimulation, with conflict and stimulation, and with their interaction.
Effects are coefficients of a formula, so that the group has a distribution of differences within
people. Chains are kept, and continued where they were stopped.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd

from bgmodel.fit_trials import question
from bgmodel.fitting.hierarchy.chains import chains_entry
from bgmodel.fitting.hierarchy.group_fit import HIERARCHY_SEED, SHARE, GroupFit, fit_group
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.model_comparison import compare_fits
from bgmodel.fitting.settings import settings_of
from bgmodel.trials.files import shipped_table
from circuits.anatomy import DEFAULT
from circuits.errors import FitWarning
from figures.data.measure_stimulation import SLOW_NATS
from figures.pieces import Piece, Score
from figures.rooms import OUT

DATA = "cavanagh_2011"
MODELS = {"test": "constant_gap", "circuit": DEFAULT}
THRESHOLDS = {"test": "bound", "circuit": "threshold_nats"}
CONFLICT, STIMULATION = "C(conflict, contr.sum)", "C(stimulation, contr.sum)"
"""Coded +1 for high conflict and stimulation off, -1 for low conflict and stimulation on."""
TERMS = {
    "stimulation": f"{STIMULATION}",
    "both": f"{CONFLICT} + {STIMULATION}",
    "interaction": f"{CONFLICT} * {STIMULATION}",
}
"""What the threshold depends on."""
HIGH, OFF = f"{CONFLICT}[S.high]", f"{STIMULATION}[S.off]"
EFFECTS = {
    "conflict, off": {HIGH: 2.0, f"{HIGH}:{OFF}": 2.0},
    "conflict, on": {HIGH: 2.0, f"{HIGH}:{OFF}": -2.0},
    "stimulation": {OFF: -2.0},
    "interaction": {f"{HIGH}:{OFF}": 4.0},
}
"""Differences of thresholds as sums of coefficients: high minus low conflict, stimulation on minus
off, and by how much the former is larger without stimulation."""
ON = "C(stimulation, contr.treatment('off'))[T.on]"
THETA = {
    "off": {"theta": 1.0},
    "on": {"theta": 1.0, f"theta:{ON}": 1.0},
    "on minus off": {f"theta:{ON}": 1.0},
}
"""Change of the bound per standard deviation of theta in trials of high conflict. Published, and
predicted here before the fit: above 0 without stimulation, and lower with it."""
MOST, COARSE_MOST = 4000, 200
"""Largest number of draws of each chain."""
TRIALS, COARSE_TRIALS = 16_000, 400
"""Trials that a fitted circuit is simulated with, at each drift."""
TRIALS_OF_ALL = 3988


def likelihoods(by: str, terms: str, fast: bool) -> dict[str, Likelihood]:
    """Return the likelihood of each patient's trials."""
    asked = settings_of(
        formula=[f"{THRESHOLDS[by]} ~ {TERMS[terms]}"], vary={"sensitivity": "conflict"},
        trials=COARSE_TRIALS if fast else TRIALS, noise_nats=SLOW_NATS, people="hierarchical",
    )  # fmt: skip
    return question(asked, DATA, [MODELS[by]], OUT / "stored").likelihoods(MODELS[by])


def fitted(by: str, terms: str, fast: bool, workers: int) -> GroupFit:
    """Return the fit of a model with some terms."""
    return kept_fit(f"{by} {terms}", likelihoods(by, terms, fast), fast, workers)


def kept_fit(name: str, every: Mapping[str, Likelihood], fast: bool, workers: int) -> GroupFit:
    """Return a fit; its chains are kept in a file, and continued from there."""
    first = next(iter(every.values()))
    key = {"model": repr(first.model.identity()), "names": first.freedom.names, "data": DATA}
    kept = chains_entry(OUT / "stored", name, key)
    with warnings.catch_warnings():
        # Diagnostics are part of the result.
        warnings.simplefilter("ignore", FitWarning)
        return fit_group(
            every, workers=workers, most_draws=COARSE_MOST if fast else MOST, kept=kept,
            tell=lambda text: print(f"  {name}: {text}", flush=True),
        )  # fmt: skip


def effects(by: str, terms: str, fast: bool, workers: int) -> pd.DataFrame:
    """Return differences of thresholds, and the parameters of the group.

    Columns of ("group": the mean of the distribution of patients; "patients": the mean of these;
    "parameter": a number of the fit, of the median patient), effect, median, low, high,
    above_zero, people (patients in whom the effect is above 0 with a probability of 0.95),
    people_below, rhat and effective: the worst of all numbers that the row rests on.
    """
    fit = fitted(by, terms, fast, workers)
    known = fit.parameters
    rows = []
    for name, weights in EFFECTS.items():
        names = {f"{THRESHOLDS[by]}[{each}]": weight for each, weight in weights.items()}
        names = {each: weight for each, weight in names.items() if each in known}
        if not names:
            continue
        places, factors = [known.index(each) for each in names], np.array(list(names.values()))
        of_patients = fit.individual[..., places] @ factors
        above = (of_patients > 0).mean(axis=(0, 1))
        counts = {"people": int((above > 0.95).sum()), "people_below": int((above < 0.05).sum())}
        for of, draws in (
            ("group", fit.group[..., places] @ factors),
            ("patients", of_patients.mean(axis=2)),
        ):
            rows.append({"of": of, "effect": name, **middle(draws), **counts, **agreed(draws)})
    summary = (
        fit.summary()
        .reset_index()
        .rename(columns={"parameter": "effect", "effective_sample_size": "effective"})
    )
    table = pd.concat([pd.DataFrame(rows), summary.assign(of="parameter")], ignore_index=True)
    return table.assign(
        by=by, terms=terms, draws=len(fit.chains[0]), people_in_all=len(fit.people),
        largest_rhat=fit.agreement.rhat.max(), fewest_effective=fit.agreement.effective.min(),
    )  # fmt: skip


def theta(fast: bool, workers: int) -> pd.DataFrame:
    """Return how the bound changes with theta in each trial of high conflict, in a hierarchy.

    Theta is the power over medial frontal cortex, z-scored by the authors. Columns as for
    ``effects``, of the mean of the group and of the mean of its patients.
    """
    table, _ = shipped_table(DATA)
    formula = f"bound ~ theta * {ON.removesuffix('[T.on]')}"
    asked = settings_of(formula=formula, people="hierarchical")
    one = question(asked, table[table["conflict"] == "high"], [MODELS["test"]])
    every = one.likelihoods(MODELS["test"])
    fit = kept_fit("theta", every, fast, workers)
    rows = []
    for name, weights in THETA.items():
        places = [fit.parameters.index(f"bound[{each}]") for each in weights]
        of_patients = fit.individual[..., places].sum(axis=-1)
        for of, draws in (
            ("group", fit.group[..., places].sum(axis=-1)), ("patients", of_patients.mean(axis=2)),
        ):  # fmt: skip
            rows.append({"of": of, "effect": name, **middle(draws), **agreed(draws)})
    return pd.DataFrame(rows).assign(
        trials=one.trials.trials, people_in_all=len(fit.people), draws=len(fit.chains[0]),
        largest_rhat=fit.agreement.rhat.max(), fewest_effective=fit.agreement.effective.min(),
    )  # fmt: skip


def middle(draws: np.ndarray) -> dict[str, float]:
    """Return median, central interval and probability above 0 of draws (chains, draws)."""
    median, low, high = np.quantile(draws, [0.5, (1 - SHARE) / 2, (1 + SHARE) / 2])
    return {"median": median, "low": low, "high": high, "above_zero": float((draws > 0).mean())}


def agreed(draws: np.ndarray) -> dict[str, float]:
    """Return R-hat and effective sample size of draws (chains, draws)."""
    from arviz_stats.base import array_stats

    axes = {"chain_axis": 0, "draw_axis": 1}
    sizes = (array_stats.ess(draws, method="bulk", **axes),
             array_stats.ess(draws, method="tail", prob=0.05, **axes))  # fmt: skip
    return {"rhat": float(array_stats.rhat(draws, **axes)), "effective": float(min(sizes))}


def compared(fits: Mapping[str, GroupFit]) -> pd.DataFrame:
    """Return how well each model predicts trials left out (PSIS-LOO)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        comparison = compare_fits(fits)
    unreliable = {name: score.unreliable for name, score in comparison.scores.items()}
    table = comparison.to_dataframe()
    return table.assign(unreliable=table["model"].map(unreliable)).drop(
        columns=["log_likelihood", "parameters", "bic"]
    )


def compared_terms(by: str, fast: bool, workers: int) -> pd.DataFrame:
    """Compare what the threshold of a model depends on, from the kept chains."""
    table = compared({terms: fitted(by, terms, fast, workers) for terms in TERMS})
    return table.rename(columns={"model": "terms"}).assign(by=by)


def compared_models(fast: bool, workers: int) -> pd.DataFrame:
    """Compare test and circuit, both with an interaction, from the kept chains."""
    return compared({by: fitted(by, "interaction", fast, workers) for by in MODELS})


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through the effects in the test and in the circuit, and the comparisons."""
    for by, terms, seconds in (
        ("test", "stimulation", 100), ("test", "interaction", 100), ("circuit", "interaction", 400),
    ):  # fmt: skip
        make = partial(effects, by, terms, fast, workers)
        name = f"{by} {terms}"
        yield Piece("effects", name, TRIALS_OF_ALL, seconds, make, of_circuit=by == "circuit")
    make = partial(compared_terms, "test", fast, workers)
    yield Piece("terms", "test", TRIALS_OF_ALL, 200, make, of_circuit=False)
    make = partial(compared_models, fast, workers)
    yield Piece("models", "interaction", TRIALS_OF_ALL, 200, make)
    make = partial(theta, fast, workers)
    yield Piece("theta", "high conflict", TRIALS_OF_ALL, 300, make, of_circuit=False)


SCORE = Score("patients", HIERARCHY_SEED, (2,), pieces, circuit=DEFAULT, partial=True)
