"""Ranking of losses: which nucleus or pathway slows decisions most when a part of it is lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pandas as pd

from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.outcomes import measured
from bgmodel.explorer.panels import Panel
from bgmodel.explorer.state import State
from bgmodel.tables.named import NamedEvidence
from circuits.declaration.edits import Edits
from circuits.errors import quiet
from circuits.store import Latest

RANKING = "ranking"
"""Name of the panel, which is computed on request."""
LOSS = "10%"
"""Share of the cells of a nucleus, or of the axons of a pathway, that is lost."""
TRIALS = 500
"""Largest number of trials per loss, except for evidence from a table."""
SHOWN = {"mean_ms": "Time (ms)", "accuracy": "Accuracy", "missed": "Missed"}
"""Measures whose changes are listed, and their headings."""


def losses(state: State) -> list[str]:
    """Return the edits that are ranked: a lesion of each nucleus, and a cut of each pathway."""
    circuit = state.circuit
    lesions = [f"lesion {row.name} {LOSS}" for row in circuit.populations]
    return lesions + [f"cut {pair} {LOSS}" for pair in {row.pair: 0 for row in circuit.projections}]


def ranked(state: State, *, workers: int = 2) -> Iterator[Panel]:
    """Run each loss in addition to the edits of a state, and yield the ranking after each."""
    task = state.experiment.task
    many = task.file is None and task.trials > TRIALS
    control = (state.with_setting("trials", TRIALS) if many else state).as_control().experiment
    lines = losses(state)
    evidence, kept = control.given(), Latest(len(lines) + 1)
    changes: list[tuple[float, str, list[str]]] = []
    refused: list[str] = []
    for count, line in enumerate(lines, 1):
        try:
            changes.append(_change(control, line, evidence, kept, workers))
        except ValueError as error:
            refused.append(str(error))
        text = _method(control, refused) if count == len(lines) else f"{count} of {len(lines)}…"
        if changes:
            yield Panel(RANKING, state.key, state.digest, text, tables=(_table(changes),))
    if not changes:
        yield Panel(RANKING, state.key, state.digest, refused[0], refused=True)


def _change(
    control: Experiment, line: str, evidence: NamedEvidence, kept: Latest, workers: int
) -> tuple[float, str, list[str]]:
    """Return the change of the mean time by a loss, its edit, and all changes as text."""
    edits = Edits([*control.manipulation.edits, line])
    experiment = replace(control, manipulation=replace(control.manipulation, edits=edits))
    with quiet():
        outcome = experiment.run(workers=workers, named=evidence, kept=kept)
    cells = dict(measured(outcome.measures, every=True))
    table: pd.DataFrame = outcome.measures
    (by,) = table.loc[(table["condition"] == "change") & (table["measure"] == "mean_ms"), "value"]
    return float(by), line, [cells[name][-1] for name in SHOWN]


def _table(changes: list[tuple[float, str, list[str]]]) -> pd.DataFrame:
    """Return the ranking, the loss that slows decisions most first and unknown changes last."""
    order = sorted(changes, key=lambda row: (row[0] != row[0], -row[0]))
    columns = ["Additional loss", *(f"{name}, change" for name in SHOWN.values())]
    return pd.DataFrame([(line, *cells) for _, line, cells in order], columns=columns)


def _method(control: Experiment, refused: list[str]) -> str:
    """Return how the ranking was made, in words."""
    skipped = f" Skipped: {'; '.join(refused)}." if refused else ""
    return (
        f"Each loss alone, in addition to the edits: {control.trials} trials on the same evidence "
        "with the same noise. Times and accuracy include decided trials only; if more trials are "
        "missed, decisions are slower than the times suggest. Intervals of 95 % are not corrected "
        "for the number of losses: of twenty losses without an effect, about one interval excludes "
        f"0.{skipped}"
    )
