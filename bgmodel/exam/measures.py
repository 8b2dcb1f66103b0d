"""Measures of the exam: functions of the tables of trials and rates.

Each takes ``Results`` and the arguments that a number names in ``of``, and returns the value with
its standard error from simulation. ``measure`` registers one; those that need the circuit itself
are in ``of_circuit``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from bgmodel.bootstrap import resampled
from bgmodel.deciding.measures import mean
from bgmodel.exam.numbers import ExamTask, Number
from bgmodel.exam.simulation import MOST_MISSED, Simulation
from bgmodel.exam.tables import Failed, NotApplicable, Tables
from bgmodel.stopping.estimates import inhibition_function, ssrt_by_delay
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.seeds import stream
from circuits.arrays import Array
from circuits.errors import InputError, require

RESAMPLES, FEW_RESAMPLES = 400, 100
FEWEST = 20
"""Fewest trials of a kind, such as errors, for a value."""


@dataclass(frozen=True)
class Estimate:
    """The value of a number, its standard error, and the trials behind it."""

    value: float
    se: float
    trials: int

    @classmethod
    def of(cls, values: Array, trials: int) -> Estimate:
        """Return an estimate from a value and its resamples, (1 + B,)."""
        known = values[np.isfinite(values)]
        if not np.isfinite(values[0]) or len(known) < 0.9 * len(values):
            raise NotApplicable("too few trials of the kind that it needs")
        return cls(float(values[0]), float(known[1:].std(ddof=1)), trials)


@dataclass(frozen=True)
class Results:
    """The trial tables, or the simulations of a circuit, to be scored.

    ``seed`` is that of the bootstrap and of the optimal test's evidence. ``in_hz``: the number is a
    rate in Hz, which abstract rates cannot give.
    """

    tables: Tables | Simulation
    tasks: dict[str, ExamTask]
    seed: int
    in_hz: bool = False

    @property
    def simulation(self) -> Simulation:
        """The circuit's simulations."""
        if isinstance(self.tables, Tables):
            raise NotApplicable("it needs the circuit itself, not its trials and rates")
        return self.tables


Statistic = Callable[[pd.DataFrame, Array], Array]
"""Takes trials and weights (B, trials), and returns a value for each row of weights, (B,)."""
Measure = Callable[..., Estimate]
MEASURES: dict[str, Measure] = {}
"""Measures by name."""
PERCENT, PROPORTION = "%", "proportion"
UNITS: dict[str, str] = {}
"""Units of measures in which a number could be in another one."""


def measure(unit: str = "") -> Callable[[Measure], Measure]:
    """Register a function as the measure of its name.

    ``unit`` is that of its numbers, where it could be mistaken for another.
    """

    def register(function: Measure) -> Measure:
        MEASURES[function.__name__] = function
        if unit:
            UNITS[function.__name__] = unit
        return function

    return register


def check_asked(number: Number) -> None:
    """Refuse a number whose measure is unknown, whose unit is another, or which is always 0."""
    must = f"must be one of {', '.join(MEASURES)}"
    require(number.measure in MEASURES, "measure", must, number.measure, owner=number.id)
    try:
        bound = inspect.signature(MEASURES[number.measure]).bind(None, **number.of)
    except TypeError as error:
        raise InputError(f"{number.id}: of does not fit {number.measure}: {error}", "of") from None
    if unit := UNITS.get(number.measure):
        of, units = str(number.of.get("unit", unit)), {unit: unit, "percent": PERCENT}
        require(of in units, "of", 'must have unit = "percent", or none', of, owner=number.id)
        must = f"must be {units[of]}, that of {number.measure}"
        if "unit" in bound.signature.parameters and of == unit:
            must += ', or "%" with unit = "percent" in of'
        require(number.unit == units[of], "unit", must, number.unit, owner=number.id)
        size = number.at_least if number.direction is not None else abs(number.middle)
        possible = number.unit != PROPORTION or size <= 1
        require(possible, "value", "must be a proportion: 0.01 for 1 %", size, owner=number.id)
    bound.apply_defaults()
    given = bound.arguments
    less = {name: value for name, value in given.items() if name.startswith("minus_")}
    same = [value in ("", given.get(name.removeprefix("minus_"))) for name, value in less.items()]
    if less and all(same):
        raise InputError(f"{number.id}: {', '.join(less)}: nothing differs, it is always 0", "of")


def aligned(results: Results, *tasks: str) -> tuple[list[pd.DataFrame], Array]:
    """Return the trials of several tasks in one order, and weights that resample trials.

    A trial that a task lacks is a row of NaN. Trials with one number are drawn together.
    """
    tables = [results.tables.trials_of(task) for task in tasks]
    numbers = sorted(set().union(*(table.index for table in tables)))
    weights = resampled(len(numbers), RESAMPLES, stream(results.seed, "exam", "bootstrap"))
    return [table.reindex(numbers) for table in tables], weights


def times(table: pd.DataFrame, weights: Array) -> Array:
    """Return the mean time of go trials, (B,), ms; missed ones count at the deadline."""
    go = table["ssd_ms"].isna() & table["task"].notna()
    missed = go & table["rt_ms"].isna()
    if missed.sum() > MOST_MISSED * go.sum():
        raise Failed(f"{missed.sum() / go.sum():.0%} of trials have no response in time")
    if (missed & table["deadline_ms"].isna()).any():
        raise NotApplicable("trials without a response have no deadline_ms")
    values = table["rt_ms"].fillna(table["deadline_ms"])
    return mean(values.fillna(0).to_numpy(), go.to_numpy(), weights)


def shares(table: pd.DataFrame, weights: Array, column: str) -> Array:
    """Return the mean of a column of 0 and 1 over the trials in which it is known, (B,)."""
    known = table[column].notna()
    if known.sum() < FEWEST:
        raise NotApplicable(f"fewer than {FEWEST} trials have a value of {column}")
    return mean(table[column].fillna(0).to_numpy(), known.to_numpy(), weights)


def _change(
    results: Results, statistic: Statistic, task: str, minus_task: str, unit: str = ""
) -> Estimate:
    """Return a statistic of one task less that of another, or in percent of the latter."""
    (new, old), weights = aligned(results, task, minus_task)
    after, before = statistic(new, weights), statistic(old, weights)
    change = after - before
    return Estimate.of(100 * change / before if unit == "percent" else change, len(new))


@measure("ms")
def time_change(results: Results, task: str, minus_task: str, unit: str = "ms") -> Estimate:
    """Return the mean time of one task less that of another, ms or percent of the latter."""
    return _change(results, times, task, minus_task, unit)


@measure("ms")
def time_interaction(
    results: Results,
    task: str,
    minus_task: str,
    second_task: str,
    second_minus_task: str,
    unit: str = "ms",
) -> Estimate:
    """Return the difference of two changes of the mean time, ms or percent of the last task."""
    names = (task, minus_task, second_task, second_minus_task)
    tables, weights = aligned(results, *names)
    a, b, c, d = (times(table, weights) for table in tables)
    change = (a - b) - (c - d)
    return Estimate.of(100 * change / d if unit == "percent" else change, len(tables[0]))


@measure(PROPORTION)
def accuracy_change(results: Results, task: str, minus_task: str) -> Estimate:
    """Return the proportion correct of decided trials in one task less that in another."""
    return _change(results, partial(shares, column="correct"), task, minus_task)


@measure(PROPORTION)
def anticipation_change(results: Results, task: str, minus_task: str) -> Estimate:
    """Return the share of foreperiods with a response in one task less that in another."""
    return _change(results, partial(shares, column="anticipatory"), task, minus_task)


@measure()
def error_delay(results: Results, task: str) -> Estimate:
    """Return the mean time of errors less that of correct responses, in units of their sd."""
    (table,), weights = aligned(results, task)
    made = table["rt_ms"].notna().to_numpy()
    right, rt = (table["correct"] == 1).to_numpy(), table["rt_ms"].fillna(0).to_numpy()
    wrong = made & ~right
    if wrong.sum() < FEWEST:
        raise NotApplicable(f"fewer than {FEWEST} errors")
    sd = np.sqrt(mean(rt**2, made, weights) - mean(rt, made, weights) ** 2)
    return Estimate.of(
        (mean(rt, wrong, weights) - mean(rt, made & right, weights)) / sd, made.sum()
    )


@measure()
def skewness(results: Results, task: str) -> Estimate:
    """Return (q90 - q50) / (q50 - q10) of the times of a task."""
    rt = results.tables.trials_of(task)["rt_ms"].dropna().to_numpy()
    if len(rt) < 100:
        raise NotApplicable("fewer than 100 responses")
    rng = stream(results.seed, "exam", "times")
    drawn = np.concatenate([rt[None], rng.choice(rt, (RESAMPLES, len(rt)))])
    low, middle, high = np.quantile(drawn, (0.1, 0.5, 0.9), axis=1)
    return Estimate.of((high - middle) / (middle - low), len(rt))


@measure(PROPORTION)
def respond_change(results: Results, task: str, minus_task: str) -> Estimate:
    """Return the share of stop trials with a response in one task less that in another."""
    return _change(results, _responded, task, minus_task)


def _responded(table: pd.DataFrame, weights: Array) -> Array:
    stop = table["ssd_ms"].notna().to_numpy()
    if not stop.any():
        raise NotApplicable("there are no stop trials")
    return mean(table["rt_ms"].notna().to_numpy(), stop, weights)


@measure("ms")
def failed_minus_go(results: Results, task: str) -> Estimate:
    """Return the mean time of failed stops less that of go responses, ms."""
    (table,), weights = aligned(results, task)
    stop, made = table["ssd_ms"].notna().to_numpy(), table["rt_ms"].notna().to_numpy()
    if (stop & made).sum() < FEWEST:
        raise NotApplicable(f"fewer than {FEWEST} failed stops")
    rt = table["rt_ms"].fillna(0).to_numpy()
    return Estimate.of(mean(rt, stop & made, weights) - mean(rt, made & ~stop, weights), len(table))


@measure("ms")
def ssrt_change(results: Results, task: str, minus_task: str) -> Estimate:
    """Return the stop-signal reaction time of one task less that of another, ms."""
    tables, _ = aligned(results, task, minus_task)
    count = len(tables[0])
    draws = stream(results.seed, "exam", "stops").integers(count, size=(FEW_RESAMPLES, count))
    rows = [np.arange(count), *draws]
    values = [_ssrt(tables[0].iloc[k]) - _ssrt(tables[1].iloc[k]) for k in rows]
    return Estimate.of(np.array(values), count)


def _ssrt(table: pd.DataFrame) -> float:
    """Return the stop-signal reaction time by integration at each delay, ms."""
    table = table[table["task"].notna()]
    if table["ssd_ms"].isna().all() or table["ssd_ms"].notna().all():
        raise NotApplicable("it needs go trials and stop trials")
    try:
        trials = StopTrials(table["rt_ms"].to_numpy(), table["ssd_ms"].to_numpy())
        return ssrt_by_delay(inhibition_function(trials))
    except InputError as error:
        raise NotApplicable(str(error)) from None


@measure("Hz")
def rate(results: Results, nucleus: str, window: str, task: str, role: str = "all") -> Estimate:
    """Return the mean rate of a nucleus in a window, Hz."""
    _check_hz(results, nucleus)
    values = results.tables.rates_of(task, nucleus, window, role)
    return _mean_of(values.to_numpy())


@measure("Hz")
def rate_change(
    results: Results,
    nucleus: str,
    window: str,
    task: str,
    role: str = "all",
    minus_window: str = "",
    minus_task: str = "",
    minus_role: str = "",
    unit: str = "Hz",
) -> Estimate:
    """Return a rate minus another, in Hz or percent; ``minus_`` arguments default to the same."""
    _check_hz(results, nucleus)
    new = results.tables.rates_of(task, nucleus, window, role)
    place = (minus_task or task, nucleus, minus_window or window, minus_role or role)
    old = results.tables.rates_of(*place)
    scale = 100 / float(old.mean()) if unit == "percent" and old.mean() else 1.0
    both = new.index.intersection(old.index)
    if len(both) >= 0.5 * min(len(new), len(old)):
        return _mean_of(scale * (new[both] - old[both]).to_numpy())
    one, other = _mean_of(scale * new.to_numpy()), _mean_of(scale * old.to_numpy())
    return Estimate(
        one.value - other.value, float(np.hypot(one.se, other.se)), one.trials + other.trials
    )


def _check_hz(results: Results, nucleus: str) -> None:
    if results.in_hz:
        check_cells(results, nucleus)


def check_cells(results: Results, nucleus: str) -> None:
    """Raise NotApplicable if the activity of a nucleus is not that of cells."""
    if nucleus in results.tables.abstract:
        raise NotApplicable(f"the activity of {nucleus} is abstract, not a rate of cells in Hz")


def _mean_of(values: Array) -> Estimate:
    if len(values) < FEWEST:
        raise NotApplicable(f"fewer than {FEWEST} trials or cells have such a rate")
    se = values.std(ddof=1) / np.sqrt(len(values))
    return Estimate(float(values.mean()), float(se), len(values))


@measure()
def hick_slope(results: Results, tasks: str) -> Estimate:
    """Return the slope of the mean times of tasks over the logarithm of their alternatives, ms."""
    names = [name.strip() for name in tasks.split(",")]
    x = np.log([results.tasks[name].channels for name in names])
    if not np.ptp(x):
        raise NotApplicable("a slope needs tasks with different numbers of alternatives")
    about = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
    total, variance, count = 0.0, 0.0, 0
    for name, weight in zip(names, about, strict=True):
        (table,), draws = aligned(results, name)
        one = Estimate.of(times(table, draws), len(table))
        total, variance = total + weight * one.value, variance + (weight * one.se) ** 2
        count += one.trials
    return Estimate(float(total), float(np.sqrt(variance)), count)
