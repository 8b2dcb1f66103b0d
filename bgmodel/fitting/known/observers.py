"""Simulated observers: choices and response times of a model on given readings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.fitting.known.accumulation import leaky_sums, runs_of_cues
from bgmodel.fitting.known.likelihood import BIAS, RUN, URGENCY
from bgmodel.fitting.known.models import LeakySum, Runs, Test
from bgmodel.fitting.known.table import Readings
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.fitting.parameters import RESPONSE
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream


def readings_from(evidence: Evidence, names: tuple[str, ...] | None = None) -> Readings:
    """Return the readings of all trials of some evidence.

    Parameters
    ----------
    evidence : Evidence
        The readings; reading k comes at ``onset_ms + k step_ms``.
    names : tuple of str, optional
        Names of the alternatives; "0", "1", ... by default.
    """
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
    model: Test | LeakySum | Runs,
    readings: Readings,
    values: Mapping[str, float],
    seed: int,
    *,
    forced: bool = True,
) -> KnownTrials:
    """Return choices and response times of a model.

    Parameters
    ----------
    model : Test, LeakySum or Runs
        The model.
    readings : Readings
        The readings of each trial.
    values : mapping from names to numbers
        Its parameters; those left out are 0 (the gain: 1).
    seed : int
        Seed of noise, non-decision times and lapses.
    forced : bool
        Whether the last reading forces a response.
    """
    # Importing Numba takes most of a second: only when it is used.
    from bgmodel.fitting.known.hazard import decisions

    every = {"gain": 1.0, "leak_hz": 0.0, URGENCY.name: 0.0, RUN.name: 0.0, **values}
    likely, time_s = readings.log_likelihood, readings.time_s
    read = np.arange(time_s.shape[1]) < readings.lengths[:, None]
    runs = runs_of_cues(likely)
    state = leaky_sums(likely, time_s, every["leak_hz"]) if model.sums else runs
    out = model.of(state, every) - every[RUN.name] * np.maximum(runs - 1, 0)
    level = model.sign * every["threshold"] + every[URGENCY.name] * time_s[read]
    bias = np.array([0.0, *(every.get(f"{BIAS}{name}", 0.0) for name in readings.names[1:])])
    offsets = np.concatenate([[0], np.cumsum(readings.lengths)])
    ends = np.full(len(likely), forced)
    found, _ = decisions(out[read][None], level, bias, every["noise"], offsets, ends)
    decided = np.zeros(out.shape)
    decided[read] = found
    rng = stream(seed, "known evidence", model.name)
    flat = np.cumsum(decided.reshape(len(decided), -1), axis=1)
    at = (flat < rng.random(len(flat))[:, None]).sum(axis=1)
    none = at >= flat.shape[1]
    reading, choice = np.divmod(np.minimum(at, flat.shape[1] - 1), len(readings.names))
    when = np.where(read, time_s, 0.0)[np.arange(len(at)), reading]
    return responding(
        readings, np.where(none, -1, choice), np.where(none, np.nan, when), every, rng, forced
    )


def observed_circuit(
    model: BasalGanglia,
    evidence: Evidence,
    values: Mapping[str, float],
    seed: int,
    *,
    first_trial: int = 0,
) -> KnownTrials:
    """Return choices and response times of a circuit that decides where its OUT first crosses.

    Parameters
    ----------
    model : BasalGanglia
        The circuit, its engine, gain and noise.
    evidence : Evidence
        The readings; the last one forces a response.
    values : mapping from names to numbers
        The threshold, and the parameters of responses.
    seed : int
        Seed of non-decision times and lapses.
    first_trial : int
        Number of the first trial, which selects the circuit's noise.
    """
    decision = model.decided(evidence, values["threshold"], first_trial=first_trial)
    rng = stream(seed, "known evidence", model.circuit.name)
    readings = readings_from(evidence)
    return responding(readings, decision.choice, decision.time_ms / 1000, values, rng, True)


def responding(
    readings: Readings,
    choice: Integers,
    decided_s: Array,
    values: Mapping[str, float],
    rng: np.random.Generator,
    forced: bool,
) -> KnownTrials:
    """Return trials with non-decision times and lapses added to decisions.

    Parameters
    ----------
    readings : Readings
        The readings.
    choice, decided_s : arrays (trials,)
        The decisions; -1 and NaN without one.
    values : mapping from names to numbers
        t0_s, t0_sd_s and lapse; by default those of ``RESPONSE``, and no lapses.
    rng : Generator
        Random numbers.
    forced : bool
        As in ``KnownTrials``.
    """
    start = {each.name: each.start for each in RESPONSE} | {"lapse": 0.0} | dict(values)
    delay = start["t0_s"] + start["t0_sd_s"] * rng.standard_normal(len(choice))
    rt_s = decided_s + np.maximum(delay, 0.001)
    lapsed = rng.random(len(choice)) < start["lapse"]
    rt_s = np.where(lapsed, np.nanmax(rt_s) * rng.uniform(0.001, 1.0, len(choice)), rt_s)
    guess = rng.integers(len(readings.names), size=len(choice))
    return KnownTrials(
        readings.log_likelihood, readings.time_s, readings.lengths, readings.names,
        np.where(lapsed, guess, choice).astype(np.int64), rt_s,
        tuple(trial for _, trial in readings.ids), forced, "simulated",
    )  # fmt: skip
