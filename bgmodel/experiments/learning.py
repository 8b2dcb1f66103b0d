"""Learning before an experiment: the circuit decides on weights that reward has taught."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bgmodel.learning.critics import CRITICS
from bgmodel.learning.deciders import Feedback, WeightLearner
from bgmodel.learning.feature_sources import (
    UNITS,
    FeatureSource,
    GaussianFeatures,
    tap_features,
)
from bgmodel.learning.weight_rules import RULES
from bgmodel.support import toml_files
from bgmodel.support.checks import check_range, whole
from bgmodel.support.processes import check_memory
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import Tactile
from bgmodel.task import Gaussian, Task
from circuits.checks import check_types
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.evidence import Evidence
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from bgmodel.learning.features import Features
    from bgmodel.learning.learned_weights import LearnedWeights


@dataclass(frozen=True)
class Learning:
    """Weights from sensory units to channels, learned from reward before the trials that count.

    Several runs learn independently; the trials that count are divided among them. Readings that
    teach and readings that count are different ones.

    Raises
    ------
    ValueError
        For an unknown rule or critic, or a number out of range.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    trials: int = 3000
    """Number of trials of learning in each run."""
    runs: int = 12
    """Number of independent runs."""
    rule: str = "confidence"
    """Rule that changes the weights."""
    critic: str | None = None
    """Expected reward; by default that of the rule, or, in the circuit, the posterior read from
    SNr."""
    in_circuit: bool = False
    """Whether the circuit of the condition, with its edits, decides while it learns; otherwise its
    fixed point without edits does, which is faster."""
    posterior: float = 0.9
    """Posterior at which trials of learning stop."""
    gain_plus: float = 1.0
    """Factor on positive errors of the reward."""
    gain_minus: float = 1.0
    """Factor on negative errors of the reward."""
    valid: float = 1.0
    """Share of trials with valid feedback; it is reversed in the others."""
    units: int = UNITS
    """Number of sensory units; with Gaussian evidence, for each channel."""

    def __post_init__(self) -> None:
        check_types(self, type(self).__name__)
        require(self.rule in RULES, "rule", f"must be one of {', '.join(RULES)}", self.rule)
        known = self.critic is None or self.critic in list(CRITICS)
        require(known, "critic", f"must be one of {', '.join(CRITICS)}", self.critic)
        whole("runs", self.runs, 1)
        whole("units", self.units, 2)
        check_range(0, 1, posterior=self.posterior)
        self._learner()
        self._feedback()

    def text(self) -> str:
        """Return trials and rule, and the settings that differ from the default."""
        plain = Learning(trials=self.trials, rule=self.rule)
        others = {k: v for k, v in vars(self).items() if v != getattr(plain, k)}
        more = "".join(f", {name} {value}" for name, value in others.items())
        return f"learned from {self.trials} trials by the rule {self.rule}{more}"

    def check(self, task: Task) -> None:
        """Raise ValueError for a task without sensory units, or learning that does not fit it."""
        if not isinstance(task, Gaussian | Tactile):
            raise InputError(
                "an evidence table has no sensory units to learn from: [learning] needs Gaussian "
                "evidence or a tactile task",
                "learning",
            )
        for name in ("conflict", "expectancy_nats"):
            value = getattr(task, name, 0.0)
            require(value == 0, name, "must be 0 with [learning]", value)
        chance = 1 / task.channels
        must = f"must be above {chance:.3g}, chance, and below 1"
        require(chance < self.posterior < 1, "posterior", must, self.posterior, owner="learning")
        # Blocks of 250 trials of each run are drawn at a time, and a sample of 1000.
        units = self.units * (task.channels if isinstance(task, Gaussian) else 1)
        drawn = (300.0 * self.runs + 1000 + task.trials) * task.t_max * units
        what = f"{self.runs} runs of {self.trials} trials with {self.units} units"
        check_memory(8.0 * (3 * self.runs * self.trials + drawn), what)

    def features(self, task: Task, seed: int) -> Features:
        """Return the readings that count, with their sensory units and exact likelihoods."""
        return self._sources(task)[1].draw(task.trials, rng=stream(seed, "experiment"))

    def learned(self, task: Task, model: BasalGanglia, seed: int) -> LearnedWeights:
        """Return the weights of each run."""
        from bgmodel.learning.deciders import FixedPoint, InCircuit
        from bgmodel.learning.weights import learn_weights

        same: dict[str, Any] = {
            "seed": seed, "rule": self.rule, "critic": self.critic, "runs": self.runs,
            "learner": self._learner(), "feedback": self._feedback(), "name": "experiment",
        }  # fmt: skip
        source = self._sources(task)[0]
        at = self.posterior
        decider = InCircuit(model, at) if self.in_circuit else FixedPoint(criterion=at)
        return learn_weights(source, decider=decider, **same)

    def _sources(self, task: Task) -> tuple[FeatureSource, FeatureSource]:
        """Return the readings that teach, and those that count."""
        timing: dict[str, Any] = {"t_max": task.t_max, "step_ms": task.step_ms}
        if isinstance(task, Gaussian):
            drawn = GaussianFeatures(task.d_prime, task.channels, self.units, **timing)
            return drawn, drawn
        from bgmodel.tactile.source import load_taps

        assert isinstance(task, Tactile)
        taps = load_taps(task.taps)
        return tap_features(taps, task, units=self.units, fold=task.fold, **timing)

    def _learner(self) -> WeightLearner:
        return WeightLearner(
            trials=self.trials, gain_plus=self.gain_plus, gain_minus=self.gain_minus
        )

    def _feedback(self) -> Feedback:
        return Feedback(valid=self.valid)


def heard(learned: LearnedWeights, features: Features) -> Evidence:
    """Return the learned drive of readings as evidence; trial k is that of run k modulo runs."""
    run = np.arange(features.trials) % learned.runs
    return features.evidence(np.einsum("tsu,thu->tsh", features.values, learned.weights[run]))
