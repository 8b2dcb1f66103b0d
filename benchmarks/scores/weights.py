"""Weights learned from reward, against the exact likelihoods: make score.

What the confidence rule learns over trials on taps and Poisson cells, and counts of as many
readings whose truth is known; other rules and critics; unequal gains and unreliable feedback;
changes of the labels and of the sensor (``learned.changes``); weights and gap together. A circuit
in the loop is in ``weights_loop``. Evaluated on a seed that tuned nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.scores.learned.changes import CHANGES, changed, summaries
from benchmarks.scores.learned.tasks import (
    MEASURES,
    RUNS,
    SCORING_SEED,
    TRIALS,
    Taught,
    each_run,
    gratings,
    mean_se,
    of_taps,
    parts_of,
    scores,
)
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel import stream
from bgmodel.learning.weights.critics import Affine, Critic
from bgmodel.learning.weights.deciders import FixedPoint
from bgmodel.learning.weights.feedback import Feedback, WeightLearner
from bgmodel.learning.weights.learn import learn_weights
from bgmodel.learning.weights.learned import LearnedWeights, counted_weights
from bgmodel.learning.weights.with_gap import learn_weights_and_gap
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent

AFTER = (100, 300, 1000, 3000, 10_000, 30_000)
"""Trials after which weights are scored."""
AVERAGED = 0.25
"""Share of the last trials over which weights are averaged."""
CONFIDENCE, CHOSEN, COUNTS, D1_ALONE = "confidence", "chosen", "counts", "confidence, D1 alone"
RULES: tuple[tuple[str, str | None], ...] = (
    ("confidence", None), ("chosen", None), ("confidence", "mean"), ("chosen", "mean"),
    ("reinforce", None), ("covariance", None), ("hebbian", None), ("q", None), ("opal", None),
)  # fmt: skip
"""Rules and their critics; the rule's own if None."""
RULES_AFTER = (10_000, 40_000)
THREE = FixedPoint(sampled=3, drawn=True)
"""Three readings in every trial, and a choice drawn from the posterior."""
RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Gain of positive relative to that of negative errors."""
VALID = (1.0, 0.95, 0.9, 0.8)
XIS, STARTS = (10.0, 50.0), (1.0, 8.0)
"""Costs of an error in readings, and initial gaps, nats."""
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
    found = []
    for (rule, after), each in rows.groupby(["rule", "after"], sort=False):
        known = {"task": name, "rule": rule, "after": after, "runs": len(each)}
        known |= {"correct": each["correct"].mean(), "readings": each["readings"].mean()}
        found.append(known | {k: v for one in MEASURES for k, v in mean_se(one, each[one]).items()})
    held_out = np.sum([np.nan if part.held_out is None else part.held_out for part in parts])
    return pd.DataFrame(found).assign(held_out=held_out)


def _part_over_trials(task: Taught, label: str, rule: str, trials: int, runs: int) -> pd.DataFrame:
    """Return the scores of each run of a rule over trials, and of counts of as many readings."""
    learned = learn_weights(
        task.learned, seed=SCORING_SEED, rule=rule, runs=runs, name=label,
        learner=WeightLearner(trials=trials, keep=max(trials // 25, 1)),
    )  # fmt: skip
    course = learned.course
    assert course is not None
    found = []
    for after in [n for n in AFTER if n <= trials]:
        then = learned.after(after, AVERAGED)
        heard = course.readings[:, :after].sum(axis=1).mean()
        right = course.correct[:, max(after - 100, 0) : after].mean()
        known = {"after": after, "readings": heard}
        found.append(scores(then, task, label, rule=rule, correct=right, **known))
        if rule == CONFIDENCE:
            counted = _counted(task, label, round(heard), runs)
            found.append(scores(counted, task, label, rule=COUNTS, correct=np.nan, **known))
            if len(learned.names) > 2:
                alone = {"rule": D1_ALONE, "correct": np.nan, "stn": False}
                found.append(scores(then, task, label, **alone, **known))
    return pd.concat(found)


def _counted(task: Taught, name: str, readings: int, runs: int) -> LearnedWeights:
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
    found = []
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
            found.append(known | {"after": after} | each_run(then, task, "2 mm"))
    return pd.DataFrame(found)


def asymmetry(ratio: float, most: int) -> pd.DataFrame:
    """Return by how much unequal gains shift the log odds, after 10 000 and 40 000 trials."""
    rows = []
    for trials in sorted({min(n, most) for n in RULES_AFTER}):
        learner = WeightLearner(trials=trials, gain_plus=ratio)
        learned = learn_weights(gratings()[0], seed=SCORING_SEED, runs=RUNS, learner=learner)
        assert learned.course is not None
        shift = mean_se("shift_nats", learned.course.overconfidence())
        rows.append({"ratio": ratio, "after": trials, "law_nats": np.log(ratio)} | shift)
    return pd.DataFrame(rows)


def feedback(valid: float, trials: int) -> pd.DataFrame:
    """Return slope, r and relative time if feedback is valid in a share of the trials."""
    critics: dict[str, Critic | str] = {
        "confidence": "confidence", "affine, share known": Affine(valid=valid),
        "affine, share learned": Affine(valid=0.95, rate=0.01), "mean reward": "mean",
    }  # fmt: skip
    rows: list[dict[str, Any]] = []
    for name, critic in critics.items():
        learned = learn_weights(
            gratings()[0], seed=SCORING_SEED, critic=critic, feedback=Feedback(valid=valid),
            runs=RUNS, learner=WeightLearner(trials=trials),
        )  # fmt: skip
        scored = each_run(learned, parts_of("2 mm")[0], "2 mm")
        rows.append({"valid": valid, "critic": name, "after": trials} | scored)
    return pd.DataFrame(rows)


def together(xi: float, start: float, trials: int) -> pd.DataFrame:
    """Return the regret of weights and gap learned at once, over the exact optimum."""
    taught, held_out = gratings(t_max=30)
    both = learn_weights_and_gap(
        taught, xi=xi, start_separation=start, seed=SCORING_SEED, runs=RUNS,
        learner=WeightLearner(trials=trials),
    )  # fmt: skip
    # At xi = 50 few trials are errors: the regret is a mean over draws of many trials.
    draws = [held_out.draw(15_000, rng=stream(SCORING_SEED, "regret", k)) for k in range(8)]
    each = np.array([both.regret(draw, xi) for draw in draws])
    known = {"xi": xi, "start_gap": start, "after": trials}
    regret = mean_se("regret", each.mean(axis=0)) | mean_se("drawn", each.mean(axis=1))
    found = pd.DataFrame([known | mean_se("gap", both.gap.learned) | regret])
    return found.drop(columns="drawn")


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per task, rule and condition; threads are not used."""
    most = FAST_TRIALS if fast else max(RULES_AFTER)
    for name, trials in TRIALS.items():
        trials = min(most, trials)
        yield Piece("course", name, trials, 170, partial(learned_over_trials, name, trials))
    for rule, critic in RULES:
        name = f"{rule} {critic or ''}".strip()
        yield Piece("rules", name, most, 60, partial(rules, rule, critic, most))
    for ratio in RATIOS:
        yield Piece("asymmetry", f"{ratio:g}", most, 20, partial(asymmetry, ratio, most))
    trials = min(most, 10_000)
    for valid in VALID:
        yield Piece("feedback", f"{valid:g}", trials, 40, partial(feedback, valid, trials))
    for name in CHANGES:
        yield Piece("changes", name, min(most, 8000), 10, partial(changed, name, fast))
    for xi, start in product(XIS, STARTS):
        make = partial(together, xi, start, most)
        yield Piece("together", f"{xi:g} {start:g}", most, 60, make)
    if not fast:
        yield Piece("ratios", "2 mm", max(SHOWN_AFTER), 5, ratios_over_trials)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return what was found, and a summary of the changes."""
    found = {kind: (kind, table) for kind, table in made.items()}
    return found | {"recovered": ("changes", summaries(made["changes"]))}


SCORE = Score("weights", SCORING_SEED, (), pieces, tables, circuit="")

if __name__ == "__main__":
    main(SCORE)
