"""People who learn values and their fits: courses, times by the difference of values, recovery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.posterior import directions, posterior
from bgmodel.learning.value_learners import pairs_of
from bgmodel.learning.value_models import (
    ValueLikelihood,
    ValueModel,
    choice_probability,
    draw,
    likelihood,
    simulated,
)
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Truths

GROUP, LAST = 5, 40
"""Trials of a pair are averaged in groups, up to the shortest session of most people."""
PARTS = 4
"""Groups of trials by the difference of values."""
DRAWN = 10
"""Simulated times of each trial."""
STEPS = 300
"""Steps of each walker of a posterior, of which the second half is kept."""


def mean_and_error(values: Sequence[float] | Array) -> tuple[float, float]:
    """Return the mean over people and its standard error; NaN entries are left out."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(len(known)))


def predicted(fit: Optimum, seed: int, name: str) -> tuple[Array, Array, Array]:
    """Return a fit's predictions for every trial, given all earlier ones.

    The drift towards the better item (trials,), 1/sqrt(s), the probability of choosing it, and
    simulated response times (DRAWN, trials), s.
    """
    fitted, trials = fit.likelihood, trials_of(fit)
    assert isinstance(fitted, ValueLikelihood)
    drift, bound, start, t0_s = fitted.model.diffusion(trials, fitted.values(fit.vector))
    uniform = stream(seed, "predicted", name).random((DRAWN, 4, trials.trials))
    rt_s = np.stack([draw(drift, bound, start, t0_s, one)[1] for one in uniform])
    return drift, choice_probability(drift, bound, start), rt_s


def trials_of(fit: Optimum) -> Trials:
    """Return the trials of a person who was fitted."""
    trials = fit.likelihood.design.choices
    assert trials is not None
    return trials


def courses(fits: dict[str, Optimum], seed: int) -> pd.DataFrame:
    """Return choices and median times by pair and group of trials, of people and of fits.

    Columns pair, trial (middle of the group), then share, share_se, share_model, median_s,
    median_s_se, median_s_model: means over people.
    """
    of_model = {who: predicted(fit, seed, who) for who, fit in fits.items()}
    names, rows = pairs_of(trials_of(next(iter(fits.values())))).names, []
    for pair, pair_name in enumerate(names):
        for first in range(0, LAST, GROUP):
            each: dict[str, list[float]] = {}
            for who, fit in fits.items():
                person, (_, p, times) = trials_of(fit), of_model[who]
                pairs = pairs_of(person)
                inside = (pairs.pair == pair) & (pairs.within // GROUP == first // GROUP)
                if not inside.any():
                    continue
                measures = {
                    "share": person.response[inside].mean(), "share_model": p[inside].mean(),
                    "median_s": np.median(person.rt_s[inside]),
                    "median_s_model": np.median(times[:, inside]),
                }  # fmt: skip
                for key, value in measures.items():
                    each.setdefault(key, []).append(float(value))
            row: dict[str, Any] = {"pair": pair_name, "trial": first + (GROUP - 1) / 2}
            rows.append(row | _summarised(each))
    return pd.DataFrame(rows)


def by_difference(fits: dict[str, Optimum], seed: int) -> pd.DataFrame:
    """Return choices and median times by each person's quarter of the absolute drift.

    "share" is that of the item with the higher learned value; means over people.
    """
    each: list[dict[str, list[float]]] = [{} for _ in range(PARTS)]
    for who, fit in fits.items():
        for row, of_part in zip(each, quarters(fit, seed, who), strict=True):
            for key, value in of_part.items():
                row.setdefault(key, []).append(value)
    return pd.DataFrame([{"part": k + 1} | _summarised(one) for k, one in enumerate(each)])


def quarters(fit: Optimum, seed: int, name: str) -> list[dict[str, float]]:
    """Return the choices and median times of one person by quarter of the absolute drift."""
    (drift, p, times), person = predicted(fit, seed, name), trials_of(fit)
    known, size = drift != 0, np.abs(drift)
    edges = np.quantile(size[known], np.linspace(0, 1, PARTS + 1)[1:-1])
    part = np.searchsorted(edges, size)
    higher, p_higher = person.response == (drift > 0), np.where(drift > 0, p, 1 - p)
    by_quarter = []
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
        by_quarter.append({name: _middle(name, values) for name, values in of_part.items()})
    return by_quarter


def _middle(name: str, values: Array) -> float:
    """Return the median of times, or the mean of other values; NaN without values."""
    if not values.size:
        return float("nan")
    return float(np.median(values) if name.startswith("median") else np.mean(values))


def _summarised(each: dict[str, list[float]]) -> dict[str, float]:
    """Return means over people, and the standard errors of those that were observed."""
    summary: dict[str, float] = {}
    for key, values in each.items():
        mean, error = mean_and_error(values)
        summary[key] = mean
        if key in ("share", "median_s"):
            summary[f"{key}_se"] = error
    return summary | {"people": len(next(iter(each.values())))}


def rises(people: dict[str, Trials], pair: str) -> list[float]:
    """Return each person's share of the better item in the last 10 trials less the first 10."""
    changes = []
    for person in people.values():
        chosen = person.response[person.conditions["pair"] == pair]
        changes.append(float(chosen[-10:].mean() - chosen[:10].mean()))
    return changes


def slow_errors(people: dict[str, Trials]) -> list[float]:
    """Return each person's median time of errors less correct responses, s, mean over pairs."""
    differences = []
    for person in people.values():
        apart, pairs = [], pairs_of(person)
        for pair in range(len(pairs.names)):
            inside = pairs.pair == pair
            wrong, right = (person.rt_s[inside & (person.response == k)] for k in (0, 1))
            if len(wrong) and len(right):
                apart.append(np.median(wrong) - np.median(right))
        differences.append(float(np.mean(apart)))
    return differences


def like(fits: Sequence[Optimum], people: int, seed: int) -> Array:
    """Return parameters of simulated people, (people, parameters), on their scales.

    Each parameter is normal with the median of the fits and the standard deviation that their
    median absolute deviation gives, independently of the others.
    """
    at = np.stack([fit.likelihood.freedom.to_scale(fit.vector) for fit in fits])
    middle = np.median(at, axis=0)
    spread = 1.4826 * np.median(np.abs(at - middle), axis=0)
    rng = stream(seed, "parameters", fits[0].likelihood.model.name)
    return middle + spread * rng.standard_normal((people, len(middle)))


def natural(model: ValueModel, scaled: Array) -> dict[str, Array]:
    """Return parameters by name from an array (people, parameters) on their scales."""
    pairs = zip(model.parameters, scaled.T, strict=True)
    return {each.name: np.clip(each.natural(x), each.low, each.high) for each, x in pairs}


def recovered(model: ValueModel, true: Array, seed: int) -> tuple[Array, Truths]:
    """Return estimates of simulated people, and whether 90 % intervals contain the truth.

    Both are (people, parameters), on their scales.
    """
    estimates, inside = np.empty(true.shape), np.empty(true.shape, dtype=bool)
    for who, person in simulated(model, natural(model, true), seed=seed).by_participant().items():
        k, of_person = int(who), likelihood(model, person)
        at = optimum(of_person).vector
        drawn = posterior(of_person, directions(of_person, at), most_steps=STEPS, seed=seed + k)
        estimates[k], (low, high) = of_person.freedom.to_scale(at), drawn.interval()
        inside[k] = (of_person.freedom.to_scale(low) <= true[k]) & (
            true[k] <= of_person.freedom.to_scale(high)
        )
    return estimates, inside


def log_ratio(values: Mapping[str, float]) -> float:
    """Return the logarithm of the rate of gains over that of losses."""
    return float(np.log(values["rate"] / values["rate_minus"]))
