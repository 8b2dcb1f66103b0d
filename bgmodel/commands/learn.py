"""The command that lets reward teach a threshold, a level of dopamine, or what readings mean."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Writes,
    check_ending,
    check_idle,
    options_of,
    recorded,
    save_figure,
    say,
    say_of_edits,
)
from bgmodel.conditions import Condition
from bgmodel.learning.reinforce import Learner
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.names import EngineName
from bgmodel.support import files
from bgmodel.tactile.task import SameDifferent
from circuits.errors import LearningWarning, quiet, require

if TYPE_CHECKING:
    from bgmodel.integrators.basal_ganglia import BasalGanglia

TOUCHED = SameDifferent(trials=4000, t_max=40)
"""Default task; its trials are those from which a circuit learns, and as many to score it."""


OF_WEIGHTS = ("rule", "critic", "weights", "feedback", "units")
"""Options of the learning of weights."""


def touched() -> Condition:
    """Return the default condition for learning."""
    return Condition(engine=EngineName("rate"), task=TOUCHED)


@dataclass(frozen=True)
class LearnRun(Writes):
    """Let reward move the threshold of the test or of a circuit, a level of dopamine, or weights.

    The threshold of the test is its boundary separation, and that of a circuit the posterior at
    which it decides. A circuit decides every trial at every value first; each run then samples
    values and draws the reward from those decisions. Its level of dopamine is tonic, and the reward
    prediction error phasic. Weights turn readings into evidence. Regret is the cost in excess of
    the best value, on trials that were not used for learning.

    Examples: bgmodel learn gap.parquet --period-mm 2 --xi 50;
    bgmodel learn dopamine.parquet --what dopamine --start 1.6 --runs 5;
    bgmodel learn weights.csv --what weights --drawing weights.png --runs 4
    """

    output: Positional[Path]
    """File for the course of learning, or for the weights, .parquet or .csv."""
    what: Literal["threshold", "dopamine", "weights"] = "threshold"
    """What reward moves."""
    by: Literal["test", "circuit"] | None = None
    """Who learns; by default the circuit learns a level of dopamine, and the test all else."""
    drawing: Path | None = None
    """File for a picture of the course, or of the weights, .pdf, .svg or .png."""
    condition: OmitArgPrefixes[Condition] = field(default_factory=touched)
    xi: float = 50.0
    """Cost of an error, readings."""
    start: float | None = None
    """Initial boundary separation (0.5 nats), level, or log odds of a circuit."""
    runs: int = 10
    """Number of independent runs."""
    levels: int = 16
    """Number of levels of dopamine at which the circuit decides."""
    units: int = 16
    """Number of sensory units whose weights are learned."""
    rule: str = "confidence"
    """Rule that changes weights: confidence, chosen, reinforce, covariance, hebbian, q or opal."""
    critic: str | None = None
    """Expected reward while weights are learned: mean, confidence, settled, read-out, criterion,
    affine or value; by default that of the rule."""
    learner: Learner = field(default_factory=Learner)
    weights: WeightLearner = field(default_factory=WeightLearner)
    feedback: Feedback = field(default_factory=Feedback)

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.learning.dopamine_learner import CircuitLearned
        from bgmodel.learning.from_reward import DOPAMINE, WEIGHTS, planned
        from bgmodel.learning.reinforce import LearningStopped, course

        check_ending("output", self.output, ".parquet", ".csv")
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
        self._check_idle()
        asked, model = self.condition, self._model()
        more: dict[str, Any] = {"learner": self.learner}
        if self.what == WEIGHTS:
            more = {"learner": self.weights, "rule": self.rule, "critic": self.critic,
                    "feedback": self.feedback, "units": self.units}  # fmt: skip
        elif self.what == DOPAMINE:
            more["levels"] = self.levels
        learns = planned(
            asked.task, model, what=self.what, xi=self.xi, runs=self.runs, seed=asked.seed,
            start=self.start, posterior=self._posterior(), trials=asked.task.trials, **more,
        )  # fmt: skip
        who = "the test" if model is None else f"{model.circuit.name} on {model.engine}"
        say(f"{who} learns {self.what}, {asked.task.text}, in {self.runs} runs")
        try:
            with quiet(LearningWarning):
                found = learns()
        except LearningStopped as stop:
            table = course(stop.learned, mean="mean", played="played", error="dopamine")
            files.write_table(table, self.output, seed=asked.seed, **self._behind(model))
            raise ValueError(f"{stop}; learning up to then -> {self.output}") from None
        summary = {
            "learned": found.learned.tolist(), "best": found.best,
            "regret_percent": found.regrets.to_dict("index"), "cautions": list(found.cautions),
        }  # fmt: skip
        used = found.found.model if isinstance(found.found, CircuitLearned) else model
        behind = self._behind(used)
        files.write_table(found.table, self.output, seed=asked.seed, summary=summary, **behind)
        at = f", gain {used.gain:g}" if used is not None else ""
        print(f"{found.verdict()}{at} -> {self.output}")
        for caution in found.cautions:
            print(caution)
        if self.drawing is not None:
            save_figure(found.plot(), self.drawing)
            print(f"figure -> {self.drawing}")

    def _check_idle(self) -> None:
        """Refuse options that have no effect on what is learned."""
        idle = ["learner", "xi"] if self.what == "weights" else sorted(OF_WEIGHTS)
        check_idle(self, idle, f"--what {self.what}")
        if self.what != "dopamine":
            check_idle(self, ["levels"], f"--what {self.what}")
        if not self._by_circuit:
            usual = replace(touched(), posterior=self.condition.posterior)
            for name in ("circuit", "edits", "engine", "gain", "threshold"):
                given = getattr(self.condition, name)
                must = "has no effect on the test: leave it out, or let the circuit learn"
                require(given == getattr(usual, name), name, must, given)

    @property
    def _by_circuit(self) -> bool:
        """Whether the circuit learns."""
        return self.by == "circuit" or (self.by is None and self.what == "dopamine")

    def _posterior(self) -> float | None:
        """Return the posterior at which a circuit stops, also if a threshold is given."""
        threshold = self.condition.threshold
        return self.condition.posterior if threshold is None else math.exp(-threshold)

    def _behind(self, model: BasalGanglia | None) -> dict[str, Any]:
        """Return the options in effect and the circuit, for the provenance of the result."""
        from bgmodel.integrators.given import identity

        idle = {"learner", "xi", "start"} if self.what == "weights" else {*OF_WEIGHTS}
        if self.what != "dopamine":
            idle |= {"levels"}
        if model is None:
            options = options_of(self, idle=idle | {"condition"})
            return {"command": options | {"task": recorded(self.condition.task)}}
        settled = replace(self.condition, gain=model.gain)
        options = options_of(self, idle=idle, condition=settled)
        return {"command": options, "circuit": identity(model.circuit)}

    def _model(self) -> BasalGanglia | None:
        """Return the edited circuit on its engine; None if the test learns."""
        if not self._by_circuit:
            return None
        say_of_edits(self.condition.edits)
        model = self.condition.model(self.condition.task.channels)
        return replace(model, engine=model.engine.coarse())
