"""Measures of a Simon task and of the test after it, and their contrasts over people.

People and simulated people are measured by the same functions, from tables with the columns of the
shipped set ``parkinson_simon_2018``. In the test the value of an item is how often it was rewarded.
Intervals over people are expanded percentiles of a bootstrap (Hesterberg 2015, The American
Statistician 69, 371-386), because plain percentiles are too narrow with few people: by 8 % for 22.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.stats import norm
from scipy.stats import t as student

from bgmodel.bootstrap import RESAMPLES, resampled
from circuits.arrays import Array
from circuits.errors import require

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
COLUMNS = ("participant_id", "medication", "session", "phase", "congruency", "pair", "rt")
VALUES = {"A": 1.0, "B": 0.5, "C": 0.5, "D": 0.0}
"""How often a correct response to an item is rewarded."""
BOTH = ("congruent", "incongruent")
MOST_S = 10.0
"""Longest response time in the test that is used, s: one is 376 s."""
FEWEST = 20
"""Fewest responses for a measure of a person."""


def measures(trials: pd.DataFrame) -> dict[str, float]:
    """Return the measures of a session, named as in the table of results; NaN if too few trials."""
    answered = trials[trials["rt"].notna()]
    training = answered[answered["phase"] == "training"]
    parts = [training[training["congruency"] == name] for name in BOTH]
    measured = dict(_of_training(parts))
    measured["missed"] = float(trials.loc[trials["phase"] == "training", "rt"].isna().mean())
    test = answered[(answered["phase"] == "test") & (answered["rt"] < MOST_S)]
    return measured | dict(_of_test(test))


def _of_training(parts: Sequence[pd.DataFrame]) -> Iterator[tuple[str, float]]:
    """Yield times of correct responses, ms, and shares of correct ones, congruent first."""
    rt = [1000 * part["rt"].to_numpy(float) for part in parts]
    right = [part["response"].to_numpy(float) == 1 for part in parts]
    times = [each[ok] for each, ok in zip(rt, right, strict=True)]
    enough = min(map(len, times)) >= FEWEST
    means = [each.mean() if enough else np.nan for each in times]
    yield from zip((f"{name}_ms" for name in BOTH), means, strict=True)
    yield "cost_ms", means[1] - means[0]
    nothing = np.full(len(QUANTILES), np.nan)
    one, other = (np.quantile(each, QUANTILES) if enough else nothing for each in times)
    for q, a, b in zip(QUANTILES, one, other, strict=True):
        yield f"q{100 * q:.0f}_ms", (a + b) / 2
        yield f"cost_q{100 * q:.0f}_ms", b - a
    yield "delta_ms", (other - one)[-1] - (other - one)[0]
    for name, each, ok in zip(BOTH, rt, right, strict=True):
        third = _thirds(each, ok)
        yield f"{name}_right", ok.mean() if len(ok) >= FEWEST else np.nan
        yield f"{name}_fast", third[0]
        yield f"{name}_slow", third[2]
        yield f"{name}_rise", third[2] - third[0]


def _thirds(times: Array, right: npt.NDArray[np.bool_]) -> Array:
    """Return the share of correct responses among the fastest, middle and slowest third."""
    if len(times) < 3 * FEWEST:
        return np.full(3, np.nan)
    order = np.argsort(times, kind="stable")
    return np.array([part.mean() for part in np.array_split(right[order], 3)])


def _of_test(test: pd.DataFrame) -> Iterator[tuple[str, float]]:
    """Yield shares of the better item, and median times, s, by difference of value."""
    better, seconds = test["response"].to_numpy(float), test["rt"].to_numpy(float)
    pairs = np.array(["".join(sorted(pair)) for pair in test["pair"]], dtype="<U2")
    apart = np.array([VALUES[pair[0]] - VALUES[pair[1]] for pair in pairs])
    median = {}
    for name, size in (("near", 0.5), ("far", 1.0)):
        some = apart == size
        enough = some.sum() >= FEWEST
        median[name] = np.median(seconds[some]) if enough else np.nan
        yield f"better_{name}", better[some].mean() if enough else np.nan
        yield f"test_{name}_s", median[name]
    yield "test_slope_s", median["near"] - median["far"]
    chosen, avoided = np.isin(pairs, ("AB", "AC")), np.isin(pairs, ("BD", "CD"))
    enough = min(chosen.sum(), avoided.sum()) >= FEWEST
    yield "choose_less_avoid", better[chosen].mean() - better[avoided].mean() if enough else np.nan


def of_people(trials: pd.DataFrame) -> pd.DataFrame:
    """Return one row per person and session: participant_id, medication, session, measures.

    ValueError if a column is missing, or a session has two states of medication.
    """
    missing = [name for name in (*COLUMNS, "response") if name not in trials]
    require(not missing, "trials", f"must have the columns {', '.join(missing)}", list(trials))
    states = trials.groupby(["participant_id", "session"])["medication"].nunique()
    require((states == 1).all(), "medication", "must be one per session", int(states.max()))
    keys = ["participant_id", "medication", "session"]
    rows = [
        dict(zip(keys, key, strict=True)) | measures(part) for key, part in trials.groupby(keys)
    ]
    return pd.DataFrame(rows)


def within(each: pd.DataFrame, column: str, one: object, other: object) -> pd.DataFrame:
    """Return the differences of people measured twice, one minus other, a row per person.

    They are two values of a column, medication or session, of ``of_people``; people without both
    are left out. ValueError if nobody has both.
    """
    sides = [each[each[column] == value].set_index("participant_id") for value in (one, other)]
    both = sides[0].index.intersection(sides[1].index)
    require(len(both) > 0, column, f"must be {one} and {other} in one person", None)
    names = named(each)
    return sides[0].loc[both, names] - sides[1].loc[both, names]


def named(each: pd.DataFrame) -> list[str]:
    """Return the names of measures among the columns."""
    return [str(name) for name in each if name not in ("participant_id", "medication", "session")]


def means(rows: pd.DataFrame, rng: np.random.Generator | int) -> pd.DataFrame:
    """Return mean, 95 % bootstrap interval over people and their number, a row per measure."""
    weights = resampled(len(rows), RESAMPLES, rng)
    people = rows.count()
    return _summary({str(k): _weighted(rows[k], weights) for k in rows}, people, people)


def between(one: pd.DataFrame, other: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Return the difference of two groups of people, one minus other, as ``means`` does."""
    weights = [resampled(len(rows), RESAMPLES, rng) for rows in (one, other)]
    apart = {str(k): _weighted(one[k], weights[0]) - _weighted(other[k], weights[1]) for k in one}
    fewer = np.minimum(one.count(), other.count())
    return _summary(apart, one.count() + other.count(), fewer)


def by_order(
    rows: pd.DataFrame, first: npt.NDArray[np.bool_], rng: np.random.Generator
) -> pd.DataFrame:
    """Return the mean over two orders, each order weighing the same, as ``means`` does.

    In differences of sessions, a row per person, the effect of what was given ``first`` (people,)
    then cancels. The bootstrap draws within orders.
    """
    parts = [rows[first], rows[~first]]
    weights = [resampled(len(part), RESAMPLES, rng) for part in parts]
    means = {
        str(k): (_weighted(parts[0][k], weights[0]) + _weighted(parts[1][k], weights[1])) / 2
        for k in rows
    }
    fewer = np.minimum(parts[0].count(), parts[1].count())
    return _summary(means, rows.count(), fewer)


def _weighted(values: pd.Series, weights: Array) -> Array:
    known = values.notna().to_numpy()
    with np.errstate(invalid="ignore"):
        mean: Array = weights[:, known] @ values.to_numpy()[known] / weights[:, known].sum(axis=1)
    return mean


def _summary(drawn: dict[str, Array], people: pd.Series, drawn_from: pd.Series) -> pd.DataFrame:
    """Return value, interval and number of people of each measure.

    Its value and then its resamples are ``drawn``, from ``drawn_from`` people in the smallest
    group.
    """
    rows = []
    for name, values in drawn.items():
        tail = expanded(int(drawn_from[name]))
        low, high = np.quantile(values[1:], [tail, 1 - tail])
        rows.append((name, values[0], low, high, int(people[name])))
    return pd.DataFrame(rows, columns=["measure", "value", "low", "high", "people"])


def expanded(people: int) -> float:
    """Return the quantile of the bootstrap at which a 95 % interval ends (Hesterberg 2015)."""
    if people < 2:
        return np.nan
    return float(norm.cdf(np.sqrt(people / (people - 1)) * student.ppf(0.025, people - 1)))
