"""Weights learned from reward, against the exact likelihoods: make score.

What the confidence rule learns over trials on taps and Poisson cells, and counts of as many
readings whose truth is known, and other rules and critics. A circuit in the loop is in
``weights_loop``. Evaluated on a seed that tuned nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.learning.deciders import FixedPoint, WeightLearner
from bgmodel.learning.learned_weights import LearnedWeights, counted_weights
from bgmodel.learning.weights import learn_weights
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from figures.learning.tasks import (
    MEASURES,
    RUNS,
    SCORING_SEED,
    TRIALS,
    TaskReadings,
    each_run,
    gratings,
    mean_se,
    of_taps,
    parts_of,
    scores,
)
from figures.pieces import Piece, Score

AFTER = (100, 300, 1000, 3000, 10_000, 30_000)
"""Trials after which weights are scored."""
AVERAGED = 0.25
"""Share of the last trials over which weights are averaged."""
CONFIDENCE, CHOSEN, COUNTS = "confidence", "chosen", "counts"
RULES: tuple[tuple[str, str | None], ...] = (
    ("confidence", None), ("chosen", None), ("confidence", "mean"), ("chosen", "mean"),
    ("reinforce", None), ("hebbian", None), ("opal", None),
)  # fmt: skip
"""Rules and their critics; the rule's own if None."""
RULES_AFTER = (10_000, 40_000)
THREE = FixedPoint(sampled=3, drawn=True)
"""Three readings in every trial, and a choice drawn from the posterior."""
READINGS_DEG = np.arange(-130.0, 131.0, 2.5)
SHOWN_AFTER = (100, 1000, 10_000)
FAST_TRIALS = 1000


def learned_over_trials(name: str, trials: int) -> pd.DataFrame:
    """Return slope, r and relative time of a task over trials, by rule, and those of counts."""
    parts = parts_of(name)
    labels = [name] if len(parts) == 1 else [f"{name} {k}" for k in range(len(parts))]
    rows = pd.concat(
        [
            _part_over_trials(task, label, rule, trials, RUNS // len(parts))
            for task, label in zip(parts, labels, strict=True)
            for rule in (CONFIDENCE, CHOSEN)
        ]
    )
    summaries = []
    for (rule, after), each in rows.groupby(["rule", "after"], sort=False):
        known = {"task": name, "rule": rule, "after": after, "runs": len(each)}
        known |= {"correct": each["correct"].mean(), "readings": each["readings"].mean()}
        summaries.append(
            known | {k: v for one in MEASURES for k, v in mean_se(one, each[one]).items()}
        )
    held_out = np.sum([np.nan if part.held_out is None else part.held_out for part in parts])
    return pd.DataFrame(summaries).assign(held_out=held_out)


def _part_over_trials(
    task: TaskReadings, label: str, rule: str, trials: int, runs: int
) -> pd.DataFrame:
    """Return the scores of each run of a rule over trials, and of counts of as many readings."""
    learned = learn_weights(
        task.learned, seed=SCORING_SEED, rule=rule, runs=runs, name=label,
        learner=WeightLearner(trials=trials, keep=max(trials // 25, 1)),
    )  # fmt: skip
    course = learned.course
    assert course is not None
    parts = []
    for after in [n for n in AFTER if n <= trials]:
        then = learned.after(after, AVERAGED)
        heard = course.readings[:, :after].sum(axis=1).mean()
        right = course.correct[:, max(after - 100, 0) : after].mean()
        known = {"after": after, "readings": heard}
        parts.append(scores(then, task, label, rule=rule, correct=right, **known))
        if rule == CONFIDENCE:
            counted = _counted(task, label, round(heard), runs)
            parts.append(scores(counted, task, label, rule=COUNTS, correct=np.nan, **known))
    return pd.concat(parts)


def _counted(task: TaskReadings, name: str, readings: int, runs: int) -> LearnedWeights:
    """Return weights from counts of readings with the truth known, as several runs."""
    rng = stream(SCORING_SEED, "counts", name, readings)
    steps = task.learned.draw(1, rng=0).steps
    weights = []
    for _ in range(runs):
        drawn = task.learned.draw(max(-(-readings // steps), 20), rng=rng)
        weights.append(counted_weights(drawn, readings=readings))
    return LearnedWeights(np.concatenate([one.weights for one in weights]), weights[0].names)


def ratios_over_trials() -> pd.DataFrame:
    """Return learned and exact log-likelihood ratios of single readings of 2 mm, over degrees."""
    pool, _ = gratings()
    learner = WeightLearner(trials=max(SHOWN_AFTER), keep=400)
    learned = learn_weights(pool, seed=SCORING_SEED, runs=RUNS, learner=learner)
    likelihood = source(held_out_taps(), SameDifferent(2.0), fold=0).likelihood(READINGS_DEG)
    exact = likelihood[:, 1] - likelihood[:, 0]
    activity = pool.activity(READINGS_DEG)
    parts = []
    for after in SHOWN_AFTER:
        w = learned.after(after, AVERAGED).weights
        ratio = activity @ (w[:, 1] - w[:, 0]).T
        parts.append(pd.DataFrame({
            "after": after, "reading_deg": READINGS_DEG, "exact_nats": exact,
            "learned_nats": ratio.mean(axis=1), "learned_sd": ratio.std(axis=1, ddof=1),
        }))  # fmt: skip
    return pd.concat(parts, ignore_index=True)


def rules(rule: str, critic: str | None, most: int) -> pd.DataFrame:
    """Return slope, r and relative time of a rule on gratings of 2 mm, by stopping and trials."""
    rows = []
    for stopping, decider, t_max in (
        ("at a posterior of 0.9", FixedPoint(), 40), ("after 3 readings", THREE, 4),
    ):  # fmt: skip
        task, taught = parts_of("2 mm")[0], of_taps(SameDifferent(2.0), t_max).learned
        learned = learn_weights(
            taught, seed=SCORING_SEED, rule=rule, critic=critic, decider=decider, runs=RUNS,
            learner=WeightLearner(trials=most, keep=400),
        )  # fmt: skip
        known = {"rule": rule, "critic": critic or "the rule's", "stopping": stopping}
        for after in sorted({min(n, most) for n in RULES_AFTER}):
            then = learned.after(after, AVERAGED)
            rows.append(known | {"after": after} | each_run(then, task, "2 mm"))
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per task and rule; threads are not used."""
    most = FAST_TRIALS if fast else max(RULES_AFTER)
    for name, trials in TRIALS.items():
        trials = min(most, trials)
        yield Piece("course", name, trials, 170, partial(learned_over_trials, name, trials))
    for rule, critic in RULES:
        name = f"{rule} {critic or ''}".strip()
        yield Piece("rules", name, most, 60, partial(rules, rule, critic, most))
    if not fast:
        yield Piece("ratios", "2 mm", max(SHOWN_AFTER), 5, ratios_over_trials)


SCORE = Score("weights", SCORING_SEED, (), pieces, circuit="")
