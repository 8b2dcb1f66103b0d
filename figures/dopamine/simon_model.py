"""The default circuit in a Simon task, as simulated people with as many trials as real ones.

The colour is Gaussian evidence for the correct side, one reading every 10 ms. The location is read
automatically: it excites the channel of its side, early in the trial and without being evidence for
the correct response. In a ``pulse`` this input persists, as evidence does; if it is ``fading`` it
peaks after 100 ms and vanishes (Ulrich et al. 2015, with shape 2 and a time constant of 100 ms); if
it is ``brief``, it does so after 30 ms. The last one was added after people had been analysed. In
the test the mean of the same readings is proportional to the difference of two values.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.deciding.decision import UNDECIDED, Decision, first_crossing
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import threshold_from_posterior
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import load_circuit
from circuits.arrays import Array

CIRCUIT = "macaque_small"
"""The circuit with which the predictions were made, before the analysis."""
STEP_MS = 10.0
STEPS, TEST_STEPS = 60, 300
"""Readings of a trial in training, which lasts until the deadline, and in the test."""
DEADLINE_MS = 800.0
"""Deadline of training in most sessions."""
LOCATION_MS = {"pulse": 100.0, "fading": 100.0, "brief": 30.0}
"""Duration of the pulse, and times at which the other courses peak, ms."""
TRAINING, TEST = 376, 192
"""Trials of a simulated person."""
PAIRS = [one + other for one in "ABCD" for other in "ABCD" if one != other]
APART = {"AB": 0.5, "AC": 0.5, "BD": 0.5, "CD": 0.5, "AD": 1.0, "BC": 0.0}
"""Difference of value by pair of items."""


@dataclass(frozen=True)
class Simon:
    """Parameters of the task in the circuit.

    Parameters
    ----------
    d_prime : float
        d' of a reading of the colour.
    location_nats : float
        Largest input to the channel of the location, nats of evidence.
    posterior : float
        Stopping posterior, in the circuit's nats.
    value : float
        Mean of a reading in the test with a difference of value of 1, relative to that of colour.
    t0_ms : float
        Time outside the circuit.
    kind : str
        Course of the location's input, pulse, fading or brief.
    """

    d_prime: float
    location_nats: float
    posterior: float
    value: float
    t0_ms: float
    kind: Literal["pulse", "fading", "brief"]


def location_course(kind: str, steps: int) -> Array:
    """Return the location's input at the end of each reading, (steps,), with a maximum of 1."""
    time = STEP_MS * np.arange(1, steps + 1) / LOCATION_MS[kind]
    course: Array = np.minimum(time, 1.0) if kind == "pulse" else time * np.exp(1 - time)
    return course


def colour(simon: Simon, trials: int, seed: int) -> tuple[Evidence, Array]:
    """Return the evidence of training, and whether each trial is congruent, (trials,) bool."""
    evidence = gaussian_evidence(
        trials, d_prime=simon.d_prime, t_max=STEPS, step_ms=STEP_MS, seed=stream(seed, "training")
    )
    congruent = np.arange(trials) // 2 % 2 == 0
    truth = np.asarray(evidence.truth)
    side = np.where(congruent, truth, 1 - truth)
    added = np.diff(simon.location_nats * location_course(simon.kind, STEPS), prepend=0.0)
    readings = evidence.log_likelihood.copy()
    readings[np.arange(trials), :, side] += added
    return replace(evidence, log_likelihood=readings), congruent


def items(simon: Simon, trials: int, seed: int) -> tuple[Evidence, list[str]]:
    """Return the evidence of the test, with channel 0 for the better item, and the pairs."""
    pairs = [PAIRS[k % len(PAIRS)] for k in range(trials)]
    strength = simon.value * np.array([APART["".join(sorted(pair))] for pair in pairs])
    separation = simon.d_prime / np.sqrt(2)
    samples = stream(seed, "test").standard_normal((trials, TEST_STEPS, 2))
    samples[:, :, 0] += separation * strength[:, None]
    truth = np.zeros(trials, dtype=int)
    return Evidence(separation * samples, truth, step_ms=STEP_MS, baseline=0.0), pairs


def circuit_at(dopamine: float, seed: int) -> BasalGanglia:
    """Return the default circuit by populations at a level of dopamine."""
    return BasalGanglia(load_circuit(CIRCUIT, 2).dopamine(dopamine), "population", seed=seed)


def crossings(model: BasalGanglia, evidence: Evidence, levels: Array) -> tuple[Array, Array]:
    """Return choices and times, ms, (levels, trials), at thresholds on OUT, from one run."""
    parts = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _, _, trace in model.batches(evidence):
            made = first_crossing(trace, levels, forced=False, checked=False)
            parts.append((made.choice, made.time_ms))
    choice, time_ms = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    return choice, time_ms


def simulated(
    simon: Simon, dopamine: float, people: int, seed: int, *, tested: bool = True
) -> pd.DataFrame:
    """Return the trials of simulated people, with the columns of the shipped set.

    The evidence and the noise are the same at every level of dopamine. The test follows the
    training if ``tested``.
    """
    model = circuit_at(dopamine, seed)
    level = float(threshold_from_posterior(simon.posterior, 2))
    evidence, congruent = colour(simon, people * TRAINING, seed)
    training = _rows(model.decided(evidence, level, forced=False), simon.t0_ms, DEADLINE_MS)
    training["congruency"] = np.where(congruent, "congruent", "incongruent")
    parts = {"training": (training, TRAINING)}
    if tested:
        shown, pairs = items(simon, people * TEST, seed)
        test = _rows(model.decided(shown, level, forced=False), simon.t0_ms, np.inf)
        parts["test"] = (test.assign(pair=pairs), TEST)
    tables = [
        part.assign(phase=name, participant_id=np.repeat(np.arange(people), each))
        for name, (part, each) in parts.items()
    ]
    every = pd.concat([*tables, pd.DataFrame(columns=["pair"])], ignore_index=True)
    return every.fillna({"congruency": "none", "pair": "none"})


def _rows(decision: Decision, t0_ms: float, deadline_ms: float) -> pd.DataFrame:
    """Return rt, s, and response (1 correct, 0 error), empty after the deadline."""
    assert decision.truth is not None
    rt = t0_ms + decision.time_ms
    late = (decision.choice == UNDECIDED) | ~(rt <= deadline_ms)
    right = (decision.choice == decision.truth).astype(float)
    return pd.DataFrame(
        {"rt": np.where(late, np.nan, rt / 1000), "response": np.where(late, np.nan, right)}
    )
