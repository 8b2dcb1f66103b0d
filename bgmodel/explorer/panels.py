"""The explorer's panels as records: each contains its figure, and the circuit that it shows."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from html import escape
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.experiments.experiment import Outcome
from bgmodel.experiments.kept import Kept
from bgmodel.experiments.outcomes import shift_of
from bgmodel.experiments.record import CONDITIONS
from bgmodel.explorer import drawing
from bgmodel.explorer.html import (
    CIRCUIT,
    CONTROL,
    MANIPULATION,
    MEASURES,
    TIMES,
    TRADEOFF,
    TRIAL,
    Panel,
    known,
    measures_of,
    table_of,
)
from bgmodel.explorer.state import State
from bgmodel.explorer.trial import Shown, one_trial
from bgmodel.integrators.sprt import Msprt
from bgmodel.tables.named import NamedEvidence
from circuits.errors import collected
from circuits.laws.stability import ringing
from circuits.plots import ROWS
from circuits.show import html as tables_of

if TYPE_CHECKING:
    from circuits.circuit import Circuit
    from circuits.declaration.courses import Course

LATE = 0.05
"""Largest share of trials decided by the deadline at a point of the MSPRT's curve."""
KEPT = 3
"""Largest number of tasks whose evidence, and the MSPRT's curve on it, are remembered."""


@dataclass
class Memory:
    """What is computed once and used again while the edited circuit changes."""

    conditions: Kept = field(default_factory=Kept)
    evidence: dict[Hashable, NamedEvidence] = field(default_factory=dict)
    tests: dict[Hashable, pd.DataFrame] = field(default_factory=dict)
    trials: dict[Hashable, Shown] = field(default_factory=dict)
    """Trials of controls."""
    outcome: tuple[str, Outcome] | None = None
    """The last outcome, and the key of its state."""

    def given(self, state: State) -> NamedEvidence:
        """Return the evidence of a state."""
        experiment = state.experiment
        key = experiment.task, experiment.seed, experiment.truth
        if key not in self.evidence:
            self.evidence[key] = experiment.given()
        self.forget()
        return self.evidence[key]

    def forget(self) -> None:
        """Forget what was used first, beyond ``KEPT`` of a kind."""
        for kept in (self.tests, self.evidence, self.trials):
            for old in [*kept][: max(0, len(kept) - KEPT)]:
                del kept[old]


def panels(state: State, memory: Memory, *, workers: int = 2) -> Iterator[Panel]:
    """Compute the panels of a state, those of behaviour first.

    A panel whose run is refused has the sentence of the refusal.
    """
    key, digest = state.key, state.digest

    def panel(
        name: str, text: str, notes: list[str], svg: str = "", html: str = "", folded: str = ""
    ) -> Panel:
        return Panel(name, key, digest, text, svg, html, folded, tuple(dict.fromkeys(notes)))

    def refused(error: ValueError, *names: str) -> Iterator[Panel]:
        for name in names:
            yield Panel(name, key, digest, str(error), refused=True)

    try:
        with collected() as notes:
            outcome = state.experiment.run(
                workers=workers, given=memory.given(state), kept=memory.conditions
            )
        memory.outcome = key, outcome
        if state.alike:
            notes = [note for note in notes if "no decision differs" not in note]
        notes += filter(None, [shift_of(state.experiment)])
        yield panel(MEASURES, _said(outcome, state), notes, html=measures_of(outcome, state))
        svg = drawing.times(outcome.trials, edited=not state.alike)
        yield panel(TIMES, _medians(outcome, state), [], svg)
        svg, text = _tradeoff(outcome, state, memory)
        yield panel(TRADEOFF, text, [], svg)
    except ValueError as error:
        yield from refused(error, MEASURES, TIMES, TRADEOFF)
    try:
        edited, control = state.circuit, state.control
        with collected() as notes:
            svg, rows = drawing.circuit(edited, control), tables_of(edited)
            loops = _loops(state)
        yield panel(CIRCUIT, _rows(state), notes, svg, loops, rows)
    except ValueError as error:
        yield from refused(error, CIRCUIT)
    try:
        with collected() as notes:
            trials = _trials(state, memory)
            svg = drawing.trial(trials)
        yield panel(TRIAL, _trials_said(trials), notes, svg)
    except ValueError as error:
        yield from refused(error, TRIAL)


def _trials(state: State, memory: Memory) -> dict[str, Shown]:
    """Return the trial of the control and, if the circuit is edited, that of the manipulation."""
    evidence, experiment = memory.given(state).evidence, state.experiment
    control, manipulation = experiment.conditions
    key = state.control, control, experiment.task, experiment.seed, experiment.truth, state.trial
    if key not in memory.trials:
        memory.trials[key] = one_trial(control, evidence, state.trial)
    shown = {CONTROL: memory.trials[key]}
    memory.forget()
    if not state.alike:
        shown[MANIPULATION] = one_trial(manipulation, evidence, state.trial)
    return shown


def _trials_said(trials: Mapping[str, Shown]) -> str:
    """Return the decisions of a trial in words, and its courses."""
    windows = dict.fromkeys(_course(row) for one in trials.values() for row in one.courses)
    decided = [one.sentence() for one in trials.values()]
    if len(trials) > 1:
        decided = [f"{name}: {text}" for name, text in zip(trials, decided, strict=True)]
    shaded = [f"Shaded: {'; '.join(windows)}."] if windows else []
    cells = [f"Spikes: up to {ROWS} cells of a nucleus."] if trials[CONTROL].spikes else []
    return " ".join([*decided, *shaded, *cells])


def _course(row: Course) -> str:
    """Return what a course adds, and when, in words."""
    ends = f" to {row.to_ms:g} ms" if np.isfinite(row.to_ms) else " ms on"
    return f"{row.what} {row.amount:+g} from {row.from_ms:g}{ends}"


def _tradeoff(outcome: Outcome, state: State, memory: Memory) -> tuple[str, str]:
    """Return the figure of speed and accuracy, and the same in words."""
    evidence = outcome.given.evidence
    experiment, gain = state.experiment, outcome.models[0].gain
    key = experiment.task, experiment.seed, experiment.truth, gain
    if key not in memory.tests:
        memory.tests[key] = msprt_curve(evidence, gain)
    by = {name: rows.set_index("measure") for name, rows in outcome.measures.groupby("condition")}
    columns = ["value", "low", "high"]
    points = {CONTROL: by["control"][columns]}
    if not state.alike:
        points[MANIPULATION] = by["manipulation"][columns]
    test = memory.tests[key]
    said = [_later(name, rows, test) for name, rows in points.items()]
    return drawing.tradeoff(points, test, 1 / evidence.hypotheses), " ".join(said)


def msprt_curve(evidence: Evidence, gain: float) -> pd.DataFrame:
    """Return mean time and accuracy of the MSPRT, at thresholds where evidence decides."""
    swept = tradeoff(Msprt(gain).run(evidence), evidence)
    rows = []
    for k in range(len(swept.settings)):
        decided = ~swept.forced[k]
        if 1 - decided.mean() <= LATE:
            right = swept.choice[k] == evidence.truth
            rows.append((swept.time_ms[k][decided].mean(), right[decided].mean()))
    return pd.DataFrame(rows, columns=["mean_ms", "accuracy"]).sort_values("mean_ms")


def _later(name: str, rows: pd.DataFrame, test: pd.DataFrame) -> str:
    """Return how much later than the MSPRT a circuit reaches its accuracy, in words."""
    values = rows["value"].to_dict()
    accuracy, mean_ms = float(values["accuracy"]), float(values["mean_ms"])
    rising = test.sort_values("accuracy")
    lowest, highest = rising["accuracy"].min(), rising["accuracy"].max()
    if accuracy < lowest:
        return (
            f"{name}: less accurate ({known(accuracy)}) than the optimal test is after one reading "
            f"({lowest:.3f})."
        )
    if not accuracy <= highest or not np.isfinite(mean_ms):
        return (
            f"{name}: at none of its thresholds does the optimal test have this accuracy "
            f"({known(accuracy)}) by the deadline."
        )
    ideal = float(np.interp(accuracy, rising["accuracy"], rising["mean_ms"]))
    return (
        f"{name}: accuracy {accuracy:.3f} in {mean_ms:.0f} ms; the optimal test needs about "
        f"{ideal:.0f} ms on this evidence."
    )


def _medians(outcome: Outcome, state: State) -> str:
    """Return what the distributions show in words."""
    values = outcome.measures.set_index(["condition", "measure"])["value"]
    line = "" if state.alike else "; the lines are the control"
    medians = [
        f"{name} {known(values[name, 'median_ms'], 0, ' ms')}"
        for name in CONDITIONS[: 1 if state.alike else 2]
    ]
    return (
        f"Correct responses are above the axis and errors below it{line}. Median: "
        f"{', '.join(medians)}."
    )


def _said(outcome: Outcome, state: State) -> str:
    """Return accuracy and mean time of both conditions in words."""
    values = outcome.measures.set_index(["condition", "measure"])["value"]
    parts = [
        f"{name}: accuracy {known(values[name, 'accuracy'])}, mean time "
        f"{known(values[name, 'mean_ms'], 0, ' ms')}, {values[name, 'missed']:.1%} missed"
        for name in CONDITIONS[: 1 if state.alike else 2]
    ]
    return f"{outcome.given.evidence.trials} trials; {'; '.join(parts)}."


def _loops(state: State) -> str:
    """Return whether each circuit oscillates at rest, as a table in HTML."""
    both = [_rhythm(state.control)] + ([] if state.alike else [_rhythm(state.circuit)])
    head = ("At rest", CONTROL, MANIPULATION)[: 1 + len(both)]
    about = "Largest amplification of fluctuations by feedback loops, from 1 to 100 Hz"
    labels = {"Oscillates": "Whether the fixed point is unstable", "Loops amplify noise": about}
    rows = [(label, labels[label], [one[k] for one in both]) for k, label in enumerate(labels)]
    return table_of(head, rows)


@lru_cache(maxsize=8)
def _rhythm(circuit: Circuit) -> tuple[str, str]:
    """Return whether a circuit oscillates at rest, and how far its loops amplify fluctuations."""
    try:
        amplified, hz = ringing(circuit.steady)
    except ValueError as error:
        return "unknown", escape(str(error))
    if np.isinf(amplified):
        return f"yes, at {hz:.0f} Hz", "without bound"
    return "no", "not at all" if amplified <= 1 else f"{amplified:.1f}-fold, at {hz:.0f} Hz"


def _rows(state: State) -> str:
    """Return the circuit in words."""
    circuit = state.circuit
    edits = "; ".join(state.edits) or "none"
    nuclei = ", ".join(row.name for row in circuit.populations)
    return f"{circuit.name} with {circuit.channels} alternatives: {nuclei}. Edits: {edits}."
