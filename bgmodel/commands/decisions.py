"""The command that decides by the sequential test."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import Shows, check_ending, options_of
from bgmodel.integrators.sprt import Msprt, Sprt, sprt_threshold_from_gap, threshold_from_posterior
from bgmodel.support import files
from bgmodel.support.memory import check_evidence_memory
from bgmodel.support.seeds import stream
from bgmodel.tables import trials as tables
from bgmodel.tables.given import trials_of
from bgmodel.tactile.likelihood import Density
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Task
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

GAP_NATS = 4.0
"""Default gap of `decide`, nats."""
TAPPED = SameDifferent(trials=1000, t_max=30, step_ms=500.0)
"""Default evidence of `decide`: taps of the paper's task, one every half second."""


@dataclass(frozen=True)
class Decide(Shows):
    """Decide by the sequential test, on tactile evidence or on your own evidence table.

    A table has one row per reading with the columns trial, step, ll_<hypothesis> (natural log
    likelihoods; two or more such columns) and, if known, truth. Trials may differ in length: each
    is forced, or left undecided, at its own last reading. Other columns are kept in the result.

    Examples: bgmodel decide decisions.csv --period-mm 2 --delta 4;
    bgmodel decide mine.csv --taps decoded.parquet --task orientation --channels 4 --posterior 0.9;
    bgmodel decide decisions.parquet --evidence mine.csv --posterior 0.95
    """

    output: Positional[Path]
    """File for the table of trials, .parquet or .csv."""
    task: OmitArgPrefixes[Task] = TAPPED
    delta: float | None = None
    """Boundary separation (gap) of the SPRT, nats (two hypotheses); 4 unless posterior is given."""
    posterior: float | None = None
    """Posterior probability at which the MSPRT stops, instead of delta."""
    prior: tuple[float, ...] | None = None
    """Prior probabilities; equal by default."""
    onset_ms: float = 0.0
    """Time from the start of a trial to the onset of evidence, ms; for your own table."""
    forced: bool = True
    """Whether the deadline forces a response."""
    density: Density = field(default_factory=Density)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        check_ending("output", self.output, ".parquet", ".csv")
        self._check()
        trials = self._trials()
        evidence = trials.evidence
        test, threshold, model = self._test(evidence.hypotheses)
        decision = test.decide(evidence, threshold, forced=self.forced)
        own = self.task.file is not None
        seed = None if own else self.seed
        table = tables.trial_table(decision, trials, seed=seed, model=model)
        files.write_table(table, self.output, seed=seed, command=self._options())
        if own:
            self.note(trials.summary())
        self._show(table, known=evidence.truth is not None)

    def _show(self, table: pd.DataFrame, known: bool) -> None:
        """Show the number of decisions, their accuracy and mean number of readings."""
        right = table["correct"].dropna().astype(float) if known else None
        accuracy = "no truth given"
        if right is not None:
            of = "" if self.forced else " of those decided"
            accuracy = f"accuracy {right.mean():.3f}{of}" if len(right) else "no trial decided"
        about = {
            "trials": len(table),
            "accuracy": float(right.mean()) if right is not None and len(right) else None,
            "forced": int(table["forced"].sum()),
            "undecided": int(table["undecided"].sum()),
            "output": self.output,
        }
        text = (
            f"{len(table)} trials, {accuracy}, mean readings {table['steps'].mean():.2f}, forced "
            f"{about['forced']}, undecided {about['undecided']} -> {self.output}"
        )
        self.show(text, table, **about)

    def _options(self) -> dict[str, Any]:
        """Return the options in effect."""
        idle = {"posterior" if self.posterior is None else "delta"}
        idle |= {"onset_ms"} if self.task.file is None else set()
        idle |= set() if self._tactile else {"density"}
        return options_of(self, idle=idle, delta=self._gap())

    @property
    def _tactile(self) -> bool:
        return isinstance(self.task, Tactile)

    def _gap(self) -> float:
        return GAP_NATS if self.delta is None else self.delta

    def _check(self) -> None:
        """Refuse contradictory options before long work starts."""
        if self.posterior is not None and self.delta is not None:
            raise InputError(
                "delta and posterior both set the threshold: give one of them", "delta"
            )
        sprt_threshold_from_gap(self._gap())
        stream(self.seed)
        if self.task.file is None and self.onset_ms:
            raise InputError("onset_ms is for your own table, given by --evidence", "onset_ms")
        if not self._tactile and self.density != Density():
            raise InputError("density is for tactile evidence and has no effect here", "density")
        if self.task.file is None:
            check_evidence_memory(self.task.trials, self.task.t_max, self.task.channels)
            self._test(self.task.channels)

    def _test(self, hypotheses: int) -> tuple[Sprt | Msprt, float, str]:
        if self.posterior is not None:
            threshold = float(threshold_from_posterior(self.posterior, hypotheses))
            return Msprt(), threshold, f"msprt posterior={self.posterior:g}"
        if hypotheses != 2:
            raise InputError(
                f"a gap is for 2 hypotheses: with {hypotheses}, give --posterior", "delta"
            )
        gap = self._gap()
        return Sprt(), float(sprt_threshold_from_gap(gap)), f"sprt delta={gap:g}"

    def _trials(self) -> tables.Trials:
        if self.task.file is not None:
            from bgmodel.tables.evidence import read_evidence_table

            return read_evidence_table(
                self.task.file,
                prior=self.prior,
                onset_ms=self.onset_ms,
                step_ms=self.task.step_ms,
            )
        density = {"density": self.density} if self._tactile else {}
        return trials_of(self.task, self.seed, "decide", prior=self.prior, **density)
