"""Simulated observers: choices and response times of a model on given readings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import LEAK, KnownModel
from bgmodel.fitting.known.trials import KnownTrials, waiting
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
    return likelihood.observed(every | {LEAK.name: 0.0, "lapse": 0.0, **values}, rng)
