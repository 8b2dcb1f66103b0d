"""Measures of the exam: functions of the tables of trials and rates.

Each takes an ``Asked`` and the arguments that a number names in ``of``, and returns the value with
its standard error from simulation. ``measure`` registers one; those that need the circuit itself
are in ``of_circuit``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bgmodel.bootstrap import resampled
from bgmodel.deciding.measures import mean
from bgmodel.exam.numbers import Task
from bgmodel.exam.sitting import Sitting
from bgmodel.exam.tables import Failed, Tables, Unanswered
from bgmodel.stopping.estimates import inhibition_function, ssrt_by_delay
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.errors import InputError

RESAMPLES, FEW_RESAMPLES = 400, 100
FEWEST = 20
"""Fewest trials of a kind, such as errors, for a value."""
MOST_MISSED = 0.5
"""Largest share of missed trials for a mean time, in which they count at the deadline."""


@dataclass(frozen=True)
class Answer:
    """The value of a number, its standard error, and the trials behind it."""

    value: float
    se: float
    trials: int

    @classmethod
    def of(cls, values: Array, trials: int) -> Answer:
        """Return an answer from a value and its resamples, (1 + B,)."""
        known = values[np.isfinite(values)]
        if not np.isfinite(values[0]) or len(known) < 0.9 * len(values):
            raise Unanswered("too few trials of the kind that it needs")
        return cls(float(values[0]), float(known[1:].std(ddof=1)), trials)


@dataclass(frozen=True)
class Asked:
    """Who is asked: tables and, for a circuit, its sitting."""

    tables: Tables
    tasks: dict[str, Task]
    seed: int
    sitting: Sitting | None = None
    in_hz: bool = False


Measure = Callable[..., Answer]
MEASURES: dict[str, Measure] = {}
"""Measures by name."""


def measure(function: Measure) -> Measure:
    """Register a measure under the name of its function."""
    MEASURES[function.__name__] = function
    return function


def aligned(asked: Asked, *tasks: str) -> tuple[list[pd.DataFrame], Array]:
    """Return the trials of several tasks in one order, and weights that resample trials.

    A trial that a task lacks is a row of NaN. Trials with one number are drawn together.
    """
    found = [asked.tables.trials_of(task) for task in tasks]
    every = sorted(set().union(*(table.index for table in found)))
    weights = resampled(len(every), RESAMPLES, stream(asked.seed, "exam", "bootstrap"))
    return [table.reindex(every) for table in found], weights


def times(table: pd.DataFrame, weights: Array) -> Array:
    """Return the mean time of go trials, (B,), ms; missed ones count at the deadline."""
    go = table["ssd_ms"].isna() & (table["rt_ms"].notna() | table["deadline_ms"].notna())
    missed = (table["rt_ms"].isna() & go).sum() / max(1, go.sum())
    if missed > MOST_MISSED:
        raise Failed(f"{missed:.0%} of trials have no response in time")
    values = table["rt_ms"].fillna(table["deadline_ms"])
    return mean(values.fillna(0).to_numpy(), go.to_numpy(), weights)


def shares(table: pd.DataFrame, column: str, weights: Array) -> Array:
    """Return the mean of a column of 0 and 1 over the trials in which it is known, (B,)."""
    known = table[column].notna()
    if known.sum() < FEWEST:
        raise Unanswered(f"fewer than {FEWEST} trials have a value of {column}")
    return mean(table[column].fillna(0).to_numpy(), known.to_numpy(), weights)


@measure
def time_change(asked: Asked, task: str, minus_task: str, unit: str = "ms") -> Answer:
    """Return the mean time of one task less that of another, ms or percent of the latter."""
    (new, old), weights = aligned(asked, task, minus_task)
    after, before = times(new, weights), times(old, weights)
    change = after - before
    return Answer.of(100 * change / before if unit == "percent" else change, len(new))


@measure
def time_interaction(
    asked: Asked,
    task: str,
    minus_task: str,
    second_task: str,
    second_minus_task: str,
    unit: str = "ms",
) -> Answer:
    """Return the difference of two changes of the mean time, ms or percent of the last task."""
    names = (task, minus_task, second_task, second_minus_task)
    tables, weights = aligned(asked, *names)
    a, b, c, d = (times(table, weights) for table in tables)
    change = (a - b) - (c - d)
    return Answer.of(100 * change / d if unit == "percent" else change, len(tables[0]))


@measure
def accuracy_change(asked: Asked, task: str, minus_task: str) -> Answer:
    """Return the proportion correct of decided trials in one task less that in another."""
    return _share_change(asked, "correct", task, minus_task)


@measure
def anticipation_change(asked: Asked, task: str, minus_task: str) -> Answer:
    """Return the share of foreperiods with a response in one task less that in another."""
    return _share_change(asked, "anticipatory", task, minus_task)


def _share_change(asked: Asked, column: str, task: str, minus_task: str) -> Answer:
    (new, old), weights = aligned(asked, task, minus_task)
    return Answer.of(shares(new, column, weights) - shares(old, column, weights), len(new))


@measure
def error_delay(asked: Asked, task: str) -> Answer:
    """Return the mean time of errors less that of correct responses, in units of their sd."""
    (table,), weights = aligned(asked, task)
    made = table["rt_ms"].notna().to_numpy()
    right, rt = (table["correct"] == 1).to_numpy(), table["rt_ms"].fillna(0).to_numpy()
    wrong = made & ~right
    if wrong.sum() < FEWEST:
        raise Unanswered(f"fewer than {FEWEST} errors")
    sd = np.sqrt(mean(rt**2, made, weights) - mean(rt, made, weights) ** 2)
    return Answer.of((mean(rt, wrong, weights) - mean(rt, made & right, weights)) / sd, made.sum())


@measure
def skewness(asked: Asked, task: str) -> Answer:
    """Return (q90 - q50) / (q50 - q10) of the times of a task."""
    rt = asked.tables.trials_of(task)["rt_ms"].dropna().to_numpy()
    if len(rt) < 100:
        raise Unanswered("fewer than 100 responses")
    rng = stream(asked.seed, "exam", "times")
    drawn = np.concatenate([rt[None], rng.choice(rt, (RESAMPLES, len(rt)))])
    low, middle, high = np.quantile(drawn, (0.1, 0.5, 0.9), axis=1)
    return Answer.of((high - middle) / (middle - low), len(rt))


@measure
def respond_change(asked: Asked, task: str, minus_task: str) -> Answer:
    """Return the share of stop trials with a response in one task less that in another."""
    (new, old), weights = aligned(asked, task, minus_task)
    parts = []
    for table in (new, old):
        stop = table["ssd_ms"].notna().to_numpy()
        if not stop.any():
            raise Unanswered("there are no stop trials")
        parts.append(mean(table["rt_ms"].notna().to_numpy(), stop, weights))
    return Answer.of(parts[0] - parts[1], len(new))


@measure
def failed_minus_go(asked: Asked, task: str) -> Answer:
    """Return the mean time of failed stops less that of go responses, ms."""
    (table,), weights = aligned(asked, task)
    stop, made = table["ssd_ms"].notna().to_numpy(), table["rt_ms"].notna().to_numpy()
    if (stop & made).sum() < FEWEST:
        raise Unanswered(f"fewer than {FEWEST} failed stops")
    rt = table["rt_ms"].fillna(0).to_numpy()
    return Answer.of(mean(rt, stop & made, weights) - mean(rt, made & ~stop, weights), len(table))


@measure
def ssrt_change(asked: Asked, task: str, minus_task: str) -> Answer:
    """Return the stop-signal reaction time of one task less that of another, ms."""
    tables, _ = aligned(asked, task, minus_task)
    count = len(tables[0])
    draws = stream(asked.seed, "exam", "stops").integers(count, size=(FEW_RESAMPLES, count))
    rows = [np.arange(count), *draws]
    values = [_ssrt(tables[0].iloc[k]) - _ssrt(tables[1].iloc[k]) for k in rows]
    return Answer.of(np.array(values), count)


def _ssrt(table: pd.DataFrame) -> float:
    """Return the stop-signal reaction time by integration at each delay, ms."""
    known = table["rt_ms"].notna() | table["deadline_ms"].notna()
    table = table[known]
    if table["ssd_ms"].isna().all() or table["ssd_ms"].notna().all():
        raise Unanswered("it needs go trials and stop trials")
    try:
        trials = StopTrials(table["rt_ms"].to_numpy(), table["ssd_ms"].to_numpy())
        return ssrt_by_delay(inhibition_function(trials))
    except InputError as error:
        raise Unanswered(str(error)) from None


@measure
def rate(asked: Asked, nucleus: str, window: str, task: str, role: str = "all") -> Answer:
    """Return the mean rate of a nucleus in a window, Hz."""
    _check_hz(asked, nucleus)
    values = asked.tables.rates_of(task, nucleus, window, role)
    return _mean_of(values.to_numpy())


@measure
def rate_change(
    asked: Asked,
    nucleus: str,
    window: str,
    task: str,
    role: str = "all",
    minus_window: str = "",
    minus_task: str = "",
    minus_role: str = "",
    unit: str = "Hz",
) -> Answer:
    """Return a rate less another one, in Hz or percent of it; what is not named is the same."""
    _check_hz(asked, nucleus)
    new = asked.tables.rates_of(task, nucleus, window, role)
    place = (minus_task or task, nucleus, minus_window or window, minus_role or role)
    old = asked.tables.rates_of(*place)
    scale = 100 / float(old.mean()) if unit == "percent" and old.mean() else 1.0
    both = new.index.intersection(old.index)
    if len(both) >= 0.5 * min(len(new), len(old)):
        return _mean_of(scale * (new[both] - old[both]).to_numpy())
    one, other = _mean_of(scale * new.to_numpy()), _mean_of(scale * old.to_numpy())
    return Answer(
        one.value - other.value, float(np.hypot(one.se, other.se)), one.trials + other.trials
    )


def _check_hz(asked: Asked, nucleus: str) -> None:
    if asked.in_hz and nucleus in asked.tables.abstract:
        raise Unanswered(f"the activity of {nucleus} is abstract, not a rate of cells in Hz")


def _mean_of(values: Array) -> Answer:
    if len(values) < FEWEST:
        raise Unanswered(f"fewer than {FEWEST} trials or cells have such a rate")
    se = values.std(ddof=1) / np.sqrt(len(values))
    return Answer(float(values.mean()), float(se), len(values))


@measure
def hick_slope(asked: Asked, tasks: str) -> Answer:
    """Return the slope of the mean time over ln N, ms."""
    return slope_over(asked, [name.strip() for name in tasks.split(",")])


def slope_over(asked: Asked, names: list[str]) -> Answer:
    """Return the slope of the mean times of tasks over the logarithm of their alternatives, ms."""
    x = np.log([asked.tasks[name].channels for name in names])
    about = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
    total, variance, count = 0.0, 0.0, 0
    for name, weight in zip(names, about, strict=True):
        (table,), draws = aligned(asked, name)
        one = Answer.of(times(table, draws), len(table))
        total, variance = total + weight * one.value, variance + (weight * one.se) ** 2
        count += one.trials
    return Answer(float(total), float(np.sqrt(variance)), count)
