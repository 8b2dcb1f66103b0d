"""Computation in the background: a new state cancels the run of an older one."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

import pandas as pd

from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.outcomes import measured
from bgmodel.explorer.panels import Memory, Panel, panels
from bgmodel.explorer.state import ExplorerState
from bgmodel.support import processes
from bgmodel.trials.named_evidence import NamedEvidence
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


def losses(state: ExplorerState) -> list[str]:
    """Return the edits that are ranked: a lesion of each nucleus, and a cut of each pathway."""
    circuit = state.circuit
    lesions = [f"lesion {row.name} {LOSS}" for row in circuit.populations]
    return lesions + [f"cut {pair} {LOSS}" for pair in {row.pair: 0 for row in circuit.projections}]


def ranked(state: ExplorerState, *, workers: int = 2) -> Iterator[Panel]:
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


class Superseded(Exception):
    """Cancelled: superseded by a newer request, or the page was closed."""


class PanelRuns:
    """One thread that computes the panels of the newest state.

    ``deliver`` receives each panel, and ``ended`` the state when all are computed, and whether it
    was ranked; both are called in that thread.
    """

    def __init__(
        self,
        deliver: Callable[[Panel], None],
        ended: Callable[[ExplorerState, bool], None],
        workers: int = 2,
    ) -> None:
        self.memory = Memory()
        self._deliver, self._ended, self._workers = deliver, ended, workers
        self._shows = self._ranks = 0
        """Numbers of requests; only the newest is wanted."""
        self._thread = ThreadPoolExecutor(1, "explorer")

    def show(self, state: ExplorerState) -> None:
        """Compute the panels of a state, and cancel the computation for an older one."""
        self._shows += 1
        self._submit(state, lambda: panels(state, self.memory, workers=self._workers))

    def rank(self, state: ExplorerState) -> None:
        """Rank the losses of a state after its panels."""
        self._ranks += 1
        self._submit(state, lambda: ranked(state, workers=self._workers), self._ranks)

    def cancel(self) -> None:
        """Cancel the ranking."""
        self._ranks += 1

    def stop(self, *, wait: bool = False) -> None:
        """Cancel all runs and end the thread."""
        self._shows += 1
        self._thread.shutdown(wait=wait, cancel_futures=True)

    def _submit(
        self, state: ExplorerState, compute: Callable[[], Iterator[Panel]], ranks: int | None = None
    ) -> None:
        """Queue a run, with the number of its ranking; an unexpected error is logged."""
        shows = self._shows

        def check(_: int = 0) -> None:
            """Cancel the run if it is no longer wanted; engines call this after each batch."""
            if shows != self._shows or ranks not in (None, self._ranks):
                raise Superseded

        def run() -> None:
            with suppress(Superseded):
                check()
                with quiet(), processes.shown_by(check):  # panels collect their own warnings
                    for panel in compute():
                        check()
                        self._deliver(panel)
                self._ended(state, ranks is not None)
            # Figures refer to themselves: without this, memory would grow between collections.
            gc.collect()

        future = self._thread.submit(run)
        future.add_done_callback(lambda done: done.cancelled() or done.result())
