"""The command that lets reward teach what readings mean."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Writes,
    bar,
    check_ending,
    check_whole,
    options_of,
    save_figure,
    say,
)
from bgmodel.learning.weights.critics import CRITICS
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.learning.weights.rules import RULES
from bgmodel.support import files
from bgmodel.support.memory import check_memory
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Task
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.learning.weights.features import Features, FeatureSource
    from bgmodel.learning.weights.learned import LearnedWeights

TAPPED = SameDifferent()
"""Default task."""
SCORED = 2000
"""Number of held-out trials on which weights are scored."""


@dataclass(frozen=True)
class WeightsLearn(Writes):
    """Learn from reward alone what readings of taps mean; compare with the exact likelihoods.

    Five of six folds of the taps are for learning; times and slopes are those on the sixth.

    Examples: bgmodel learn-weights weights.parquet --period-mm 2; bgmodel learn-weights weights.csv
    --drawing weights.png --runs 4 --learner.trials 2000
    """

    output: Positional[Path]
    """File for the table of weights, .parquet or .csv."""
    drawing: Path | None = None
    """File for a figure of learned against exact log-likelihoods, .pdf, .svg or .png."""
    task: OmitArgPrefixes[Task] = TAPPED
    """Tactile task."""
    units: int = 16
    """Number of sensory units."""
    rule: str = "confidence"
    """Rule that changes the weights: confidence, chosen, reinforce, covariance, hebbian, q or
    opal."""
    critic: str | None = None
    """Expected reward: mean, confidence, settled, read-out, criterion, affine or value; by default
    that of the rule."""
    posterior: float = 0.9
    """Posterior at which a trial stops."""
    runs: int = 8
    """Number of independent runs."""
    learner: WeightLearner = field(default_factory=WeightLearner)
    feedback: Feedback = field(default_factory=Feedback)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.learning.weights.deciders import FixedPoint
        from bgmodel.learning.weights.learn import learn_weights

        self._check()
        taps, held_out = self._sources()
        say(f"learning from {self.learner.trials} trials in each of {self.runs} runs")
        with bar(self.learner.trials):
            learned = learn_weights(
                taps,
                seed=self.seed,
                rule=self.rule,
                critic=self.critic,
                feedback=self.feedback,
                learner=self.learner,
                decider=FixedPoint(criterion=self.posterior),
                runs=self.runs,
            )
        test = held_out.draw(SCORED, rng=stream(self.seed, "learn-weights", "scored"))
        summary = _summary(learned, test)
        command = options_of(self)
        files.write_table(
            learned.to_dataframe(), self.output, seed=self.seed, summary=summary, command=command
        )
        print(
            f"slope {np.mean(summary['slope']):.2f} against the exact log-likelihoods (r = "
            f"{np.mean(summary['r']):.3f}), time at 90 % correct "
            f"{np.mean(summary['relative_time']):.3f} of that with them -> {self.output}"
        )
        if self.drawing is not None:
            save_figure(learned.plot(test), self.drawing)
            print(f"figure -> {self.drawing}")

    def _sources(self) -> tuple[FeatureSource, FeatureSource]:
        """Return the features of taps for learning and for scoring."""
        from bgmodel.learning.weights.sources import tap_features
        from bgmodel.tactile.source import load_taps

        task = self.task
        assert isinstance(task, Tactile)
        options = {"units": self.units, "fold": task.fold, "t_max": task.t_max}
        return tap_features(load_taps(task.taps), task, **options)

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        check_ending("output", self.output, ".parquet", ".csv")
        if not isinstance(self.task, Tactile):
            raise InputError.of("task", "must be a tactile task", self.task.name)
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
        check_whole(runs=self.runs)
        require(self.units >= 2, "units", "must be at least 2", self.units)
        require(self.rule in RULES, "rule", f"must be one of {', '.join(RULES)}", self.rule)
        known = self.critic is None or self.critic in CRITICS
        require(known, "critic", f"must be one of {', '.join(CRITICS)}", self.critic)
        between = 1 / self.task.channels < self.posterior < 1
        must = f"must be above {1 / self.task.channels:.3g}, chance, and below 1"
        require(between, "posterior", must, self.posterior)
        numbers = 8.0 * self.runs * (3 * self.learner.trials + 300.0 * self.task.t_max * self.units)
        check_memory(numbers, f"{self.runs} runs of {self.learner.trials} trials")


def _summary(learned: LearnedWeights, test: Features) -> dict[str, Any]:
    """Return slope, correlation and relative time of each run, for the result and its file."""
    found = learned.calibration(test)
    return {
        "slope": found.slope.tolist(),
        "r": found.r.tolist(),
        "relative_time": learned.relative_time(test, 0.9).tolist(),
    }
