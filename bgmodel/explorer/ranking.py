"""Which loss slows decisions: every nucleus and pathway in turn, ranked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pandas as pd

from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.kept import Kept
from bgmodel.experiments.outcomes import measured
from bgmodel.explorer.html import RANKING, Panel, table_of, two_lines
from bgmodel.explorer.state import State
from bgmodel.tables.named import NamedEvidence
from circuits.declaration.edits import Edits
from circuits.errors import quiet

LOSS = "10%"
"""Share of the cells of a nucleus, or of the axons of a pathway, that is lost."""
TRIALS = 500
"""Largest number of trials of a row; evidence from a table is used whole."""
SHOWN = {"mean_ms": "Time (ms)", "accuracy": "Accuracy", "missed": "Missed"}
"""Measures whose changes are listed, and their headings."""


def losses(state: State) -> list[str]:
    """Return the edits that are ranked: a lesion of each nucleus, and a cut of each pathway."""
    circuit = state.circuit
    lesions = [f"lesion {row.name} {LOSS}" for row in circuit.populations]
    return lesions + [f"cut {pair} {LOSS}" for pair in {row.pair: 0 for row in circuit.projections}]


def ranked(state: State, *, workers: int = 2) -> Iterator[Panel]:
    """Run each loss in addition to the edits of a state, and yield the ranking after each."""
    control, lines = _few(state.as_control()).experiment, losses(state)
    given, kept = control.given(), Kept(most=len(lines) + 1)
    found: list[tuple[float, str, list[str]]] = []
    refused: list[str] = []
    for count, line in enumerate(lines, 1):
        try:
            found.append(_change(control, line, given, kept, workers))
        except ValueError as error:
            refused.append(str(error))
        said = _said(control, refused) if count == len(lines) else f"{count} of {len(lines)}…"
        if found:
            yield Panel(RANKING, state.key, state.digest, said, html=_table(found))
    if not found:
        yield Panel(RANKING, state.key, state.digest, refused[0], refused=True)


def _few(state: State) -> State:
    """Return a state with few trials."""
    task = state.experiment.task
    if task.file is not None or task.trials <= TRIALS:
        return state
    return state.with_setting("trials", TRIALS)


def _change(
    control: Experiment, line: str, given: NamedEvidence, kept: Kept, workers: int
) -> tuple[float, str, list[str]]:
    """Return the change of the mean time by a loss, its edit, and the changes as HTML."""
    edits = Edits([*control.manipulation.edits, line])
    experiment = replace(control, manipulation=replace(control.manipulation, edits=edits))
    with quiet():
        outcome = experiment.run(workers=workers, given=given, kept=kept)
    cells = dict(measured(outcome.measures, every=True))
    table: pd.DataFrame = outcome.measures
    (by,) = table.loc[(table["condition"] == "change") & (table["measure"] == "mean_ms"), "value"]
    return float(by), line, [two_lines(cells[name][-1]) for name in SHOWN]


def _table(found: list[tuple[float, str, list[str]]]) -> str:
    """Return the ranking as HTML, the loss that slows decisions most first."""
    rows = [(line, line, cells) for _, line, cells in sorted(found, key=_place)]
    return table_of(("Additional loss", *(f"{name}, change" for name in SHOWN.values())), rows)


def _place(row: tuple[float, str, list[str]]) -> tuple[bool, float]:
    """Return the key of a row: changes that are unknown come last."""
    return row[0] != row[0], -row[0]


def _said(control: Experiment, refused: list[str]) -> str:
    """Return how the ranking was made, in words."""
    out = f" Left out: {'; '.join(refused)}." if refused else ""
    return (
        f"Each loss alone, in addition to the edits: {control.trials} trials on the "
        "same evidence with the same noise. Times and accuracy are those of decided trials: where "
        "more are missed, decisions are later still. Intervals of 95 % are for each row alone; of "
        f"twenty losses without an effect, about one interval excludes 0.{out}"
    )
