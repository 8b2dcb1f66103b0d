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
from bgmodel.support import files
from bgmodel.support.arrays import Array
from bgmodel.support.memory import check_learning_memory, check_memory
from bgmodel.tactile.task import SameDifferent
from circuits.errors import InputError, LearningWarning, quiet, require

if TYPE_CHECKING:
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from bgmodel.tables.trials import Trials

TOUCHED = SameDifferent(1.5, trials=4000, t_max=40)
POSTERIOR = 0.68
"""A threshold of 0.39 nats, which dopamine can move to posteriors of 0.68 to 0.99."""


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
    alone, and stops at a posterior of 0.68 at a level of 1, from where it can move both ways.

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
        from bgmodel.learning.dopamine_learner import learn_in_circuit, learned_table
        from bgmodel.learning.reinforce import LearningStopped

        self._check()
        asked = self.condition
        trials = asked.drawn("learn")
        if asked.task.file is not None:
            print(trials.summary())
        evidence, fresh = self._learned_and_scored(trials)
        model = self._model(evidence)
        threshold_nats = asked.threshold_at(evidence.hypotheses)
        levels = playable_levels(model, self.levels, threshold_nats)
        start = self._start(levels, model.circuit.name)
        low, high = f"{levels[0]:.3f}", f"{levels[-1]:.3f}"
        say(f"{evidence.trials} trials at {self.levels} levels, {low} to {high}")
        say_before("learning in", model, evidence, runs=self.levels)
        behind: dict[str, Any] = {
            "seed": asked.seed,
            **made_with(self, model, condition=replace(asked, gain=model.gain)),
        }
        try:
            with bar(self.levels * (evidence.trials + fresh.trials)), quiet(LearningWarning):
                found = learn_in_circuit(
                    model, evidence, fresh, levels=levels, threshold_nats=threshold_nats,
                    xi=self.xi, start=start, runs=self.runs, seed=asked.seed, learner=self.learner,
                )  # fmt: skip
        except LearningStopped as stop:
            files.write_table(learned_table(stop.learned), self.output, **behind)
            raise ValueError(f"{stop}; learning up to then -> {self.output}") from None
        summary = {
            "level": found.learned.learned.tolist(),
            "regret": found.summary()["regret"].tolist(),
            "best": found.fresh.best(self.xi),
            "cautions": found.cautions,
        }
        files.write_table(found.to_dataframe(), self.output, summary=summary, **behind)
        print(f"{found.verdict()}, gain {model.gain:g} -> {self.output}")
        for caution in found.cautions:
            print(caution)

    def _learned_and_scored(self, trials: Trials) -> tuple[Evidence, Evidence]:
        """Return the trials for learning, and others on which regret is measured."""
        if self.condition.task.file is None:
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

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        from circuits.engines import engine_of

        asked = self.condition
        check_ending("output", self.output, ".parquet", ".csv")
        if not engine_of(asked.engine).timed:
            raise InputError(f"{asked.engine} has no times to learn from: take rate", "engine")
        check_whole(runs=self.runs)
        check_learning_memory(self.runs, self.learner.episodes)
        numbers = 3 * 8.0 * self.levels * asked.task.trials
        check_memory(numbers, f"{self.levels} levels of {asked.task.trials} trials")
        require(self.levels >= 2, "levels", "must be >= 2", self.levels)
