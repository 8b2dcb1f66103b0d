"""Dopamine that learns, scored on fresh trials: make score.

The rate circuit on three gratings and on Gaussian evidence, the spiking one on two gratings, from
both ends of the usable levels. What is learned is held to the best of these levels, found by
exhaustive search, and to the optimum of the abstract test with the circuit's usual non-decision
time. This seed tuned nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from benchmarks import OUT
from bgmodel import stream
from bgmodel.comparison.compare import tradeoff
from bgmodel.comparison.levels import GAIN
from bgmodel.comparison.levels import LATENCY_MS as LATENCIES_MS
from bgmodel.dopamine import COARSE, playable_levels
from bgmodel.evidence import Evidence, gaussian_evidence
from bgmodel.files import write_table
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.level import learn_level, level_outcomes, regret, scored_runs
from bgmodel.learning.reinforce import Learner
from bgmodel.learning.reward import reward_of
from bgmodel.learning.worlds import LevelOutcomes
from bgmodel.tactile.task import SameDifferent, held_out_taps, source
from circuits.anatomy import circuit

SCORING_SEED = 40_006
XI, T_MAX, STEP_MS = 50.0, 30, 50.0
LATENCY_MS = LATENCIES_MS[2]
"""Non-decision time. Beside the highest level OUT rests near the threshold and the circuit is
faster than that: where it comes out ahead of the test, its latency is shorter, not its decisions
better."""
STARTS = (1, -2)
"""Where learning starts: the lowest but one and the highest but one of the levels."""
LEVELS = {"rate": 31, "ensemble": 16}
LEARNED_ON = {"rate": 10_000, "ensemble": 2000}
"""Trials learned on, drawn again and again; others are scored on."""
NEAR = 0.06
"""Levels this much worse than the best, as a share, are not searched on fresh trials; the regret
of a run that ends there is NaN and counts as more than 3 %."""
AFTER = (40_000, 100_000)
"""Trials of learning: as in the figures, and as ``make validate`` gives the abstract test."""
RUNS = {"rate": 20, "ensemble": 5}
COLUMNS = ["engine", "kind", "start_level", "after", "run", "learned_level", "best_level"]
COLUMNS += ["start_regret", "regret", "behind_algorithm", "reward", "best_reward"]
COLUMNS += ["algorithm_reward", "latency_ms", "highest_level"]
Draw = Callable[..., Evidence]


def kinds() -> dict[str, Draw]:
    """Return how to draw each kind of evidence."""
    taps = held_out_taps()
    made: dict[str, Draw] = {
        f"{period:g} mm": source(taps, SameDifferent(), period_mm=period, fold=0).draw
        for period in (1.5, 2.0, 2.5)
    }
    made["gaussian"] = partial(gaussian_evidence, separation=0.5 / np.sqrt(2))
    return made


def drawn(draw: Draw, trials: int, name: str) -> Evidence:
    """Return trials of their own stream."""
    rng = stream(SCORING_SEED, "learning", name)
    return draw(trials, T_MAX, rng=rng, step_ms=STEP_MS)


def near(outcomes: LevelOutcomes) -> Any:
    """Return the levels within ``NEAR`` of the best, and one more on both sides."""
    inside = np.flatnonzero(regret(outcomes.levels, outcomes, XI) < NEAR)
    return outcomes.levels[max(inside[0] - 1, 0) : inside[-1] + 2]


def best_of_test(evidence: Evidence) -> float:
    """Return the highest mean reward of the MSPRT, the circuit's non-decision time added."""
    test = tradeoff(Msprt(GAIN).run(evidence), evidence)
    steps = (np.maximum(test.time_ms, 0) + LATENCY_MS) / STEP_MS
    steps = np.minimum(steps, T_MAX + 1)
    return float(reward_of(test.choice != evidence.truth, steps, XI).mean(axis=1).max())


def score(engine: str, kind: str, draw: Draw, fresh: int) -> pd.DataFrame:
    """Learn on some trials, score on others; one row a start and run."""
    options: dict[str, Any] = COARSE if engine == "rate" else {"workers": 1}
    model = BasalGanglia(circuit("spiking_msprt"), engine, GAIN, SCORING_SEED, options)
    levels = playable_levels(model, LEVELS[engine])
    some = drawn(draw, min(LEARNED_ON[engine], fresh), f"{kind} learned")
    learned_on = level_outcomes(model, some, levels)
    # Fresh trials, and fresh noise. What is far from the best need not be searched again.
    again = replace(model, seed=SCORING_SEED + 1)
    evidence = drawn(draw, fresh, f"{kind} scored")
    scored = level_outcomes(again, evidence, near(learned_on))
    best, _ = scored.best(XI)
    if best in scored.levels[[0, -1]] and best not in levels[[0, -1]]:
        raise RuntimeError(f"the best level, {best:.3f}, lies at the edge of what was searched")
    algorithm = best_of_test(evidence)
    rows = []
    for start in levels[list(STARTS)].tolist():
        learned = learn_level(
            learned_on,
            xi=XI,
            start_level=start,
            runs=RUNS[engine],
            seed=SCORING_SEED,
            name=(engine, kind, start),
            learner=Learner(episodes=max(AFTER)),
        )
        for after in AFTER:
            ends = learned.mean_played[:, after - Learner.last : after].mean(axis=1)
            runs = scored_runs(ends, scored, xi=XI, start_level=start, first=learned_on)
            behind = (algorithm - runs["reward"]) / abs(algorithm)
            rows.append(runs.assign(after=after, behind_algorithm=behind))
    known = {"engine": engine, "kind": kind, "algorithm_reward": algorithm}
    known |= {"latency_ms": LATENCY_MS, "highest_level": levels[-1]}
    return pd.concat(rows, ignore_index=True).assign(**known)[COLUMNS]


def main() -> None:
    """Score every kind and engine."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-trials", type=int, default=100_000)
    parser.add_argument("--spiking-trials", type=int, default=5000)
    parser.add_argument("--only", default="", help="kinds whose name contains this")
    parser.add_argument("--engines", nargs="+", default=["rate", "ensemble"])
    given = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    for engine in given.engines:
        for kind, draw in kinds().items():
            if given.only not in kind or (engine == "ensemble" and kind not in ("1.5 mm", "2 mm")):
                continue
            fresh = given.rate_trials if engine == "rate" else given.spiking_trials
            found = score(engine, kind, draw, fresh)
            path = OUT / f"learning {engine} {kind}.csv"
            write_table(found, path, seed=SCORING_SEED, trials=fresh, xi=XI)
            print(f"\n{engine}, {kind}, {fresh} fresh trials")
            by = ["after", "start_level", "start_regret", "best_level", "highest_level"]
            by += ["best_reward", "algorithm_reward"]
            # Runs that ended where nothing was searched are the worst, not missing.
            found = found.fillna({"regret": np.inf, "behind_algorithm": np.inf})
            found["within"] = found["regret"] < 0.03
            measures = ("regret", "median"), ("regret", "max"), ("behind_algorithm", "median")
            ends = found.groupby(by).agg(
                **{"_".join(m): m for m in measures},
                within=("within", "sum"),
                runs=("run", "count"),
            )
            print(ends.round(3).reset_index().to_string(index=False), flush=True)


if __name__ == "__main__":
    main()
