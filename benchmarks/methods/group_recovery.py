"""Data sets of 20 people who follow the test or the circuit, and hierarchical fits to them.

A group is drawn from the prior of the fit, restricted to values as in fits to people and monkeys:
each mean is uniform over a range, and each standard deviation between people half-t below
``MOST_SD``. Draws of the posterior within the same limits are therefore draws from the posterior
under the prior that made the data, and the rank of the truth among them is uniform (Talts et al.
2018), whatever the rest of the wide prior. The scale is fixed: the unit that a fit takes from the
data would make the prior depend on them.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.methods.decided import (
    DEADLINE_S,
    TRIALS,
    decided_by_circuit,
    decided_by_test,
    responses,
)
from benchmarks.scores.fits import fitted_circuit
from bgmodel.fitting.exact.algorithms import GapModel, Model
from bgmodel.fitting.hierarchy.fit import SHARE, GroupFit, fit_group
from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD
from bgmodel.fitting.hierarchy.scale import Scale
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.simulated.circuit import NONE
from bgmodel.fitting.trials.design import Design
from bgmodel.support.arrays import Array, Truths
from bgmodel.support.seeds import stream
from circuits.errors import FitWarning

STRENGTHS = (0.032, 0.064, 0.128, 0.256)
PEOPLE, EACH = 20, 50
"""People of a data set, and trials of each at every strength."""
RANGES = {
    "sensitivity": (8.0, 25.0), "bound": (0.45, 0.9), "threshold_nats": (0.17, 0.37),
    "t0_s": (0.25, 0.5), "t0_sd_s": (0.03, 0.1), "lapse": (0.002, 0.03),
}  # fmt: skip
"""Ranges of the median person's parameters, as in fits to people and monkeys."""
MOST_SD = 1.5
"""Largest standard deviation between people, in units of the scale: 3/8 of a typical value."""


@dataclass(frozen=True)
class Truth:
    """Parameters of a group and of its people, on the scale.

    Parameters
    ----------
    scale : Scale
        The scale.
    mean, sd : array (parameters,)
        Distribution of the group.
    scaled : array (people, parameters)
        The people.
    """

    scale: Scale
    mean: Array
    sd: Array
    scaled: Array


def model_of(by: str, trials: int) -> tuple[Model, list[str]]:
    """Return the model that people follow, and the names of its parameters that differ."""
    model = GapModel() if by == "test" else fitted_circuit(NONE, trials, DEADLINE_S)
    return model, [each.name for each in model.parameters if each.free]


def scale_of(likelihood: Likelihood) -> Scale:
    """Return the scale, whose unit is a quarter of the middle of each range."""
    middles = [sum(RANGES[name]) / 2 for name in likelihood.freedom.names]
    return Scale.of(likelihood.freedom, np.array(middles))


def group(scale: Scale, names: Sequence[str], rng: np.random.Generator, people: int) -> Truth:
    """Return a group and its people, drawn from the prior."""
    low, high = np.array([RANGES[name] for name in names]).T
    mean = scale.to(rng.uniform(low, high))
    sd = np.full(len(names), np.inf)
    while (above := sd > MOST_SD).any():
        sd[above] = SPREAD * np.abs(rng.standard_t(FREEDOM, size=above.sum()))
    return Truth(scale, mean, sd, mean + sd * rng.normal(size=(people, len(names))))


def trials_of(
    by: str, values: dict[str, float], seed: int, number: int, who: int, each: int
) -> Design:
    """Return the trials of a person."""
    rng = stream(seed, "responses", by, number, who)
    if by == "test":
        found = decided_by_test(values, STRENGTHS, each, rng)
    else:
        found = decided_by_circuit(values, STRENGTHS, each, int(rng.integers(2**31)), rng)
    return responses(values, STRENGTHS, found, rng)


def data_set(
    by: str, seed: int, number: int, *, people: int = PEOPLE, each: int = EACH, trials: int = TRIALS
) -> tuple[Truth, dict[str, Likelihood]]:
    """Return the truth of a data set, and the likelihood of each person's trials."""
    model, names = model_of(by, trials)
    # Ranges of the parameters are the same for all data: those of any trials set the scale.
    any_trials = trials_of(by, {name: RANGES[name][0] for name in names}, seed, number, -1, 1)
    scale = scale_of(likelihood_of(model, any_trials, free=names))
    truth = group(scale, names, stream(seed, "group", by, number), people)
    found = {}
    for who, vector in enumerate(scale.back(truth.scaled).tolist()):
        values = dict(zip(names, vector, strict=True))
        design = trials_of(by, values, seed, number, who, each)
        found[f"{who:02d}"] = likelihood_of(model, design, free=names)
    return truth, found


def recovered(by: str, seed: int, number: int, *, workers: int = 1, **sizes: int) -> pd.DataFrame:
    """Return truth and posterior of each number of the group and of its people in a data set."""
    truth, likelihoods = data_set(by, seed, number, **sizes)
    chains_seed = int(stream(seed, "chains", by, number).integers(2**31))
    with warnings.catch_warnings():
        # Diagnostics are part of the result.
        warnings.simplefilter("ignore", FitWarning)
        fit = fit_group(likelihoods, seed=chains_seed, scale=truth.scale, workers=workers)
    return compared(truth, fit).assign(set=number, by=by)


def within(fit: GroupFit) -> Truths:
    """Return which draws of a group are within the limits of those that made the data.

    Array (draws,), chains one after the other.
    """
    low, high = fit.scale.to(np.array([RANGES[name] for name in fit.parameters]).T)
    mean = np.concatenate([each.mean for each in fit.chains])
    sd = np.concatenate([each.sd for each in fit.chains])
    return np.asarray(((mean >= low) & (mean <= high) & (sd <= MOST_SD)).all(axis=1))


def compared(truth: Truth, fit: GroupFit) -> pd.DataFrame:
    """Return a row for each number: its truth, its posterior, and the rank of the truth.

    Columns of, person, parameter, truth, mean, low and high (central interval of 0.9, all draws),
    mean_prior and rank (mean of the draws within the limits of the prior, and the share of them
    that are below the truth), inside (number of such draws), draws, rhat and effective. Standard
    deviations are on the scale.
    """
    inside = within(fit)
    parts = [("mean", "", fit.group, truth.scale.back(truth.mean))]
    parts += [("spread", "", np.stack([each.sd for each in fit.chains]), truth.sd)]
    parts += [
        ("person", who, fit.individual[:, :, k], truth.scale.back(truth.scaled[k]))
        for k, who in enumerate(fit.people)
    ]
    rows = []
    for of, who, draws, true in parts:
        flat = draws.reshape(-1, draws.shape[-1])
        ends = np.quantile(flat, [(1 - SHARE) / 2, (1 + SHARE) / 2], axis=0)
        kept = flat[inside] if inside.any() else np.full((1, len(true)), np.nan)
        ranks = np.where(np.isnan(kept[0]), np.nan, (kept < true).mean(axis=0))
        columns = (true, flat.mean(axis=0), *ends, kept.mean(axis=0), ranks)
        rows += [(of, who, *each) for each in zip(fit.parameters, *columns, strict=True)]
    names = ["of", "person", "parameter", "truth", "mean", "low", "high", "mean_prior", "rank"]
    return pd.DataFrame(rows, columns=names).assign(
        inside=int(inside.sum()), draws=len(inside),
        rhat=fit.agreement.rhat, effective=fit.agreement.effective,
    )  # fmt: skip
