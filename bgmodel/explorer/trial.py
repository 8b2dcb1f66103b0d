"""One trial of a circuit in spikes, until it decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.conditions import Observed
from bgmodel.deciding.decision import first_crossing
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import ROUNDING_NATS, BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.names import EngineName
from bgmodel.support.arrays import Array
from circuits.declaration.courses import Course
from circuits.declaration.table import NATS

SPIKES, WITHOUT_SPIKES = EngineName("ensemble"), EngineName("rate")
"""Engines of the trial: spiking cells, or rates for a circuit without any."""
WITHOUT_EVIDENCE = "decides without evidence"
"""Label of a trial that is decided before its first reading."""


@dataclass(frozen=True)
class Shown:
    """One trial up to its decision: OUT and rates (ticks, channels), spikes, and the MSPRT's -ln P.

    ``test`` is the times and -ln P at the circuit's gain, or None for a circuit whose unit is not
    nats. ``lost`` is the reason why a nucleus has no active cells: "silenced" or "clamped".
    ``courses`` are the changes of input and dopamine that begin before the end.
    """

    time_ms: Array
    rates_hz: Mapping[str, npt.NDArray[np.floating]]
    out: npt.NDArray[np.floating]
    spikes: Mapping[str, pd.DataFrame]
    test: tuple[Array, Array] | None
    threshold: float
    unit: str
    choice: int
    truth: int
    decided_ms: float
    premature: bool = False
    lost: Mapping[str, str] = field(default_factory=dict)
    courses: tuple[Course, ...] = ()

    @property
    def start_ms(self) -> float:
        """Where the time axis begins, ms."""
        return min(0.0, float(self.time_ms[0]))

    @property
    def end_ms(self) -> float:
        """Where the time axis ends, ms."""
        return float(self.time_ms[-1])

    def sentence(self) -> str:
        """Return the decision as a sentence."""
        if self.choice < 0:
            return f"No decision within {self.end_ms:.0f} ms; alternative {self.truth} is true."
        right = "correct" if self.choice == self.truth else f"an error: {self.truth} is true"
        early = f", before the first reading: it {WITHOUT_EVIDENCE}" if self.premature else ""
        return f"Chose alternative {self.choice} ({right}) after {self.decided_ms:.0f} ms{early}."


def one_trial(condition: Observed, evidence: Evidence, trial: int) -> Shown:
    """Run a trial of a condition, without a stop signal."""
    spiking = [row.name for row in condition.edited.populations if row.spiking]
    engine = SPIKES if spiking else WITHOUT_SPIKES
    model = replace(condition, engine=engine).model(evidence.hypotheses).adapted_to(evidence)
    model = replace(model, engine=model.engine.recording(tuple(spiking)))
    level = condition.threshold_at(evidence.hypotheses)
    until = model.until(level - ROUNDING_NATS, rates=True)
    one = evidence[trial : trial + 1]
    activity = until.activity(one, trial, checked=False)
    trace = until.trace(activity, one)
    decision = first_crossing(trace, level, forced=False, checked=False)
    time_ms = np.asarray(trace.time_ms)
    decided_ms = float(decision.time_ms[0])
    kept = time_ms <= decided_ms if np.isfinite(decided_ms) else np.ones_like(time_ms, np.bool_)
    last_ms = float(time_ms[kept][-1])
    spikes = {
        name: rows[(rows["time_ms"] >= min(0.0, time_ms[0])) & (rows["time_ms"] <= last_ms)]
        for name, rows in (activity.spikes or {}).items()
    }
    truth = one.truth
    return Shown(
        time_ms=time_ms[kept],
        rates_hz={name: rates[0][kept] for name, rates in activity.rates_hz.items()},
        out=np.asarray(trace.out_nats[0])[kept],
        spikes=spikes,
        test=_ideal(model, one, last_ms),
        threshold=level,
        unit=model.circuit.unit,
        choice=int(decision.choice[0]),
        truth=-1 if truth is None else int(truth[0]),
        decided_ms=decided_ms,
        premature=bool(decision.premature[0]),
        lost={
            row.name: "clamped" if row.clamped else "silenced"
            for row in model.circuit.populations
            if not model.circuit.intact_of(row.name).any()
        },
        courses=tuple(row for row in model.circuit.courses if row.from_ms < last_ms),
    )


def _ideal(model: BasalGanglia, one: Evidence, last_ms: float) -> tuple[Array, Array] | None:
    """Return the step function -ln P of the MSPRT up to a time; None if the unit is not nats."""
    if model.circuit.unit != NATS:
        return None
    trace = Msprt(model.gain).run(one)
    time_ms = np.asarray(trace.time_ms)
    steps = np.repeat(time_ms, 2)[1:], np.repeat(np.asarray(trace.out_nats[0]), 2, axis=0)[:-1]
    kept = steps[0] <= last_ms
    return steps[0][kept], steps[1][kept]
