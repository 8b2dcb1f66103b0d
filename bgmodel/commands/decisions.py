"""Commands on evidence: decide by the sequential test, learn its gap from reward."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from tyro.conf import Positional

from bgmodel import files, tables
from bgmodel.commands.checks import asked, check_ending, check_whole
from bgmodel.decision import first_crossing
from bgmodel.learning import Learner
from bgmodel.policies import BernoulliPolicy, GaussianPolicy
from bgmodel.seeds import stream
from bgmodel.sprt import Msprt, Sprt, threshold_from_gap
from bgmodel.tactile.likelihood import Density


@dataclass(frozen=True)
class Decide:
    """Decide by the sequential test: on tactile evidence, or on a table of your own.

    A table has one row a reading with the columns trial, step, ll_<hypothesis> (natural log
    likelihoods; two or more such columns) and, if known, truth.

    Examples: bgmodel decide decisions.csv --period-mm 2 --delta 4;
    bgmodel decide decisions.parquet --evidence mine.csv --posterior 0.95
    """

    output: Positional[Path]
    """Where the trial table goes, .parquet or .csv."""
    evidence: Path | None = None
    """A table of log-likelihoods, .csv or .parquet; tactile evidence if left out."""
    delta: float | None = None
    """Gap between the two bounds of the SPRT, nats (two hypotheses); 4 if no criterion is given."""
    posterior: float | None = None
    """Posterior probability at which the MSPRT stops, instead of delta."""
    prior: tuple[float, ...] | None = None
    """Prior probabilities; equal if left out."""
    task: Literal["same-different", "orientation"] = "same-different"
    """Tactile question: are two gratings the same, or which of N orientations is it."""
    orientations: int = 4
    """N for the orientation task, 2..8."""
    period_mm: float = 2.0
    """Period of the tactile grating, mm."""
    fold: int = 0
    """Which sixth of the held-out taps is scored, 0..5."""
    trials: int = 1000
    """Tactile trials."""
    t_max: int = 30
    """Most readings in a tactile trial."""
    step_ms: float = 500.0
    """Time between readings, ms; assumed."""
    onset_ms: float = 0.0
    """Time from the start of a trial of your own table to the onset of evidence, ms."""
    forced: bool = True
    """Whether the deadline forces a response."""
    density: Density = field(default_factory=Density)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        check_ending(self.output, ".parquet", ".csv")
        files.check_writable(self.output.parent)
        self._check()
        evidence, names = self._evidence()
        test, threshold, model = self._test(evidence.hypotheses)
        decision = first_crossing(test.run(evidence), threshold, forced=self.forced)
        table = tables.trial_table(decision, evidence, seed=self.seed, model=model, names=names)
        files.write_table(table, self.output, seed=self.seed, command=asked(self))
        known = evidence.truth is not None
        accuracy = f"accuracy {table['correct'].mean():.3f}" if known else "no truth given"
        print(
            f"{len(table)} trials, {accuracy}, mean readings {np.nanmean(decision.steps):.2f}, "
            f"undecided {table['undecided'].sum()} -> {self.output}"
        )

    def _check(self) -> None:
        """Refuse what contradicts itself, before long work starts."""
        if self.posterior is not None and not 0 < self.posterior < 1:
            raise ValueError(f"posterior must lie between 0 and 1, got {self.posterior}")
        if self.posterior is not None and self.delta is not None:
            raise ValueError("delta and posterior are two ways to say one thing: give one of them")
        threshold_from_gap(0.0 if self.delta is None else self.delta)
        if self.evidence is None:
            return
        default = Decide(self.output)
        for name in ("task", "orientations", "period_mm", "fold", "trials", "t_max", "density"):
            if getattr(self, name) != getattr(default, name):
                raise ValueError(
                    f"{name} is for tactile evidence, it says nothing about {str(self.evidence)!r}"
                )

    def _test(self, hypotheses: int) -> tuple[Sprt | Msprt, float, str]:
        if self.posterior is not None:
            return Msprt(), float(-np.log(self.posterior)), f"msprt posterior={self.posterior:g}"
        if hypotheses != 2:
            raise ValueError(f"a gap is for 2 hypotheses: with {hypotheses}, give --posterior")
        gap = 4.0 if self.delta is None else self.delta
        return Sprt(), float(threshold_from_gap(gap)), f"sprt delta={gap:g}"

    def _evidence(self):
        if self.evidence is not None:
            return tables.evidence_from_table(
                files.read_table(self.evidence),
                prior=self.prior,
                onset_ms=self.onset_ms,
                step_ms=self.step_ms,
            )
        from bgmodel.tactile.task import Orientations, SameDifferent, held_out_taps, source

        same = self.task == "same-different"
        task = SameDifferent() if same else Orientations(self.orientations)
        readings = source(
            held_out_taps(), task, period_mm=self.period_mm, fold=self.fold, density=self.density
        )
        rng = stream(self.seed, "decide")
        drawn = readings.draw(
            self.trials, self.t_max, rng=rng, prior=self.prior, step_ms=self.step_ms
        )
        return drawn, list(task.names)


@dataclass(frozen=True)
class Learn:
    """Learn the gap from reward by REINFORCE with baseline, beside the exact optimum.

    Example: bgmodel learn learning.parquet --period-mm 2 --xi 50 --start-delta 0.5
    """

    output: Positional[Path]
    """Where the table of trials goes, .parquet or .csv."""
    period_mm: float = 2.0
    """Period of the grating, mm."""
    xi: float = 50.0
    """Cost of an error, readings."""
    start_delta: float = 0.5
    """Gap at the start, nats, 0..8."""
    runs: int = 10
    """Independent repeats."""
    fold: int = 0
    """Which sixth of the held-out taps is learned on, 0..5."""
    t_max: int = 30
    """Most readings in a trial."""
    policy: Literal["gaussian", "bernoulli"] = "gaussian"
    """Gaussian over the gap, or the Bernoulli units of Lepora 2016."""
    learner: Learner = field(default_factory=Learner)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.study import learn_grating

        check_ending(self.output, ".parquet", ".csv")
        files.check_writable(self.output.parent)
        check_whole(runs=self.runs, t_max=self.t_max)
        policy = GaussianPolicy() if self.policy == "gaussian" else BernoulliPolicy()
        table, summary = learn_grating(
            self.period_mm,
            xi=self.xi,
            start_delta=self.start_delta,
            runs=self.runs,
            fold=self.fold,
            t_max=self.t_max,
            policy=policy,
            learner=self.learner,
            seed=self.seed,
        )
        files.write_table(table, self.output, seed=self.seed, command=asked(self), summary=summary)
        learned = np.asarray(summary["learned_delta"])
        print(
            f"learned delta {learned.mean():.2f} (sd {learned.std():.2f} over {self.runs} runs), "
            f"exact optimum {summary['optimal_delta']:.2f}, regret "
            f"{100 * np.mean(summary['regret']):.2f} % -> {self.output}"
        )
