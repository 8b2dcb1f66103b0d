"""The explorer's panels as records: figures, tables and the same in words."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pandas as pd

from bgmodel.deciding.measures import OF_DIFFUSION
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.experiments.experiment import Outcome
from bgmodel.experiments.outcomes import PREDICTED, measured, predicted, shift_of, unknown
from bgmodel.experiments.record import CONDITIONS, UNCHANGED
from bgmodel.explorer import drawing
from bgmodel.explorer.circuit import Shown, one_trial
from bgmodel.explorer.state import ExplorerState
from bgmodel.integrators.sprt import Msprt
from bgmodel.plots import labelled
from bgmodel.trials.named_evidence import NamedEvidence
from circuits.circuit import Circuit
from circuits.declaration.courses import Course
from circuits.errors import collected
from circuits.laws.stability import ringing
from circuits.plots import ROWS
from circuits.show import html as tables_of
from circuits.store import Latest

TIMES, TRADEOFF, MEASURES, CIRCUIT, TRIAL = "times", "tradeoff", "measures", "circuit", "trial"
TITLES = {
    CIRCUIT: "Circuit",
    TIMES: "Decision times",
    TRADEOFF: "Speed and accuracy",
    MEASURES: "Behaviour",
    TRIAL: "One trial in spikes",
}
"""All panels of a state, and their titles."""
NAMES = ("Control", "Manipulation", "Change")
"""Headings of conditions."""
LATE = 0.05
"""Largest share of trials decided by the deadline at a point of the MSPRT's curve."""
CONDITIONS_KEPT, KEPT = 12, 3
"""Largest numbers of conditions, and of other results of a kind, such as the evidence of tasks."""


@dataclass(frozen=True, eq=False)
class Panel:
    """The contents of one panel.

    ``key`` and ``digest`` are the hashes of its state and of the edited circuit. ``text`` states in
    words what the figure shows, or the error if the run was refused. ``folded`` is HTML that is
    shown on request.
    """

    name: str
    key: str
    digest: str
    text: str
    svg: str = ""
    tables: tuple[pd.DataFrame, ...] = ()
    folded: str = ""
    warnings: tuple[str, ...] = ()
    refused: bool = False


@dataclass
class Memory:
    """Results that are reused while the edited circuit changes."""

    conditions: Latest = field(default_factory=lambda: Latest(CONDITIONS_KEPT))
    others: Latest = field(default_factory=lambda: Latest(KEPT))
    outcome: tuple[str, Outcome] | None = None
    """The last outcome, and the key of its state."""

    def evidence(self, state: ExplorerState) -> NamedEvidence:
        """Return the evidence of a state."""
        return self.others.once("evidence", _task(state), state.experiment.given)


def _task(state: ExplorerState) -> tuple[Hashable, ...]:
    """Return the settings that determine the evidence of a state."""
    experiment = state.experiment
    return experiment.task, experiment.seed, experiment.truth


def panels(state: ExplorerState, memory: Memory, *, workers: int = 2) -> Iterator[Panel]:
    """Compute the panels of a state, those of behaviour first.

    A panel whose run is refused contains the error.
    """
    parts: list[tuple[tuple[str, ...], Callable[[], Iterator[Panel]]]] = [
        ((MEASURES, TIMES, TRADEOFF), lambda: _behaviour(state, memory, workers)),
        ((CIRCUIT,), lambda: _circuit(state)),
        ((TRIAL,), lambda: _trial(state, memory)),
    ]
    for names, compute in parts:
        missing = list(names)
        try:
            for panel in compute():
                missing.remove(panel.name)
                yield panel
        except ValueError as error:
            for name in missing:
                yield Panel(name, state.key, state.digest, str(error), refused=True)


def _behaviour(state: ExplorerState, memory: Memory, workers: int) -> Iterator[Panel]:
    """Run the experiment, and return the panels of behaviour."""
    with collected() as notes:
        outcome = state.experiment.run(
            workers=workers, named=memory.evidence(state), kept=memory.conditions
        )
    memory.outcome = state.key, outcome
    if state.alike:
        notes = [note for note in notes if UNCHANGED not in note]
    notes += filter(None, [shift_of(state.experiment)])
    text, tables = _measures(outcome, state)
    warnings = tuple(dict.fromkeys(notes))
    yield Panel(MEASURES, state.key, state.digest, text, tables=tables, warnings=warnings)
    svg = drawing.times(outcome.trials, edited=not state.alike)
    yield Panel(TIMES, state.key, state.digest, _medians(outcome, state), svg)
    text, svg = _tradeoff(outcome, state, memory)
    yield Panel(TRADEOFF, state.key, state.digest, text, svg)


def _shown(state: ExplorerState) -> tuple[str, ...]:
    """Return the conditions that are shown: without edits, the control alone."""
    return CONDITIONS[: 1 if state.alike else 2]


def _values(outcome: Outcome) -> dict[tuple[str, str], float]:
    """Return the value of each condition and measure."""
    table = outcome.measures
    columns = (table[name] for name in ("condition", "measure", "value"))
    return {(condition, measure): value for condition, measure, value in zip(*columns, strict=True)}


def _number(value: float, digits: int = 3, unit: str = "") -> str:
    """Return a number as text, or "unknown" for NaN."""
    return f"{value:.{digits}f}{unit}" if value == value else "unknown"


def _measures(outcome: Outcome, state: ExplorerState) -> tuple[str, tuple[pd.DataFrame, ...]]:
    """Return the behaviour in words and as the table of ``bgmodel experiment``.

    The measures are the same for all edits of a task. The words include the published result and
    the reasons why measures are unknown; an experiment with predictions has a table of verdicts.
    """
    experiment, values = outcome.experiment, _values(outcome)
    conditions = [
        f"{name}: accuracy {_number(values[name, 'accuracy'])}, mean time "
        f"{_number(values[name, 'mean_ms'], 0, ' ms')}, {values[name, 'missed']:.1%} missed"
        for name in _shown(state)
    ]
    lines = [f"{outcome.given.evidence.trials} trials; {'; '.join(conditions)}."]
    columns = NAMES[:1] if state.alike else NAMES
    two = outcome.given.evidence.hypotheses == 2
    rows = [
        (labelled(measure), *cells[: len(columns)])
        for measure, cells in measured(outcome.measures, every=True)
        if two or measure not in OF_DIFFUSION
    ]
    tables = [pd.DataFrame(rows, columns=["Measure", *columns])]
    lines += unknown(experiment, outcome.measures)[: 1 if state.alike else None]
    if experiment.predictions:
        verdicts, reasons = predicted(experiment, outcome.measures)
        head = [name[0].upper() + name[1:] for name in PREDICTED]
        tables.insert(0, pd.DataFrame(verdicts, columns=head))
        about = (experiment.published, experiment.source, experiment.note)
        labels = ("Published", "Source", "In the model")
        lines += [f"{k}: {text.strip()}" for k, text in zip(labels, about, strict=True) if text]
        lines += reasons
    return "\n".join(lines), tuple(tables)


def _medians(outcome: Outcome, state: ExplorerState) -> str:
    """Describe the distributions in words."""
    values = _values(outcome)
    line = "" if state.alike else "; the lines are the control"
    medians = [f"{k} {_number(values[k, 'median_ms'], 0, ' ms')}" for k in _shown(state)]
    return (
        f"Correct responses are above the axis and errors below it{line}. Median: "
        f"{', '.join(medians)}."
    )


def _tradeoff(outcome: Outcome, state: ExplorerState, memory: Memory) -> tuple[str, str]:
    """Return speed and accuracy in words, and their figure."""
    evidence, gain = outcome.given.evidence, outcome.models[0].gain
    key = *_task(state), gain
    test = memory.others.once("test", key, lambda: msprt_curve(evidence, gain))
    by = {name: rows.set_index("measure") for name, rows in outcome.measures.groupby("condition")}
    points = {
        name.capitalize(): by[name][["value", "low", "high"]].astype(float)
        for name in _shown(state)
    }
    text = " ".join(_later(name, rows, test) for name, rows in points.items())
    return text, drawing.tradeoff(points, test, 1 / evidence.hypotheses)


def msprt_curve(evidence: Evidence, gain: float) -> pd.DataFrame:
    """Return mean time and accuracy of the MSPRT, at thresholds where evidence decides."""
    swept = tradeoff(Msprt(gain).run(evidence), evidence)
    decided = ~swept.forced
    kept = np.flatnonzero(decided.mean(axis=1) >= 1 - LATE)
    right = swept.choice == evidence.truth
    rows = [(swept.time_ms[k][decided[k]].mean(), right[k][decided[k]].mean()) for k in kept]
    return pd.DataFrame(rows, columns=["mean_ms", "accuracy"]).sort_values("mean_ms")


def _later(name: str, rows: pd.DataFrame, test: pd.DataFrame) -> str:
    """Return the times that a circuit and the MSPRT need for its accuracy, in words."""
    values = rows["value"].to_dict()
    accuracy, mean_ms = float(values["accuracy"]), float(values["mean_ms"])
    rising = test.sort_values("accuracy")
    lowest, highest = rising["accuracy"].min(), rising["accuracy"].max()
    if accuracy < lowest:
        return (
            f"{name}: less accurate ({_number(accuracy)}) than the optimal test after one reading "
            f"({lowest:.3f})."
        )
    if not accuracy <= highest or not np.isfinite(mean_ms):
        return (
            f"{name}: the optimal test reaches this accuracy ({_number(accuracy)}) by the deadline "
            "at none of its thresholds."
        )
    ideal = float(np.interp(accuracy, rising["accuracy"], rising["mean_ms"]))
    return (
        f"{name}: accuracy {accuracy:.3f} in {mean_ms:.0f} ms; the optimal test needs about "
        f"{ideal:.0f} ms on this evidence."
    )


def _circuit(state: ExplorerState) -> Iterator[Panel]:
    """Return the panel of the circuit, with a table of its oscillations at rest."""
    edited, control = state.circuit, state.control
    with collected() as notes:
        svg, rows = drawing.circuit(edited, control), tables_of(edited)
        labels = ["Oscillates", "Amplification of noise by loops, 1 to 100 Hz"]
        table = pd.DataFrame({"At rest": labels, NAMES[0]: _rhythm(control)})
        if not state.alike:
            table[NAMES[1]] = _rhythm(edited)
    text = (
        f"{edited.name} with {edited.channels} alternatives: "
        f"{', '.join(row.name for row in edited.populations)}. "
        f"Edits: {'; '.join(state.edits) or 'none'}."
    )
    warnings = tuple(dict.fromkeys(notes))
    yield Panel(CIRCUIT, state.key, state.digest, text, svg, (table,), rows, warnings)


@lru_cache(maxsize=8)
def _rhythm(circuit: Circuit) -> tuple[str, str]:
    """Return whether a circuit oscillates at rest, and how far its loops amplify fluctuations."""
    try:
        amplified, hz = ringing(circuit.steady)
    except ValueError as error:
        return "unknown", str(error)
    if np.isinf(amplified):
        return f"yes, at {hz:.0f} Hz", "unbounded"
    return "no", "none" if amplified <= 1 else f"{amplified:.1f}-fold, at {hz:.0f} Hz"


def _trial(state: ExplorerState, memory: Memory) -> Iterator[Panel]:
    """Return the panel of one trial."""
    with collected() as notes:
        trials = trials_of(state, memory)
        svg = drawing.trial(trials)
    windows = dict.fromkeys(_course(row) for one in trials.values() for row in one.courses)
    sentences = [
        one.sentence() if len(trials) == 1 else f"{name}: {one.sentence()}"
        for name, one in trials.items()
    ]
    sentences += [f"Shaded: {'; '.join(windows)}."] if windows else []
    sentences += [f"Spikes: up to {ROWS} cells per nucleus."] if trials[NAMES[0]].spikes else []
    warnings = tuple(dict.fromkeys(notes))
    yield Panel(TRIAL, state.key, state.digest, " ".join(sentences), svg, warnings=warnings)


def trials_of(state: ExplorerState, memory: Memory) -> Mapping[str, Shown]:
    """Return the trial of the control and, if the circuit is edited, that of the manipulation."""
    evidence, trial = memory.evidence(state).evidence, state.trial
    control, manipulation = state.experiment.conditions
    key = state.control, control, *_task(state), trial
    shown = {
        NAMES[0]: memory.others.once("trial", key, lambda: one_trial(control, evidence, trial))
    }
    if not state.alike:
        shown[NAMES[1]] = one_trial(manipulation, evidence, trial)
    return shown


def _course(row: Course) -> str:
    """Describe in words the input that a course adds, and when."""
    ends = f" to {row.to_ms:g} ms" if np.isfinite(row.to_ms) else " ms on"
    return f"{row.what} {row.amount:+g} from {row.from_ms:g}{ends}"
