"""People who learn values and their fits: courses, times by the difference of values, recovery."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.learning.values.diffusion import choice_probability, draw
from bgmodel.learning.values.fits import ValueFit, fit_person
from bgmodel.learning.values.models import ValueModel
from bgmodel.learning.values.people import PairTrials
from bgmodel.learning.values.simulated import simulated
from bgmodel.support.arrays import Array, Truths
from bgmodel.support.seeds import stream

GROUP, LAST = 5, 40
"""Trials of a pair are averaged in groups, up to the shortest session of most people."""
PARTS = 4
"""Groups of trials by the difference of values."""
DRAWN = 10
"""Simulated times of each trial."""


def mean_and_error(values: Sequence[float] | Array) -> tuple[float, float]:
    """Return the mean over people and its standard error; NaN entries are left out."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(len(known)))


def predicted(fit: ValueFit, seed: int, name: str) -> tuple[Array, Array]:
    """Return what a fit predicts for every trial, given all earlier ones.

    Returns
    -------
    better : array (trials,)
        Probability of choosing the better item.
    rt_s : array (DRAWN, trials)
        Simulated response times, s.
    """
    values = {key: np.array([value]) for key, value in fit.values.items()}
    drift = fit.model.drifts(values, fit.person)[0]
    bound = np.full(fit.person.trials, fit.values["bound"])
    start = fit.values["stickiness"] * bound * fit.person.last_choice
    t0_s = np.full(fit.person.trials, fit.values["non_decision_s"])
    uniform = stream(seed, "predicted", name).random((DRAWN, 4, fit.person.trials))
    rt_s = np.stack([draw(drift, bound, start, t0_s, one)[1] for one in uniform])
    return choice_probability(drift, bound, start), rt_s


def courses(fits: dict[str, ValueFit], seed: int) -> pd.DataFrame:
    """Return choices and median times by pair and group of trials, of people and of fits.

    Columns pair, trial (middle of the group), then share, share_se, share_model, median_s,
    median_s_se, median_s_model: means over people.
    """
    of_model = {who: predicted(fit, seed, who) for who, fit in fits.items()}
    names, rows = next(iter(fits.values())).person.names, []
    for pair, pair_name in enumerate(names):
        for first in range(0, LAST, GROUP):
            each: dict[str, list[float]] = {}
            for who, fit in fits.items():
                person, (p, times) = fit.person, of_model[who]
                inside = (person.pair == pair) & (person.within // GROUP == first // GROUP)
                if not inside.any():
                    continue
                found = {
                    "share": person.response[inside].mean(), "share_model": p[inside].mean(),
                    "median_s": np.median(person.rt_s[inside]),
                    "median_s_model": np.median(times[:, inside]),
                }  # fmt: skip
                for key, value in found.items():
                    each.setdefault(key, []).append(float(value))
            row: dict[str, Any] = {"pair": pair_name, "trial": first + (GROUP - 1) / 2}
            rows.append(row | _summarised(each))
    return pd.DataFrame(rows)


def by_difference(fits: dict[str, ValueFit], seed: int) -> pd.DataFrame:
    """Return choices and median times by each person's quarter of the absolute drift.

    "share" is that of the item with the higher learned value; means over people.
    """
    each: list[dict[str, list[float]]] = [{} for _ in range(PARTS)]
    for who, fit in fits.items():
        for row, of_part in zip(each, quarters(fit, seed, who), strict=True):
            for key, value in of_part.items():
                row.setdefault(key, []).append(value)
    return pd.DataFrame([{"part": k + 1} | _summarised(one) for k, one in enumerate(each)])


def quarters(fit: ValueFit, seed: int, name: str) -> list[dict[str, float]]:
    """Return the choices and median times of one person by quarter of the absolute drift."""
    p, times = predicted(fit, seed, name)
    values = {key: np.array([value]) for key, value in fit.values.items()}
    drift, person = fit.model.drifts(values, fit.person)[0], fit.person
    known, size = drift != 0, np.abs(drift)
    edges = np.quantile(size[known], np.linspace(0, 1, PARTS + 1)[1:-1])
    part = np.searchsorted(edges, size)
    higher, p_higher = person.response == (drift > 0), np.where(drift > 0, p, 1 - p)
    found = []
    for k in range(PARTS):
        inside = known & (part == k)
        columns = {
            "drift": size,
            "share": higher,
            "share_model": p_higher,
            "median_s": person.rt_s,
            "median_s_model": times,
        }
        of_part = {name: values[..., inside] for name, values in columns.items()}
        found.append({name: _middle(name, values) for name, values in of_part.items()})
    return found


def _middle(name: str, values: Array) -> float:
    """Return the median of times, and the mean of others; NaN if there are none."""
    if not values.size:
        return float("nan")
    return float(np.median(values) if name.startswith("median") else np.mean(values))


def _summarised(each: dict[str, list[float]]) -> dict[str, float]:
    """Return means over people, and the standard errors of those that were observed."""
    found: dict[str, float] = {}
    for key, values in each.items():
        mean, error = mean_and_error(values)
        found[key] = mean
        if key in ("share", "median_s"):
            found[f"{key}_se"] = error
    return found | {"people": len(next(iter(each.values())))}


def rises(people: dict[str, PairTrials], pair: str) -> list[float]:
    """Return each person's share of the better item in the last 10 trials less the first 10."""
    found = []
    for person in people.values():
        chosen = person.response[person.pair == person.names.index(pair)]
        found.append(float(chosen[-10:].mean() - chosen[:10].mean()))
    return found


def slow_errors(people: dict[str, PairTrials]) -> list[float]:
    """Return each person's median time of errors less correct responses, s, mean over pairs."""
    found = []
    for person in people.values():
        apart = []
        for pair in range(len(person.names)):
            inside = person.pair == pair
            wrong, right = (person.rt_s[inside & (person.response == k)] for k in (0, 1))
            if len(wrong) and len(right):
                apart.append(np.median(wrong) - np.median(right))
        found.append(float(np.mean(apart)))
    return found


def like(fits: Sequence[ValueFit], people: int, seed: int) -> Array:
    """Return parameters of simulated people, (people, parameters), on the scale of a fit.

    Each parameter is normal with the median of the fits and the standard deviation that their
    median absolute deviation gives, independently of the others.
    """
    at = np.stack([fit.at for fit in fits])
    middle = np.median(at, axis=0)
    spread = 1.4826 * np.median(np.abs(at - middle), axis=0)
    rng = stream(seed, "parameters", fits[0].model.name)
    return middle + spread * rng.standard_normal((people, len(middle)))


def from_prior(model: ValueModel, people: int, seed: int) -> Array:
    """Return parameters drawn from the priors, (people, parameters), on the scale of a fit."""
    middle = np.array([float(each.fitted(each.median)) for each in model.parameters])
    spread = np.array([each.sd for each in model.parameters])
    rng = stream(seed, "prior", model.name)
    return middle + spread * rng.standard_normal((people, len(middle)))


def recovered(model: ValueModel, true: Array, seed: int) -> tuple[Array, Truths]:
    """Return estimates of simulated people, and whether 90 % intervals contain the truth.

    Both are (people, parameters), on the scale of a fit.
    """
    found, inside = np.empty(true.shape), np.empty(true.shape, dtype=bool)
    for k, person in enumerate(simulated(model, true, seed=seed)):
        fit = fit_person(model, person)
        found[k] = fit.at
        ends = fit.intervals(seed + k)
        for j, each in enumerate(model.parameters):
            low, high = ends[each.name]
            inside[k, j] = low <= float(each.natural(true[k, j])) <= high
    return found, inside


def log_ratio(fit: ValueFit) -> float:
    """Return the logarithm of the rate of gains over that of losses."""
    return float(np.log(fit.values["rate"] / fit.values["rate_minus"]))
