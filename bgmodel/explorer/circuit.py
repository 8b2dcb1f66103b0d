"""The circuit as the explorer shows it: its rows, the edits made by their fields, and one trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.conditions import Observed
from bgmodel.deciding.decision import first_crossing
from bgmodel.evidence import Evidence
from bgmodel.explorer.state import ExplorerState
from bgmodel.integrators.basal_ganglia import ROUNDING_NATS, BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.names import EngineName
from circuits.arrays import Array
from circuits.declaration.courses import Course
from circuits.declaration.edits import VERBS, Edit
from circuits.declaration.row_edits import NAMES, OF_CELL
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import NATS

SPIKES, WITHOUT_SPIKES = EngineName("spikes"), EngineName("rate")
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
    spiking = condition.edited.spiking()
    engine = SPIKES if spiking else WITHOUT_SPIKES
    model = replace(condition, engine=engine).model(evidence.hypotheses).adapted_to(evidence)
    model = replace(model, engine=model.engine.recording(spiking))
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


EXAMPLES = {
    **{kind.example: f"{verb}: {kind.about}" for verb, kind in VERBS.items()},
    "add dopamine amount=0.2 to_ms=300": "course: more dopamine during part of each trial",
    "add STN amount=0.5 from_ms=100": "course: more input to a nucleus from a time on",
    "add D2[0] amount=-2 from_ms=200 to_ms=400": "course: light on one channel of a nucleus",
    "add urgency": "motif: OUT falls with time, as a criterion does",
    "add onset_transient": "motif: a burst of all cortex at the onset of the evidence",
}
"""Example edits and their effects."""
NEUTRAL = {"lesion": 0.0, "cut": 0.0, "scale": 1.0}
"""Verbs with a field for the chosen row, and the number at which there is no edit."""


def names(state: ExplorerState) -> dict[str, list[str]]:
    """Return the names of nuclei and of pathways of the edited circuit."""
    circuit = state.circuit
    return {
        "Nuclei": [row.name for row in circuit.populations],
        "Pathways": [row.name for row in circuit.projections],
    }


def values(row: Population | Projection) -> dict[str, str]:
    """Return the fields of a row that edits can set, with their values as text."""
    record = {f.name: getattr(row, f.name) for f in fields(row) if f.name not in NAMES}
    cell = record.pop("cell", None)
    if cell is not None:
        record["cell"] = type(cell).__name__
        record |= {OF_CELL + f.name: getattr(cell, f.name) for f in fields(cell)}
    return {name: _text(value) for name, value in record.items()}


def _text(value: object) -> str:
    """Return a value in the notation of an edit."""
    if isinstance(value, tuple):
        return ",".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def table(state: ExplorerState, name: str) -> pd.DataFrame:
    """Return the fields of a row as a table, with the control's values where they differ."""
    control = state.control
    before = values(control.row(name)) if name in control else {}
    rows = []
    for key, value in values(state.circuit.row(name)).items():
        old = before.get(key)
        if old != value or value not in ("", "0", "1", "False"):
            rows.append((key, value, "" if old == value else old or "none"))
    return pd.DataFrame(rows, columns=["Field", "Value", "Control"])


def amount(state: ExplorerState, verb: str, name: str) -> float:
    """Return the size of the edit of a row by a verb: per cent lost, or a factor."""
    edit = _of(state, verb, name)
    if edit is None:
        return NEUTRAL[verb]
    return float(edit.value) * (1 if verb == "scale" else 100)


def with_amount(state: ExplorerState, verb: str, name: str, number: float | None) -> ExplorerState:
    """Return the state with a lesion, a cut or a scaling of a row.

    The neutral number, and None for an empty field, remove the edit.
    """
    if number is None or number == NEUTRAL[verb]:
        edit = _of(state, verb, name)
        return state if edit is None else state.without(edit.text)
    return state.edited(f"{verb} {name} {number:.12g}{'' if verb == 'scale' else '%'}")


def _of(state: ExplorerState, verb: str, name: str) -> Edit | None:
    """Return the edit of a row, in all channels, by a verb."""
    edits = (edit for edit in state.edits.of(verb) if edit.row == name and edit.channel is None)
    return next(edits, None)


def dopamine(state: ExplorerState) -> float:
    """Return the dopamine level set by an edit, or 1."""
    edits = state.edits.of("dopamine")
    return float(edits[0].value) if edits else 1.0


def with_dopamine(state: ExplorerState, level: float | None) -> ExplorerState:
    """Return the state at a dopamine level; 1 and None remove the edit."""
    if level is None or level == 1:
        return state.without(*(edit.text for edit in state.edits.of("dopamine")))
    return state.edited(f"dopamine {level:.12g}")
