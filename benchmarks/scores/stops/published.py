"""Rates of STN and SNr after stop signals on failed and on successful stops.

Schmidt et al. (2013), in rats: STN responds to stop signals on all trials, SNr only on successful
ones.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.scores.stops.runs import (
    evidence_of,
    model_of,
    stop_times,
)
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.circuit import receiving
from bgmodel.stopping.inputs import StopSignal, with_stop
from bgmodel.support.arrays import Array

SSD_MS = 300.0
WITHIN_MS = 150.0
"""Time after the signal over which rates are averaged."""


def rates(trials: int) -> pd.DataFrame:
    """Return the change of rates by a stop signal on failed and on successful stops.

    The change is that of the same trial with and without the signal, on the same noise: mean over
    channels and over ``WITHIN_MS`` after the signal.
    """
    evidence, model, signal = evidence_of("rates", trials), model_of(), StopSignal()
    failed = ~np.isnan(stop_times(model, evidence, SSD_MS, signal))
    given = with_stop(evidence, np.full(trials, SSD_MS), signal)
    stopped = receiving(model, signal)
    rows = []
    for nucleus in ("STN", "SNr"):
        change = _mean_hz(stopped, given, nucleus) - _mean_hz(model, evidence, nucleus)
        for name, which in (("failed stop", failed), ("successful stop", ~failed)):
            hz = change[which]
            row = {"nucleus": nucleus, "outcome": name, "trials": int(which.sum())}
            rows.append(row | {"change_hz": hz.mean(), "change_se": hz.std() / np.sqrt(len(hz))})
    return pd.DataFrame(rows)


def _mean_hz(model: BasalGanglia, evidence: Evidence, nucleus: str) -> Array:
    """Return the mean rate of a nucleus after the signal, per trial."""
    found = []
    for _, activity, _ in model.batches(evidence):
        since = activity.time_ms - SSD_MS
        shown = (since > 0) & (since <= WITHIN_MS)
        found.append(activity.rates_hz[nucleus][:, shown].mean(axis=(1, 2)))
    return np.concatenate(found)
