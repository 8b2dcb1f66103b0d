"""The command that adds stop signals to a task."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Shows,
    bar,
    check_ending,
    check_whole,
    made_with,
    save_figure,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import STREAM, Condition
from bgmodel.deciding.measures import P_RANGE
from bgmodel.stopping.task import StopTask
from bgmodel.support import files
from bgmodel.task import Gaussian

if TYPE_CHECKING:
    from bgmodel.stopping.estimates import StopEstimate

TASK = Gaussian(trials=4000, d_prime=0.35, step_ms=10.0, t_max=150)
"""Readings every 10 ms, so that response times are not bound to few of them."""


@dataclass(frozen=True)
class StopRun(Shows):
    """Let a circuit decide with stop signals in a share of the trials.

    Prints the inhibition function (the share of responses at each stop-signal delay) and the
    stop-signal reaction time, and writes the table of trials.

    Examples: bgmodel stop; bgmodel stop trials.csv --drawing stop.png --stop.delay-ms 60;
    bgmodel stop --edits "lesion STN 10%" --stop.amount-nats 0.5;
    bgmodel stop --stop.staircases 2 --stop.share 0.5
    """

    output: Positional[Path | None] = None
    """File for the table of trials, .parquet or .csv."""
    drawing: Path | None = None
    """File for a picture, .pdf, .svg or .png."""
    condition: OmitArgPrefixes[Condition] = field(default_factory=lambda: Condition(task=TASK))
    stop: StopTask = field(default_factory=lambda: StopTask(share=0.5))
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.stopping.estimates import estimate_ssrt, inhibition_function, ssrt_by_delay

        self._check()
        asked = self.condition
        given = asked.drawn(STREAM)
        evidence = given.evidence
        say_of_edits(asked.edits)
        model = asked.model(evidence.hypotheses, workers=self.workers, rates=False)
        level = model.threshold(asked.threshold, asked.stopping_posterior)
        runs = len(self.stop.delays_ms) if self.stop.staircases else 1
        say_before("running", model, evidence)
        with bar(runs * evidence.trials):
            trials = self.stop.decide(model, evidence, threshold=level, seed=asked.seed)
        found, table = estimate_ssrt(trials, checked=False), inhibition_function(trials)
        if self.output is not None:
            behind = made_with(self, model)
            files.write_table(trials.to_dataframe(), self.output, seed=asked.seed, **behind)
        if self.drawing is not None:
            from bgmodel.stopping.drawing import draw

            save_figure(draw(trials), self.drawing)
        written = [str(path) for path in (self.output, self.drawing) if path is not None]
        ssrt_ms = ssrt_by_delay(table)
        text = f"{table.round(3).to_string(index=False)}\n{_said(found, ssrt_ms, self.stop)}"
        text += f"\n-> {', '.join(written)}" if written else ""
        about = {**vars(found), "ssrt_by_delay_ms": ssrt_ms, "trials": len(trials.rt_ms)}
        self.show(text, table, **about)

    def _check(self) -> None:
        """Refuse contradictory options before long work starts."""
        check_whole(workers=self.workers)
        if self.output is not None:
            check_ending("output", self.output, ".parquet", ".csv")
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
        task = self.condition.task
        if task.file is None:
            self.stop.check_ends(task.step_ms * task.t_max)


def _said(found: StopEstimate, ssrt_ms: float, task: StopTask) -> str:
    """Return the estimates in sentences."""
    refused = f"the consensus guide accepts no estimate: {found.refusal}"
    low, high = P_RANGE
    estimate = (
        f"stop-signal reaction time {ssrt_ms:.0f} ms by integration at each delay "
        f"({found.ssrt_ms:.0f} ms with all delays pooled), of which {task.delay_ms:g} ms are the "
        f"given delay to {task.nucleus}; there are no motor delays"
    )
    if np.isnan(ssrt_ms):
        estimate = (
            "no stop-signal reaction time: at no delay do "
            f"{low:.0%} to {high:.0%} of the stop trials have a response"
        )
    missed = f", {found.omissions:.1%} of go trials missed" if found.omissions else ""
    failed = found.failed_minus_go_ms
    return (
        f"mean go time {found.go_ms:.0f} ms{missed}, "
        + ("no failed stops" if np.isnan(failed) else f"failed stops {failed:+.0f} ms")
        + f", responses in {found.p_respond:.1%} of stop trials\n{estimate}"
        + (f"\n{refused}" if found.refusal else "")
    )
