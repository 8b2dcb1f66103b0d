"""Rates of nuclei in the windows of a task, trial by trial."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from bgmodel.deciding.decision import UNDECIDED, first_crossing
from bgmodel.evidence import Evidence
from bgmodel.exam.numbers import ExamTask
from bgmodel.exam.tables import OF_RATES
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.arrays import Array, Integers, Truths

REST_MS = 300.0
STOP_NATS, STOP_DELAY_MS, SIGNAL_MS = 1.0, 60.0, 150.0
"""Input to STN by a stop signal and its delay (assumed), and the window of rates after it."""


def rest_rows(task: ExamTask, model: BasalGanglia, count: int) -> pd.DataFrame:
    """Return the rates without evidence or courses, for which a circuit needs no threshold."""
    model = replace(model, circuit=model.circuit.steady)
    silence = np.zeros((count, 1, task.channels))
    activity = model.run_drive(silence, REST_MS)
    parts = [
        _rows(task, 0, nucleus, "rest", "all", np.asarray(values, float).mean(axis=(1, 2)))
        for nucleus, values in activity.rates_hz.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _rows(
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
                    yield _rows(task, first, nucleus, window, role, each)
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
