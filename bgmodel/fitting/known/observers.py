"""Simulated observers: choices and response times of a model on given readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import LEAK, KnownModel
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream
from bgmodel.trials.readings import Readings


def readings_from(evidence: Evidence, names: tuple[str, ...] | None = None) -> Readings:
    """Return the readings of some evidence; reading k comes at ``onset_ms + k step_ms``."""
    steps = np.arange(evidence.steps)
    time_s = (evidence.onset_ms + evidence.step_ms * (steps + 1.0)) / 1000
    return Readings(
        [("", str(k)) for k in range(evidence.trials)],
        np.asarray(evidence.log_likelihood, dtype=np.float64),
        np.where(steps < evidence.readings[:, None], time_s, np.inf),
        np.asarray(evidence.readings),
        names or tuple(str(k) for k in range(evidence.hypotheses)),
    )


def observed(
    model: KnownModel,
    readings: Readings,
    values: Mapping[str, float],
    seed: int,
    *,
    forced: bool = True,
) -> KnownTrials:
    """Return choices and response times of a model; by default there are no lapses."""
    blank, rng = waiting(readings, forced), stream(seed, "known evidence", model.name)
    likelihood = known_likelihood(model, blank)
    every = {each.name: each.start for each in likelihood.freedom.parameters}
    every |= {LEAK.name: 0.0, "lapse": 0.0, **values}
    decided = np.zeros(blank.log_likelihood.shape)
    decided[blank.seen_places] = likelihood.decisions(every)[0]
    flat = np.cumsum(decided.reshape(len(decided), -1), axis=1)
    at = (flat < rng.random(len(flat))[:, None]).sum(axis=1)
    none = at >= flat.shape[1]
    reading, choice = np.divmod(np.minimum(at, flat.shape[1] - 1), len(readings.names))
    when = np.where(none, np.nan, blank.time_s[np.arange(len(at)), reading])
    return responding(blank, np.where(none, -1, choice), when, every, rng)


def waiting(readings: Readings, forced: bool = True) -> KnownTrials:
    """Return trials without responses; whether the last reading forces one is ``forced``."""
    count = len(readings.ids)
    return KnownTrials(
        readings.log_likelihood, readings.time_s, readings.lengths, readings.names,
        np.full(count, -1), np.full(count, np.nan), tuple(trial for _, trial in readings.ids),
        forced, "simulated",
    )  # fmt: skip


def responding(
    trials: KnownTrials,
    choice: Integers,
    decided_s: Array,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> KnownTrials:
    """Return trials with responses: decisions with non-decision times, and lapses.

    Without a decision ``choice`` is -1 and ``decided_s`` NaN.
    """
    delay = values["t0_s"] + values["t0_sd_s"] * rng.standard_normal(len(choice))
    rt_s = decided_s + np.maximum(delay, 0.001)
    lapsed = rng.random(len(choice)) < values["lapse"]
    rt_s = np.where(lapsed, np.nanmax(rt_s) * rng.uniform(0.001, 1.0, len(choice)), rt_s)
    guess = rng.integers(trials.alternatives, size=len(choice))
    choice = np.where(lapsed, guess, choice).astype(np.int64)
    return replace(trials, choice=choice, rt_s=rt_s)
