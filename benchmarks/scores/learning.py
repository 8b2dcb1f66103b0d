"""Dopamine that learns, scored on fresh trials: make score.

The rate circuit on three gratings and on Gaussian evidence, the spiking one on two gratings, from
both ends of the usable levels. The learned level is compared with the best of these levels, found
by exhaustive search, and with the optimum of the abstract test with the circuit's usual
non-decision time. Evaluated on a held-out seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel import stream
from bgmodel.deciding.reward import reward_of
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.dopamine_learner import learn_level, level_outcomes, scored_runs
from bgmodel.learning.dopamine_levels import LATENCY_MS as LATENCIES_MS
from bgmodel.learning.reinforce import Learner
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Ensemble, Rate

SCORING_SEED = 40_006
XI, T_MAX, STEP_MS = 50.0, 30, 50.0
LATENCY_MS = LATENCIES_MS[2]
"""Non-decision time. Near the highest level OUT rests close to the threshold and the circuit is
faster than this: if it outperforms the test there, it is because of a shorter latency, not of
better decisions."""
STARTS = (1, -2)
"""Where learning starts: the lowest but one and the highest but one of the levels."""
LEVELS = {"rate": 31, "ensemble": 12}
ENGINES = {"rate": Rate().coarse(), "ensemble": Ensemble(settle_ms=100.0)}
"""The circuit starts at its own rest: in spikes a third of the usual time to settle will do."""
TRIALS = {"rate": (10_000, 100_000), "ensemble": (2000, 5000)}
"""Trials learned on, drawn again and again, and others that are scored on."""
COARSE_TRIALS = {"rate": (2000, 4000)}
"""Without spikes: on the few trials that there is time for, the best level is not known."""
SECONDS = {"rate": 0.004, "ensemble": 0.16}
"""CPU time of a trial at all levels, about; learning itself takes ten seconds more."""
SPIKING = ("1.5 mm", "2 mm")
"""What spikes learn too."""
NEAR = 0.03
"""A run ends near the best level if it costs less than this share more."""
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
        f"{period:g} mm": source(taps, SameDifferent(period_mm=period), fold=0).draw
        for period in (1.5, 2.0, 2.5)
    }
    made["gaussian"] = partial(separated_evidence, separation=0.5 / np.sqrt(2))
    return made


def drawn(draw: Draw, trials: int, name: str) -> Evidence:
    """Return trials from a separate random stream."""
    rng = stream(SCORING_SEED, "learning", name)
    return draw(trials, T_MAX, rng=rng, step_ms=STEP_MS)


def best_of_test(evidence: Evidence) -> float:
    """Return the highest mean reward of the MSPRT, the circuit's non-decision time added."""
    test = tradeoff(Msprt(gain_of(load_circuit(DEFAULT))).run(evidence), evidence)
    steps = (np.maximum(test.time_ms, 0) + LATENCY_MS) / STEP_MS
    steps = np.minimum(steps, T_MAX + 1)
    return float(reward_of(test.choice != evidence.truth, steps, XI).mean(axis=1).max())


def runs(engine: str, kind: str, draw: Draw, trials: tuple[int, int]) -> pd.DataFrame:
    """Learn on some trials, score on others; one row per start and run."""
    table = load_circuit(DEFAULT)
    model = BasalGanglia(table, ENGINES[engine], gain_of(table), SCORING_SEED)
    levels = playable_levels(model, LEVELS[engine])
    learned_on = level_outcomes(model, drawn(draw, trials[0], f"{kind} learned"), levels)
    # Fresh trials, and fresh noise.
    again = replace(model, seed=SCORING_SEED + 1)
    evidence = drawn(draw, trials[1], f"{kind} scored")
    scored = level_outcomes(again, evidence, levels)
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
            found = scored_runs(ends, scored, xi=XI, start_level=start)
            behind = (algorithm - found["reward"]) / abs(algorithm)
            rows.append(found.assign(after=after, behind_algorithm=behind))
    known = {"engine": engine, "kind": kind, "algorithm_reward": algorithm}
    known |= {"latency_ms": LATENCY_MS, "highest_level": levels[-1]}
    return pd.concat(rows, ignore_index=True).assign(**known)[COLUMNS]


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per engine and kind of evidence; threads are not used."""
    for engine, trials in (COARSE_TRIALS if fast else TRIALS).items():
        for kind, draw in kinds().items():
            if not ENGINES[engine].spiking or kind in SPIKING:
                make = partial(runs, engine, kind, draw, trials)
                seconds = SECONDS[engine] * sum(trials) + 10
                yield Piece("runs", f"{engine} {kind}", trials[1], seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the number of runs that end near the best level, and their reward versus the test."""
    found = made["runs"]
    found = found.assign(near=found["regret"] < NEAR)
    by = ["engine", "kind", "start_level", "after"]
    ends = found.groupby(by, sort=False).agg(
        runs=("run", "count"),
        near=("near", "sum"),
        best_level=("best_level", "first"),
        highest_level=("highest_level", "first"),
        start_regret=("start_regret", "first"),
        median_regret=("regret", "median"),
        median_behind=("behind_algorithm", "median"),
    )
    return {"runs": ("runs", ends.reset_index())}


SCORE = Score("learning", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
