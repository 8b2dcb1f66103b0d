"""The two tables from which most numbers of the exam are computed: trials and rates.

A circuit of this package fills them by simulation (``simulation``), rates in the windows of a task;
those of another tool or of a recording are read from CSV files. The measures are the same.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.deciding.decision import UNDECIDED, first_crossing
from bgmodel.evidence import Evidence
from bgmodel.exam.numbers import ExamTask
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.checks import path_of
from bgmodel.trials.files import read_rows
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require

OF_TRIALS = {
    "task": "name of the task",
    "trial": "number of the trial; trials of two tasks with one number are compared as a pair",
    "rt_ms": "time from the onset of evidence, ms (or rt_s, s); empty without a response",
    "correct": "1 or 0; empty without a response",
    "anticipatory": "1 if the foreperiod ended in a response, otherwise 0",
    "ssd_ms": "stop-signal delay, ms (or ssd_s, s); empty in go trials",
    "deadline_ms": "when a trial without a response ended, ms (or deadline_s, s)",
}
"""Columns of the table of trials; ``task`` and a time are required."""
TIMES = ("rt", "ssd", "deadline")
"""Columns of times, each with its unit at the end of its name."""
OF_RATES = {
    "task": "name of the task",
    "trial": "number of the trial",
    "nucleus": "its name: MSN (or D1 and D2), FSI, STN, GPe, SNr (or GPi), ctx",
    "window": "rest, early, late, response or signal",
    "role": "chosen, other or all: whose channel; failed or successful after a stop signal",
    "rate_hz": "mean rate in the window, Hz (spikes per second and cell)",
}
"""Columns of the table of rates; all but ``trial`` and ``role`` are required.

A row may sum up trials: with ``trials``, their number, and ``sd_hz``, their standard deviation.
"""
ROLES = ("all", "chosen", "other", "failed", "successful")
WINDOWS = {
    "rest": "without evidence",
    "early": "100 to 300 ms after onset",
    "late": "300 to 500 ms after onset",
    "response": "100 ms before to 100 ms after the response",
    "signal": "150 ms from the arrival of a stop signal",
}
"""Windows of rates (those of Branam, Gold & Ding 2024, and of stop signals)."""
NAMES = {"MSN": ("MSN", "D1", "D2"), "SNr": ("SNr", "GPi")}
"""Names that a table may use for the rows of a nucleus; several are averaged."""
HIGHEST_HZ = 1000.0
"""No cell fires faster."""


def rows_of(nucleus: str, known: Container[str]) -> list[str]:
    """Return the rows of a nucleus that are known."""
    return [name for name in NAMES.get(nucleus, (nucleus,)) if name in known]


class NotApplicable(Exception):
    """The circuit or the tables lack what the number needs."""


class Failed(Exception):
    """The circuit lacks the behaviour that is measured: it never decides by evidence, say."""


@dataclass(frozen=True)
class Tables:
    """Trials and rates to be scored; rates of nuclei in ``abstract`` have a sign but no Hz."""

    trials: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(OF_TRIALS)))
    rates: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(OF_RATES)))
    abstract: frozenset[str] = frozenset()

    def trials_of(self, task: str) -> pd.DataFrame:
        """Return the trials of a task, indexed by their numbers."""
        trials = self.trials[self.trials["task"] == task]
        if trials.empty:
            raise NotApplicable(f"there are no trials of the task {task!r}")
        return trials.set_index("trial")

    def rates_of(self, task: str, nucleus: str, window: str, role: str) -> pd.Series:
        """Return the rate of a nucleus in each trial of a task, Hz, indexed by trial."""
        rates = self.rates
        names = rows_of(nucleus, set(rates["nucleus"]))
        if rates.empty or not names:
            raise NotApplicable(f"there are no rates of {nucleus}")
        here = rates[rates["nucleus"].isin(names) & (rates["task"] == task)]
        here = here[(here["window"] == window) & (here["role"] == role)].dropna(subset="rate_hz")
        if here.empty:
            raise NotApplicable(f"there are no rates of {nucleus}, {window}, {role}, task {task!r}")
        return here.groupby("trial")["rate_hz"].mean()


def read_tables(
    trials: str | Path | pd.DataFrame | None,
    rates: str | Path | pd.DataFrame | None,
    tasks: dict[str, ExamTask],
) -> Tables:
    """Read trials and rates that were recorded, or simulated by another tool."""
    if trials is None and rates is None:
        raise InputError("give a table of trials, of rates, or both", "trials")
    tables: dict[str, Any] = {}
    if trials is not None:
        tables["trials"] = _trials(_rows(trials, "trials"), tasks)
    if rates is not None:
        tables["rates"] = _rates(_rows(rates, "rates"), tasks)
    return Tables(**tables)


def _rows(source: str | Path | pd.DataFrame, field: str) -> pd.DataFrame:
    if isinstance(source, pd.DataFrame):
        return source.reset_index(drop=True)  # concatenated tables have the same index twice
    return read_rows(path_of(source, field)).copy()


def _trials(table: pd.DataFrame, tasks: dict[str, ExamTask]) -> pd.DataFrame:
    for name in TIMES:
        _in_ms(table, name)
    _known(table, "task", tuple(tasks))
    for name in ("correct", "anticipatory"):
        table[name] = _numbers(table, name) if name in table else np.nan
    for name in ("correct", "anticipatory"):
        coded = table[name].dropna().isin([0, 1])
        require(coded.all(), name, "must be 1 or 0, or empty", table[name].dropna()[~coded][:1])
    scored = table["correct"].notna() & table["rt_ms"].isna()
    must = "must be empty in trials without a response"
    require(not scored.any(), "correct", must, table["correct"][scored][:1])
    return _numbered(table, ["task"])[list(OF_TRIALS)]


def _in_ms(table: pd.DataFrame, time: str) -> None:
    """Give the table a column of times in ms, which is empty in trials without one."""
    name, in_s = f"{time}_ms", f"{time}_s"
    if in_s in table:
        require(name not in table, in_s, f"must not stand with {name}", "both")
        table[name] = 1000 * _numbers(table, in_s)
    elif time in table or name == "rt_ms":
        _needs_unit(table, time, name, f"{name} or {in_s}")
    table[name] = _numbers(table, name) if name in table else np.nan
    values = table[name].dropna()
    fits = np.isfinite(values) & ((values >= 0) if time == "ssd" else (values > 0))
    must = f"must be finite and {'>= 0' if time == 'ssd' else '> 0'}, or empty"
    require(fits.all(), name, must, values[~fits][:1])
    if 0 < values.max() < 10:
        DataWarning.warn(
            f"{name} is at most {values.max():g}: name the column {in_s} if it is in s"
        )


def _rates(table: pd.DataFrame, tasks: dict[str, ExamTask]) -> pd.DataFrame:
    _needs_unit(table, "rate", "rate_hz", "rate_hz")
    table["role"] = table.get("role", "all")
    _known(table, "task", tuple(tasks))
    _known(table, "window", tuple(WINDOWS))
    _known(table, "role", ROLES)
    require("nucleus" in table, "nucleus", "must be a column of the rates", list(table))
    table["rate_hz"] = _numbers(table, "rate_hz")
    rate = table["rate_hz"].dropna()
    fits = (rate >= 0) & (rate <= HIGHEST_HZ)
    require(fits.all(), "rate_hz", f"must be within 0..{HIGHEST_HZ:g} Hz", rate[~fits][:1])
    if {"sd_hz", "trials"} & set(table):
        table = _trials_of_summaries(table)
    return _numbered(table, ["task", "nucleus", "window", "role"], "nucleus")[list(OF_RATES)]


def _trials_of_summaries(table: pd.DataFrame) -> pd.DataFrame:
    """Return two rates for every two trials that a row sums up, with its mean and its sd."""
    for name in ("sd_hz", "trials"):
        require(name in table, name, "must go with the other of sd_hz and trials", list(table))
        table[name] = _numbers(table, name)
    few = ~((table["trials"] >= 2) & (table["trials"] % 1 == 0))
    require(not few.any(), "trials", "must be whole numbers, 2 or more", table["trials"][few][:1])
    negative = ~(table["sd_hz"] >= 0)
    require(not negative.any(), "sd_hz", "must be 0 or more", table["sd_hz"][negative][:1])
    require("trial" not in table, "trial", "must not stand with sd_hz and trials", "both")
    pairs = (table["trials"] // 2).astype(int)
    each = table.loc[table.index.repeat(2 * pairs)].reset_index(drop=True)
    # The sample's sd of equally many values above and below the mean is sqrt(n / (n - 1)) as large.
    away = each["sd_hz"] * np.sqrt(1 - 1 / (2 * (each["trials"] // 2)))
    return each.assign(rate_hz=each["rate_hz"] + away * np.where(each.index % 2, 1, -1))


def _needs_unit(table: pd.DataFrame, bare: str, name: str, allowed: str) -> None:
    """Refuse a table without the column, naming the unit if only that is missing."""
    if name in table:
        return
    problem = f"the column {bare} has no unit" if bare in table else f"there is no column {name}"
    raise InputError(f"{problem}: name it {allowed}", name)


def _known(table: pd.DataFrame, name: str, allowed: tuple[str, ...]) -> None:
    require(name in table, name, "must be a column of the table", list(table))
    unknown = sorted(set(table[name].astype(str)) - set(allowed))
    require(not unknown, name, f"must be one of {', '.join(allowed)}", unknown[:3])
    table[name] = table[name].astype(str)


def _numbers(table: pd.DataFrame, name: str) -> pd.Series:
    try:
        return pd.to_numeric(table[name]).astype(float)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name} must hold numbers: {error}", name) from None


def _numbered(table: pd.DataFrame, by: list[str], pooled: str = "") -> pd.DataFrame:
    """Return the table with numbers of trials, each once.

    Without a column of them, rows are numbered in their order, and no two samples share a number,
    so that none are compared as pairs; the nuclei of a sample, the ``pooled`` column, share them.
    """
    if "trial" not in table:
        sample = table.groupby([name for name in by if name != pooled]).ngroup()
        return table.assign(trial=sample * len(table) + table.groupby(by).cumcount())
    numbers = pd.to_numeric(table["trial"], errors="coerce")
    if numbers.notna().all():  # a file holds them as text, which has another order
        table["trial"] = numbers
    twice = table.duplicated([*by, "trial"])
    require(not twice.any(), "trial", "must occur once in each task", table["trial"][twice][:1])
    return table


REST_MS = 300.0
STOP_NATS, STOP_DELAY_MS, SIGNAL_MS = 1.0, 60.0, 150.0
"""Input to STN by a stop signal and its delay (assumed), and the window of rates after it."""


def rest_rows(task: ExamTask, model: BasalGanglia, count: int) -> pd.DataFrame:
    """Return the rates without evidence or courses, for which a circuit needs no threshold."""
    model = replace(model, circuit=model.circuit.steady)
    silence = np.zeros((count, 1, task.channels))
    activity = model.run_drive(silence, REST_MS)
    parts = [
        _in_window(task, 0, nucleus, "rest", "all", np.asarray(values, float).mean(axis=(1, 2)))
        for nucleus, values in activity.rates_hz.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _in_window(
    task: ExamTask, first: int, nucleus: str, window: str, role: str, rate_hz: Array
) -> pd.DataFrame:
    columns = {"task": task.id, "trial": first + np.arange(len(rate_hz)), "nucleus": nucleus}
    columns |= {"window": window, "role": role, "rate_hz": rate_hz}
    return pd.DataFrame(columns)[list(OF_RATES)]


def rate_rows(
    task: ExamTask, model: BasalGanglia, evidence: Evidence, level: float
) -> Iterator[pd.DataFrame]:
    """Yield rates in the windows of a task, in batches of trials."""
    first = 0
    for part, activity, trace in model.batches(evidence):
        made = first_crossing(trace, level, forced=False, checked=False)
        for window in task.windows:
            inside = _inside(window, activity.time_ms, made.time_ms, task)
            for nucleus, values in activity.rates_hz.items():
                means = _means(np.asarray(values, float), inside)
                roles = _roles(window, means, made.choice, bool(task.stop_share))
                for role, each in roles.items():
                    yield _in_window(task, first, nucleus, window, role, each)
        first += part.trials


def _inside(window: str, time_ms: Array, response_ms: Array, task: ExamTask) -> Truths:
    """Return which samples are within a window, (trials, ticks); none if it is not complete."""
    response = response_ms[:, None]
    signal = (task.stop_delays_ms or (np.nan,))[0] + STOP_DELAY_MS
    ends: dict[str, tuple[float | Array, float | Array]] = {
        "early": (100.0, 300.0),
        "late": (300.0, 500.0),
        "response": (response - 100.0, response + 100.0),
        "signal": (signal, signal + SIGNAL_MS),
    }
    low, high = ends[window]
    inside = (time_ms > low) & (time_ms <= high) & (low >= 0) & (high <= time_ms[-1])
    return np.broadcast_to(inside, (len(response), len(time_ms)))


def _means(values: Array, inside: Truths) -> Array:
    """Return mean rates within a window, (trials, channels); NaN without a sample."""
    count = inside.sum(axis=1)
    total = np.einsum("ktc,kt->kc", values, inside.astype(float))
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)


def _roles(window: str, means: Array, choice: Integers, stop: bool) -> dict[str, Array]:
    """Return the mean over channels, and those of the chosen and of the other alternatives."""
    by_role = {"all": means.mean(axis=1)}
    made = choice != UNDECIDED
    if window == "signal" and stop:
        by_role["failed"] = np.where(made, by_role["all"], np.nan)
        by_role["successful"] = np.where(made, np.nan, by_role["all"])
    elif window != "signal" and means.shape[1] > 1:
        chosen = means[np.arange(len(means)), np.maximum(choice, 0)]
        others = (means.sum(axis=1) - chosen) / (means.shape[1] - 1)
        by_role["chosen"] = np.where(made, chosen, np.nan)
        by_role["other"] = np.where(made, others, np.nan)
    return by_role
