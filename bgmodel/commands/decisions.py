"""Commands on evidence: decide by the sequential test; learn its gap from reward."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import Shows, Writes, check_ending, check_whole, options_of, say
from bgmodel.deciding.reward import check_xi
from bgmodel.integrators.sprt import Msprt, Sprt, sprt_threshold_from_gap, threshold_from_posterior
from bgmodel.learning.policies import BernoulliPolicy
from bgmodel.learning.reinforce import Learner
from bgmodel.stimuli import Stimuli
from bgmodel.support import files
from bgmodel.support.memory import check_evidence_memory, check_learning_memory
from bgmodel.support.seeds import stream
from bgmodel.tables import trials as tables
from bgmodel.tactile.likelihood import Density
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

GAP_NATS = 4.0
"""Default gap of `decide`, nats."""
TAPPED = Stimuli(task="same-different", trials=1000, t_max=30, step_ms=500.0)
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
    task: OmitArgPrefixes[Stimuli] = TAPPED
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
        own = self.task.evidence is not None
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
        idle |= {"onset_ms"} if self.task.evidence is None else set()
        idle |= set() if self._tactile else {"density"}
        return options_of(self, idle=idle, delta=self._gap())

    @property
    def _tactile(self) -> bool:
        return self.task.evidence is None and self.task.task != "gaussian"

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
        self.task.check()
        self.task.check_idle(replace(TAPPED, task=self.task.task))
        if self.task.evidence is None and self.onset_ms:
            raise InputError("onset_ms is for your own table, given by --evidence", "onset_ms")
        if not self._tactile and self.density != Density():
            raise InputError("density is for tactile evidence and has no effect here", "density")
        if self.task.evidence is None:
            hypotheses = 2 if self.task.task == "same-different" else self.task.channels
            check_evidence_memory(self.task.trials, self.task.t_max, hypotheses)
            self._test(hypotheses)

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
        if self.task.evidence is not None:
            from bgmodel.tables.evidence import read_evidence_table

            return read_evidence_table(
                self.task.evidence,
                prior=self.prior,
                onset_ms=self.onset_ms,
                step_ms=self.task.step_ms,
            )
        density = self.density if self._tactile else None
        return self.task.draw(self.seed, "decide", prior=self.prior, density=density)


@dataclass(frozen=True)
class GapLearn(Writes):
    """Learn the gap from reward by REINFORCE with a baseline, and compare it with the optimum.

    Example: bgmodel learn learning.parquet --period-mm 2 --xi 50 --start-delta 0.5
    """

    output: Positional[Path]
    """File for the table of trials, .parquet or .csv."""
    task: Literal["same-different", "orientation", "edge-turn", "edge-direction"] = "same-different"
    """Tactile task with two alternatives."""
    period_mm: float = 2.0
    """Period of the grating, mm."""
    step_deg: float = 5.0
    """Degrees between the two alternatives of a task with edges."""
    taps: Path | None = None
    """Taps decoded by `bgmodel decode`; by default the shipped ones."""
    xi: float = 50.0
    """Cost of an error, readings."""
    start_delta: float = 0.5
    """Initial gap, nats, 0..8."""
    runs: int = 10
    """Number of independent runs."""
    fold: int = 0
    """Which sixth of the held-out taps is used for learning, 0..5."""
    t_max: int = 30
    """Largest number of readings in a trial."""
    policy: Literal["gaussian", "bernoulli"] = "gaussian"
    """Policy: Gaussian over the gap, or the Bernoulli units of Lepora 2016."""
    learner: Learner = field(default_factory=Learner)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.learning.gap import check_start, learn_gap

        check_ending("output", self.output, ".parquet", ".csv")
        check_whole(runs=self.runs, t_max=self.t_max)
        check_xi(self.xi)
        check_start(self.start_delta)
        check_learning_memory(self.runs, self.learner.episodes)
        # The range of the Gaussian one depends on the best gap.
        policy = BernoulliPolicy() if self.policy == "bernoulli" else None
        asked = Stimuli(
            task=self.task, period_mm=self.period_mm, step_deg=self.step_deg, taps=self.taps,
            fold=self.fold,
        )  # fmt: skip
        asked.check()
        asked.check_idle()
        readings = asked.readings()
        say(f"learning {readings.where}, {self.runs} runs of {self.learner.episodes} episodes")
        grating = asked.task in ("same-different", "orientation")
        table, summary = learn_gap(
            readings,
            name=(self.period_mm if grating else self.step_deg, self.fold),
            xi=self.xi,
            start_delta=self.start_delta,
            runs=self.runs,
            t_max=self.t_max,
            policy=policy,
            learner=self.learner,
            seed=self.seed,
        )
        files.write_table(
            table,
            self.output,
            seed=self.seed,
            summary=summary,
            command=options_of(self, idle={"step_deg"} if grating else {"period_mm"}),
        )
        learned = np.asarray(summary["learned_delta"])
        print(
            f"learned gap {learned.mean():.2f} nats (sd {learned.std():.2f} over {self.runs} "
            f"runs), exact optimum {summary['optimal_delta']:.2f} nats, regret "
            f"{100 * np.mean(summary['regret']):.2f} % -> {self.output}"
        )
