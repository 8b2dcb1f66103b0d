"""Stop signals that end: pause, then cancel, and the arkypallidal cells.

A pulse to STN postpones responses, because the evidence is still there when it ends. To stop, a
cancel must return the evidence to the prior before then (Schmidt & Berke 2017). Arkypallidal cells,
which inhibit striatum, are proposed to be what cancels (Mallet et al. 2016).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from benchmarks.scores.stops.runs import (
    evidence_of,
    go_times,
    model_of,
    nth,
    pulse,
    share,
    stop_times,
)
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.arkypallidal import NAME, with_arkypallidal
from bgmodel.stopping.inputs import StopSignal, with_onsets
from bgmodel.support.arrays import Array

SSD_MS = 250.0
CANCEL_MS = np.arange(50.0, 251.0, 50.0)
"""Times from the signal to the cancel."""
PAUSE_MS = np.arange(0.0, 251.0, 25.0)
"""Durations of the pause by STN."""
PAUSE_NATS, ARKY_NATS = 1.0, 2.0
"""Input to STN and to the arkypallidal cells."""
ARKY_LATER_MS = 40.0
"""Delay of the arkypallidal input behind that of STN, assumed."""
CASES: dict[str, tuple[StopSignal, ...]] = {
    "STN held": (StopSignal(),),
    "STN 100 ms": (pulse(100.0),),
    "Arky held": (StopSignal(NAME, ARKY_NATS),),
    "Arky 150 ms": (pulse(150.0, nucleus=NAME, amount_nats=ARKY_NATS),),
    "Arky held, 40 ms later": (StopSignal(NAME, ARKY_NATS, ARKY_LATER_MS),),
    "STN 100 ms, Arky held 40 ms later": (
        pulse(100.0), StopSignal(NAME, ARKY_NATS, ARKY_LATER_MS),
    ),
    "STN 100 ms, Arky 150 ms 40 ms later": (
        pulse(100.0), pulse(150.0, nucleus=NAME, amount_nats=ARKY_NATS, delay_ms=ARKY_LATER_MS),
    ),
    "STN 100 ms, cancel after 80 ms": (StopSignal(duration_ms=100.0, cancel_ms=80.0),),
    "Arky 150 ms, cancel after 80 ms": (
        StopSignal(NAME, ARKY_NATS, duration_ms=150.0, cancel_ms=80.0),
    ),
}  # fmt: skip
"""Signals in a circuit with arkypallidal cells, by name."""


def pauses(trials: int) -> pd.DataFrame:
    """Return p(respond) for each pause and time of the cancel; cancel_ms 0 is the floor."""
    evidence, model = evidence_of("pause", trials), model_of()
    rows = []
    for cancel in (0.0, *CANCEL_MS):
        for pause in PAUSE_MS if cancel else PAUSE_MS[:1]:
            nats, lasts = (PAUSE_NATS, pause) if pause else (0.0, np.inf)
            signal = StopSignal(amount_nats=nats, duration_ms=lasts, cancel_ms=cancel)
            times = stop_times(model, evidence, SSD_MS, signal)
            row = {"ssd_ms": SSD_MS, "cancel_ms": cancel, "pause_ms": pause, "trials": trials}
            rows.append(row | share(~np.isnan(times)))
    return pd.DataFrame(rows)


def with_signals(model: BasalGanglia, evidence: Evidence, signals: tuple[StopSignal, ...]) -> Array:
    """Return the response times of a circuit with several inputs in every trial."""
    names = [signal.nucleus for signal in signals]
    for signal in signals:
        onset = np.full(evidence.trials, SSD_MS + signal.delay_ms)
        evidence = with_onsets(evidence, onset, signal)
    return go_times(replace(model, circuit=model.circuit.with_inputs(*names)), evidence)


def arkypallidal(trials: int) -> pd.DataFrame:
    """Return what stop signals do in a circuit with arkypallidal cells."""
    evidence, plain = evidence_of("arkypallidal", trials), model_of()
    model = replace(plain, circuit=with_arkypallidal(plain.circuit))
    went = {"no signal": model, "no signal, without Arky": plain}
    every = {name: go_times(one, evidence) for name, one in went.items()}
    go = every["no signal"]
    every |= {name: with_signals(model, evidence, each) for name, each in CASES.items()}
    rows = []
    for name, times in every.items():
        made = ~np.isnan(times)
        p = float(made.mean())
        row = {"signal": name, "ssd_ms": SSD_MS, "trials": trials} | share(made)
        late = nth(go, p) - SSD_MS if name in CASES and p < 0.9 else np.nan
        rows.append(row | {"ssrt_ms": late, "mean_ms": float(times[made].mean())})
    return pd.DataFrame(rows)
