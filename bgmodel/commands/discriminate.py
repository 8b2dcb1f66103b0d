"""The command that searches for the experiment that tells two models apart."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from bgmodel.commands.checks import (
    Shows,
    check_ending,
    check_whole,
    options_of,
    save_figure,
    say,
)
from bgmodel.conditions import ENGINE
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.discriminating.recording import Recording
    from bgmodel.discriminating.result import Discrimination


@dataclass(frozen=True)
class DiscriminateRun(Shows):
    """Search for the task that tells two models apart with the fewest trials.

    Models are circuits, a circuit and its edited self, or tests: msprt, "max vs average", "max vs
    next", race, LCA. Prints a verdict, the trials until a Bayes factor of 10, and the best tasks.
    "Cannot tell" comes with a bound. Without a model it prints the space of tasks that is searched.

    Examples: bgmodel discriminate; bgmodel discriminate msprt "max vs average"; bgmodel
    discriminate macaque --second-edits "lesion STN 10%" --drawing map.pdf; bgmodel discriminate
    macaque mine.toml result.json --plan plan.toml; bgmodel discriminate mine.toml mine.toml
    result.json --second-edits "dopamine 0.9"; bgmodel discriminate macaque --second-edits
    "lesion STN 10%" --nucleus STN
    """

    first: Positional[str] = ""
    """A circuit, by name or as a .toml file, or a test."""
    second: Positional[str] = ""
    """The other model; by default the first one, with other edits."""
    output: Positional[Path | None] = None
    """File for the result: .json has all of it, .csv or .parquet the table of tasks."""
    drawing: Path | None = None
    """File for a map of the space, .pdf, .svg or .png."""
    plan: Path | None = None
    """File for the best task as an experiment, .toml, for `bgmodel experiment`."""
    first_edits: Edits = field(default_factory=Edits)
    """Edits of the first circuit: "lesion STN 10%", "dopamine 0.9"."""
    second_edits: Edits = field(default_factory=Edits)
    """Edits of the second circuit."""
    space: Path | None = None
    """A TOML file with the tasks to be searched; by default the shipped space."""
    thresholds: Literal["matched", "free"] = "matched"
    """matched: each model has the task's accuracy in plain trials; free: the rival of the true
    model has the threshold at which it is hardest to tell apart."""
    non_decision: Literal["same", "free"] | None = None
    """Whether the rival's non-decision time is free; by default if one model alone is a test."""
    nucleus: str | None = None
    """A nucleus whose cells are recorded: their spikes are a third measure of each trial."""
    window_ms: tuple[float, float] = (100.0, 300.0)
    """Window in which spikes are counted, ms from the onset of evidence."""
    cells: int = 1
    """Number of recorded cells, in the channel of the true alternative."""
    trials: int = 1000
    """Trials of each kind in the search."""
    check_trials: int = 10_000
    """Trials of each kind in the check of the best task."""
    evaluations: int = 64
    """Most kinds of probe trials that are simulated in the search."""
    seed: int | None = None
    """Seed of the search."""
    check_seed: int | None = None
    """Seed of the check."""
    engine: EngineName = ENGINE
    """Engine of circuits."""
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.discriminating.discriminate import CHECK_SEED, SEED, discriminate
        from bgmodel.discriminating.space import SHIPPED

        self._check()
        if not self.first:
            print((SHIPPED / "default.toml").read_text(encoding="utf-8"), end="")
            return
        found = discriminate(
            self.first, self.second or None, first_edits=self.first_edits,
            second_edits=self.second_edits, space=self.space, thresholds=self.thresholds,
            non_decision=self.non_decision, recording=self._recording(),
            trials=self.trials, check_trials=self.check_trials,
            evaluations=self.evaluations, seed=SEED if self.seed is None else self.seed,
            check_seed=CHECK_SEED if self.check_seed is None else self.check_seed,
            engine=self.engine, workers=self.workers, tell=say,
        )  # fmt: skip
        self._write(found)
        named = [path for path in (self.output, self.drawing) if path is not None]
        written = f"\n-> {', '.join(map(str, named))}" if named else ""
        # By pandas, because JSON has no infinity, the median of models that cannot be told apart.
        rows = json.loads(found.sequential.to_json(orient="records", double_precision=15))
        self.show(found.text() + written, found.table, **found.facts(), sequential=rows)
        if self.plan is not None:
            # Last, because the best task may be none that an experiment can hold.
            text = found.experiment(self.plan.parent).to_toml()
            with files.replacing(self.plan) as partial:
                partial.write_text(text, encoding="utf-8")
            self.note(f"-> {self.plan}")

    def _recording(self) -> Recording | None:
        from bgmodel.discriminating.recording import Recording

        if self.nucleus is not None:
            return Recording(self.nucleus, self.window_ms, self.cells)
        for name in ("window_ms", "cells"):
            if getattr(self, name) != getattr(Recording, name):
                raise InputError(f"{name} is of recorded cells: give --nucleus", name)
        return None

    def _write(self, found: Discrimination) -> None:
        """Write the result and the drawing."""
        if self.output is not None and self.output.suffix == ".json":
            found.to_json(self.output)
        elif self.output is not None:
            behind = {"command": options_of(self), **found.settings}
            files.write_table(found.table, self.output, **behind)
        if self.drawing is not None:
            save_figure(found.plot(), self.drawing)

    def more_outputs(self) -> list[Path]:
        """Return the path of the planned experiment."""
        return [] if self.plan is None else [self.plan]

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        from bgmodel.discriminating.models import model_of
        from bgmodel.discriminating.planned import edited_from
        from bgmodel.discriminating.result import UNRECORDED

        check_whole(workers=self.workers)
        self._recording()
        if self.output is not None:
            check_ending("output", self.output, ".json", ".csv", ".parquet")
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
        if self.plan is not None:
            check_ending("plan", self.plan, ".toml")
            require(self.nucleus is None, "nucleus", UNRECORDED, self.nucleus)
            if self.first:
                second = self.second or self.first
                edited_from(
                    model_of(self.first, self.first_edits), model_of(second, self.second_edits)
                )
