"""The command that lets dopamine learn its level in a circuit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Writes,
    bar,
    check_ending,
    check_whole,
    made_with,
    say,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import Condition
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.learning.reinforce import Learner
from bgmodel.names import EngineName
from bgmodel.stimuli import Stimuli
from bgmodel.support import files
from bgmodel.support.arrays import Array
from bgmodel.support.memory import check_learning_memory, check_memory
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from bgmodel.learning.reinforce import Learned
    from bgmodel.learning.worlds import LevelOutcomes
    from bgmodel.tables.trials import Trials

TOUCHED = Stimuli(task="same-different", period_mm=1.5, trials=500, t_max=30)
POSTERIOR = 0.74
"""A threshold of 0.3 nats, which dopamine can move to posteriors of 0.75 to 0.99."""


def learning() -> Condition:
    """Return the default condition for learning."""
    return Condition(engine=EngineName("rate"), task=TOUCHED, posterior=POSTERIOR)


@dataclass(frozen=True)
class CircuitLearn(Writes):
    """Learn the level of dopamine from reward: the threshold is fixed, the gains change.

    The circuit first decides every trial at every level; each run then samples levels and draws
    the reward from those decisions. The level that is learned is tonic dopamine; the reward
    prediction error is phasic dopamine. The regret of the learned level is measured on as many
    fresh trials with fresh noise; of an evidence table, every second trial of each truth is kept
    for it. By default the circuit runs as rates without noise, so that levels differ by dopamine
    alone, and stops at a posterior of 0.74 at a level of 1, from where it can move both ways.

    Example: bgmodel circuit learn dopamine.parquet --start-level 1.6 --runs 5
    """

    output: Positional[Path]
    """File for the table of trials, .parquet or .csv."""
    condition: OmitArgPrefixes[Condition] = field(default_factory=learning)
    xi: float = 50.0
    """Cost of an error, readings."""
    start_level: float | None = None
    """Initial tonic level; by default the highest that the circuit can use."""
    levels: int = 16
    """Number of levels at which the circuit decides."""
    runs: int = 10
    """Number of independent runs."""
    learner: Learner = field(default_factory=Learner)

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.learning.dopamine import playable_levels
        from bgmodel.learning.dopamine_learner import (
            learn_level,
            learned_table,
            level_outcomes,
            regret,
        )
        from bgmodel.learning.reinforce import LearningStopped

        self._check()
        asked = self.condition
        trials = asked.drawn("learn")
        if asked.task.evidence is not None:
            print(trials.summary())
        evidence, fresh = self._learned_and_scored(trials)
        model = self._model(evidence)
        threshold_nats = asked.threshold_at(evidence.hypotheses)
        levels = playable_levels(model, self.levels, threshold_nats)
        start = self._start(levels, model.circuit.name)
        low, high = f"{levels[0]:.3f}", f"{levels[-1]:.3f}"
        say(f"{evidence.trials} trials at {self.levels} levels, {low} to {high}")
        say_before("learning in", model, evidence, runs=self.levels)
        with bar(self.levels * (evidence.trials + fresh.trials)):
            outcomes = level_outcomes(model, evidence, levels, threshold_nats)
            again = replace(model, seed=asked.seed + 1)
            scored = level_outcomes(again, fresh, levels, threshold_nats)
        behind: dict[str, Any] = {
            "seed": asked.seed,
            **made_with(self, model, condition=replace(asked, gain=model.gain)),
        }
        given: dict[str, Any] = {"runs": self.runs, "seed": asked.seed, "learner": self.learner}
        try:
            learned = learn_level(outcomes, xi=self.xi, start_level=start, name="learn", **given)
        except LearningStopped as stop:
            files.write_table(learned_table(stop.learned), self.output, **behind)
            raise ValueError(f"{stop}; learning up to then -> {self.output}") from None
        summary = self._summary(learned, scored)
        files.write_table(learned_table(learned), self.output, summary=summary, **behind)
        self._say_learned(summary, float(regret(start, scored, self.xi)))

    def _learned_and_scored(self, trials: Trials) -> tuple[Evidence, Evidence]:
        """Return the trials for learning, and others on which regret is measured."""
        if self.condition.task.evidence is None:
            return trials.evidence, self.condition.drawn("learn, scored").evidence
        if trials.evidence.trials < 2:
            raise InputError("evidence must hold 2 trials or more: half are scored", "evidence")
        # Every second trial of each truth: a table may list its truths in turn.
        order = np.argsort(needed_truth(trials.evidence), kind="stable")
        second = np.argsort(order, kind="stable") % 2 == 1
        return trials.evidence[~second], trials.evidence[second]

    def _model(self, evidence: Evidence) -> BasalGanglia:
        """Return the edited circuit on its engine."""
        say_of_edits(self.condition.edits)
        model = self.condition.model(evidence.hypotheses).adapted_to(evidence)
        model.circuit.check_nats("a stopping posterior that dopamine sets")
        model = replace(model, engine=model.engine.coarse())
        model.warn_beyond_range(evidence)
        return model

    def _start(self, levels: Array, name: str) -> float:
        """Return the initial level, checked against those that the circuit can use."""
        start = levels[-1] if self.start_level is None else self.start_level
        require(
            levels[0] <= start <= levels[-1],
            "start_level",
            f"must lie where {name} decides by evidence, {levels[0]:.3f}..{levels[-1]:.3f}",
            start,
        )
        return start

    def _summary(self, learned: Learned, fresh: LevelOutcomes) -> dict[str, Any]:
        """Return the summary stored with the table: learned level, its regret, best level."""
        from bgmodel.learning.dopamine_learner import regret

        cost = regret(learned.learned, fresh, self.xi)
        return {
            "level": learned.learned.tolist(),
            "regret": cost.tolist(),
            "best": fresh.best(self.xi),
        }

    def _say_learned(self, summary: dict[str, Any], start_regret: float) -> None:
        """Print the result of learning in one sentence."""
        levels = np.array(summary["level"])
        print(
            f"learned level {levels.mean():.2f} (sd {levels.std():.2f} over {self.runs} runs), "
            f"best of {self.levels} on fresh trials {summary['best'][0]:.2f}, regret "
            f"{100 * np.mean(summary['regret']):.1f} % (at the start {100 * start_regret:.0f} %) "
            f"-> {self.output}"
        )

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        from circuits.engines import engine_of

        asked = self.condition
        check_ending("output", self.output, ".parquet", ".csv")
        asked.task.check_idle(TOUCHED)
        if not engine_of(asked.engine).timed:
            raise InputError(f"{asked.engine} has no times to learn from: take rate", "engine")
        check_whole(runs=self.runs)
        check_learning_memory(self.runs, self.learner.episodes)
        numbers = 3 * 8.0 * self.levels * asked.task.trials
        check_memory(numbers, f"{self.levels} levels of {asked.task.trials} trials")
        require(self.levels >= 2, "levels", "must be >= 2", self.levels)
