"""The explorer's panels as records: each contains its figure, and the circuit that it shows."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape

import numpy as np
import pandas as pd

from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.experiments.experiment import Outcome
from bgmodel.experiments.kept import Kept
from bgmodel.experiments.outcomes import measured
from bgmodel.explorer import drawing
from bgmodel.explorer.state import State
from bgmodel.explorer.trial import one_trial
from bgmodel.integrators.sprt import Msprt
from bgmodel.plots import labelled
from bgmodel.tables.trials import Trials
from circuits.errors import BgmodelWarning
from circuits.show import html as tables_of

TIMES, TRADEOFF, MEASURES, CIRCUIT, TRIAL = "times", "tradeoff", "measures", "circuit", "trial"
TITLES = {
    CIRCUIT: "Circuit",
    TIMES: "Decision times",
    TRADEOFF: "Speed and accuracy",
    MEASURES: "Behaviour",
    TRIAL: "One trial in spikes",
}
"""All panels and their titles, in the order in which a page shows them."""
THRESHOLDS = 40
"""Number of thresholds of the MSPRT's curve."""
LATE = 0.05
"""Largest share of trials decided by the deadline at a point of the MSPRT's curve."""
KEPT = 3
"""Largest number of tasks whose evidence, and the MSPRT's curve on it, are remembered."""

_turn = threading.RLock()


@dataclass(frozen=True)
class Panel:
    """What one panel shows.

    Parameters
    ----------
    name : str
        A key of ``TITLES``.
    key : str
        Hash of the state that it shows.
    digest : str
        SHA-256 of the edited circuit that it shows.
    text : str
        The same in words, for a screen reader; or why there is nothing to show.
    svg : str
        The figure; empty in panels without one.
    html : str
        A table; empty in panels without one.
    warnings : tuple of str
        Warnings of its run.
    refused : bool
        Whether the run was refused: ``text`` is then the sentence.
    """

    name: str
    key: str
    digest: str
    text: str
    svg: str = ""
    html: str = ""
    warnings: tuple[str, ...] = ()
    refused: bool = False


@dataclass
class Memory:
    """What is computed once and used again while the edited circuit changes."""

    conditions: Kept = field(default_factory=Kept)
    evidence: dict[Hashable, Trials] = field(default_factory=dict)
    tests: dict[Hashable, pd.DataFrame] = field(default_factory=dict)
    outcome: tuple[str, Outcome] | None = None
    """The last outcome, and the key of its state."""

    def given(self, state: State) -> Trials:
        """Return the evidence of a state."""
        experiment = state.experiment
        key = experiment.task, experiment.seed, experiment.truth
        if key not in self.evidence:
            self.evidence[key] = experiment.given()
        self.forget()
        return self.evidence[key]

    def forget(self) -> None:
        """Forget what was used first, beyond ``KEPT`` of a kind."""
        for kept in (self.tests, self.evidence):
            for old in [*kept][: max(0, len(kept) - KEPT)]:
                del kept[old]


def panels(state: State, memory: Memory, *, workers: int = 2) -> Iterator[Panel]:
    """Compute the panels of a state, those of behaviour first.

    A panel whose run is refused has the sentence of the refusal.

    Parameters
    ----------
    state : State
        The state.
    memory : Memory
        Results to use again; new ones are added.
    workers : int
        Number of threads; it does not affect results.
    """
    key, digest = state.key, state.digest

    def panel(name: str, text: str, notes: list[str], svg: str = "", html: str = "") -> Panel:
        return Panel(name, key, digest, text, svg, html, tuple(dict.fromkeys(notes)))

    def refused(error: ValueError, *names: str) -> Iterator[Panel]:
        for name in names:
            yield Panel(name, key, digest, str(error), refused=True)

    try:
        with kept_warnings() as notes:
            outcome = state.experiment.run(
                workers=workers, given=memory.given(state), kept=memory.conditions
            )
        memory.outcome = key, outcome
        if state.alike:
            notes = [note for note in notes if "no decision differs" not in note]
        yield panel(MEASURES, _said(outcome, state), notes, html=_measures(outcome, state))
        svg = drawing.times(outcome.trials, edited=not state.alike)
        yield panel(TIMES, _medians(outcome, state), [], svg=svg)
        svg, text = _tradeoff(outcome, state, memory)
        yield panel(TRADEOFF, text, [], svg=svg)
    except ValueError as error:
        yield from refused(error, MEASURES, TIMES, TRADEOFF)
    try:
        edited, baseline = state.circuit, state.baseline
        with kept_warnings() as notes:
            svg, table = drawing.circuit(edited, baseline), tables_of(edited)
        yield panel(CIRCUIT, _rows(state), notes, svg=svg, html=table)
    except ValueError as error:
        yield from refused(error, CIRCUIT)
    try:
        with kept_warnings() as notes:
            shown = one_trial(state, memory.given(state).evidence)
            svg = drawing.trial(shown)
        yield panel(TRIAL, shown.sentence(), notes, svg=svg)
    except ValueError as error:
        yield from refused(error, TRIAL)


def _tradeoff(outcome: Outcome, state: State, memory: Memory) -> tuple[str, str]:
    """Return the figure of speed and accuracy, and the same in words."""
    evidence = outcome.given.evidence
    experiment, gain = state.experiment, outcome.models[0].gain
    key = experiment.task, experiment.seed, experiment.truth, gain
    if key not in memory.tests:
        memory.tests[key] = msprt_curve(evidence, gain)
    by = {name: rows.set_index("measure") for name, rows in outcome.measures.groupby("condition")}
    columns = ["value", "low", "high"]
    points = {"Baseline": by["control"][columns]}
    if not state.alike:
        points["Edited"] = by["manipulation"][columns]
    test = memory.tests[key]
    said = [_later(name, rows, test) for name, rows in points.items()]
    return drawing.tradeoff(points, test, 1 / evidence.hypotheses), " ".join(said)


def msprt_curve(evidence: Evidence, gain: float) -> pd.DataFrame:
    """Return mean time and accuracy of the MSPRT, at thresholds where evidence decides.

    Parameters
    ----------
    evidence : Evidence
        Readings of all trials; the truth must be known.
    gain : float
        Nats per nat of evidence; it shifts the thresholds and leaves the curve.

    Returns
    -------
    DataFrame
        Columns mean_ms and accuracy, of trials that the deadline does not decide, in order of time.
    """
    chance = 1 / evidence.hypotheses
    levels = -np.log(np.linspace(0.995, chance + 0.02, THRESHOLDS))
    swept = tradeoff(Msprt(gain).run(evidence), evidence, levels)
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
    within = len(rising) and rising["accuracy"].min() <= accuracy <= rising["accuracy"].max()
    if not within or not np.isfinite(mean_ms):
        return f"{name}: no threshold of the optimal test has this accuracy."
    ideal = float(np.interp(accuracy, rising["accuracy"], rising["mean_ms"]))
    return (
        f"{name}: accuracy {accuracy:.3f} in {mean_ms:.0f} ms; the optimal test needs about "
        f"{ideal:.0f} ms on this evidence."
    )


@contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Yield a list to which the package's warnings within the block are added, not printed.

    Filters of warnings are those of the whole process: tabs take turns, or one would keep the
    warnings of another.
    """
    kept: list[str] = []
    with _turn, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", BgmodelWarning)
        yield kept
    kept += [str(one.message) for one in caught if issubclass(one.category, BgmodelWarning)]


def _measures(outcome: Outcome, state: State) -> str:
    """Return the table of measures as HTML, with the numbers that the command prints."""
    names = ["Baseline"] if state.alike else ["Baseline", "Edited", "Change"]
    head = "".join(f'<th scope="col">{name}</th>' for name in ("Measure", *names))
    rows = []
    for measure, cells in measured(outcome.measures):
        texts = "".join(f"<td>{_two_lines(cell)}</td>" for cell in cells[: len(names)])
        label = f'<th scope="row" title="{escape(measure)}">{escape(labelled(measure))}</th>'
        rows.append(f"<tr>{label}{texts}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _two_lines(cell: str) -> str:
    """Return a value and its interval as HTML, the interval below the value."""
    value, bracket, rest = cell.partition(" [")
    interval = f"<small> {escape(bracket[1:] + rest)}</small>" if bracket else ""
    return f"<strong>{escape(value)}</strong>{interval}"


def _medians(outcome: Outcome, state: State) -> str:
    """Return what the distributions show in words."""
    values = outcome.measures.set_index(["condition", "measure"])["value"]
    line = "" if state.alike else "; the lines are the baseline"
    edited = "" if state.alike else f", edited {values['manipulation', 'median_ms']:.0f} ms"
    return (
        f"Correct responses are above the axis and errors below it{line}. Median: baseline "
        f"{values['control', 'median_ms']:.0f} ms{edited}."
    )


def _said(outcome: Outcome, state: State) -> str:
    """Return accuracy and mean time of both conditions in words."""
    values = outcome.measures.set_index(["condition", "measure"])["value"]
    both = {"control": "baseline", "manipulation": "edited"}
    parts = [
        f"{both[name]}: accuracy {values[name, 'accuracy']:.3f}, mean time "
        f"{values[name, 'mean_ms']:.0f} ms, {values[name, 'missed']:.1%} missed"
        for name in [*both][: 1 if state.alike else 2]
    ]
    return f"{outcome.given.evidence.trials} trials; {'; '.join(parts)}."


def _rows(state: State) -> str:
    """Return the circuit in words."""
    circuit = state.circuit
    edits = "; ".join(state.edits) or "none"
    nuclei = ", ".join(row.name for row in circuit.populations)
    return f"{circuit.name} with {circuit.channels} alternatives: {nuclei}. Edits: {edits}."
