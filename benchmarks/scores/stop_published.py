"""What published results on stopping say about lesions of STN and rates of SNr, in the circuit.

Eagle et al. (2008): after lesions of STN rats respond earlier and stop less often at all delays, at
an unchanged stop-signal reaction time. Schmidt et al. (2013): STN responds to stop signals on all
trials, SNr only on successful ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from benchmarks.scores.stop_runs import (
    POSTERIOR,
    evidence_of,
    go_times,
    model_of,
    nth,
    share,
    standard_error,
    stop_times,
)
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.circuit import receiving
from bgmodel.stopping.inputs import StopSignal, with_stop
from bgmodel.support.arrays import Array
from circuits.anatomy import DEFAULT, load_circuit

SSD_MS = 300.0
WITHIN_MS = 150.0
"""Time after the signal over which rates are averaged."""


def lesioned(trials: int) -> pd.DataFrame:
    """Return go times and stopping after losses of STN, at the intact circuit's threshold."""
    evidence, intact = evidence_of("lesioned", trials), load_circuit(DEFAULT)
    level = model_of().threshold(None, POSTERIOR)
    states = {
        "intact": intact,
        "STN 10 %, acute": intact.lesion("STN", 0.1),
        "STN 50 %, recovered": intact.lesion("STN", 0.5).compensate(),
    }
    rows = []
    for name, circuit in states.items():
        model = replace(model_of(), circuit=circuit)
        went = go_times(model, evidence, level)
        p = share(~np.isnan(stop_times(model, evidence, SSD_MS, StopSignal(), level)))
        row = {"state": name, "ssd_ms": SSD_MS, "trials": trials, "go_ms": np.nanmean(went)}
        row |= {"go_se": standard_error(went)} | p
        rows.append(row | {"ssrt_ms": nth(went, p["p_respond"]) - SSD_MS})
    return pd.DataFrame(rows)


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
