"""Learners of values: regret relative to the ideal learner, and choices and times of the circuit.

Options of learners were tuned for reversals every 50 trials, separately for both pairs of
probabilities (``benchmarks.tuning.values``, seed 45 001); the scores are of another seed. All
learners play the same bandits, so that the standard error of a relative regret is that of pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.bandit import (
    Bandit,
    Played,
    ValueCircuit,
    ideal_of,
    play,
    relative_regret,
)
from bgmodel.learning.value_learners import (
    Confidence,
    LogitQ,
    Opal,
    QBoth,
    QLearning,
    Reinforce,
    ValueLearner,
)
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from figures.pieces import Piece, Score

SCORING_SEED = 45_002
"""Seed of bandits, choices and readings; it tuned nothing."""
EVERY = 50
"""Trials from one reversal to the next."""
BANDITS = {
    (better, kind): Bandit(better, round(1 - better, 1), **options)
    for better in (0.8, 0.7)
    for kind, options in (
        (f"every {EVERY}", {"reverse_every": EVERY}), ("hazard", {"hazard": 1 / EVERY})
    )
}  # fmt: skip
LEVELS = (0.9, 1.0, 1.15)
"""Levels of dopamine."""
DIFFERENCES = (0.0, 0.2, 0.4, 0.6)
"""Differences of values that the circuit decides."""
LOOP_RATE = 0.2
"""Rate of the learner in the loop, the tuned one of Q learning for both arms."""


def learners(better: float) -> dict[str, ValueLearner]:
    """Return the learners with the options tuned for a probability of the better arm."""
    first = better == 0.8
    worse = round(1 - better, 1)
    return {
        "Q, both arms": QBoth(rate=0.2 if first else 0.15, beta=np.inf),
        "Q": QLearning(rate=0.9 if first else 0.8, beta=40.0 if first else 20.0),
        "logit Q": LogitQ(rate=0.9, beta=np.inf),
        "confidence": Confidence(rate=0.25, decay=0.1 if first else 0.05, beta=np.inf),
        "confidence, affine critic": Confidence(
            rate=0.5 if first else 0.35, decay=0.1, low=worse, high=better, beta=np.inf
        ),
        "OpAL": Opal(rate=1.0, critic_rate=0.0, decay=0.2 if first else 0.1, beta=40.0),
        "REINFORCE": Reinforce(rate=4.0, mean_rate=0.0, decay=0.1),
        "REINFORCE, no decay": Reinforce(rate=0.5, mean_rate=0.1 if first else 0.3, decay=0.0),
    }


def regrets(better: float, kind: str, runs: int) -> pd.DataFrame:
    """Return share of the better arm and regret of every learner, one row each."""
    bandit = BANDITS[better, kind]
    known: dict[str, Any] = {"runs": runs, "seed": SCORING_SEED}
    ideal = play(ideal_of(bandit), bandit, **known)
    rows = [_row("ideal", ideal, ideal)]
    rows += [_row(name, play(one, bandit, **known), ideal)
             for name, one in learners(better).items()]  # fmt: skip
    chance = 0.5 * (bandit.better - bandit.worse) * len(ideal.choice) / ideal.regret.mean()
    rows.append({"learner": "chance", "share": 0.5, "relative_regret": chance})
    return pd.DataFrame(rows).assign(better=better, reversals=kind, runs=runs)


def _row(name: str, played: Played, ideal: Played) -> dict[str, Any]:
    """Return the row of a learner."""
    share, ratio = played.correct.mean(axis=0), relative_regret(played, ideal)
    return {
        "learner": name, "share": share.mean(), "share_se": share.std(ddof=1) / np.sqrt(len(share)),
        "relative_regret": ratio[0], "relative_regret_se": ratio[1],
    }  # fmt: skip


def reversals(runs: int) -> pd.DataFrame:
    """Return the share of the better arm by trial since the last reversal, at 0.8 and 0.2."""
    bandit = BANDITS[0.8, f"every {EVERY}"]
    every = {"ideal": ideal_of(bandit), **learners(0.8)}
    rows = []
    for name, learner in every.items():
        played = play(learner, bandit, runs=runs, seed=SCORING_SEED)
        mean, error = since_reversal(played.correct.astype(float))
        rows.append(
            pd.DataFrame(
                {"learner": name, "since": np.arange(EVERY), "share": mean, "share_se": error}
            )
        )
    return pd.concat(rows, ignore_index=True)


def since_reversal(values: Array) -> tuple[Array, Array]:
    """Return means of values (trials, runs) by trial since the last reversal, and their errors.

    The first block is left out.
    """
    blocks = values.reshape(-1, EVERY, values.shape[1])[1:]
    of_run = blocks.mean(axis=0)
    return of_run.mean(axis=1), of_run.std(axis=1, ddof=1) / np.sqrt(values.shape[1])


def circuit_at(level: float) -> ValueCircuit:
    """Return the default circuit at a level of dopamine."""
    circuit = load_circuit(DEFAULT).dopamine(level)
    return ValueCircuit(BasalGanglia(circuit, seed=SCORING_SEED), seed=SCORING_SEED)


def times(trials: int) -> pd.DataFrame:
    """Return choices and times of the circuit by the difference of values and dopamine."""
    rows = []
    for level in LEVELS:
        circuit = circuit_at(level)
        for number, d in enumerate(DIFFERENCES):
            made = circuit.decide(np.tile([0.5 - d / 2, 0.5 + d / 2], (trials, 1)), number)
            share = float((made.choice == 1).mean())
            rows.append(
                {"dopamine": level, "difference": d, "trials": trials, "share": share,
                 "share_se": np.sqrt(share * (1 - share) / trials),
                 **median_and_error(np.asarray(made.time_ms))}
            )  # fmt: skip
    return pd.DataFrame(rows)


def median_and_error(time_ms: Array) -> dict[str, float]:
    """Return the median, and half of the distance between its bounds at one standard error."""
    n = len(time_ms)
    ranks = np.clip(0.5 + np.array([-0.5, 0.5]) / np.sqrt(n), 0, 1)
    low, high = np.quantile(time_ms, ranks)
    return {"median_ms": float(np.median(time_ms)), "median_se": float(high - low) / 2}


def loops(level: float, runs: int, trials: int) -> pd.DataFrame:
    """Return choices and times by trial since a reversal, if the circuit's choices are rewarded.

    Runs are independent circuits with Q learning for both arms; trials are grouped by fives.
    """
    bandit = BANDITS[0.8, f"every {EVERY}"]
    known: dict[str, Any] = {"trials": trials, "runs": runs, "seed": SCORING_SEED}
    played = play(QBoth(rate=LOOP_RATE), bandit, chooser=circuit_at(level), **known)
    ideal = play(ideal_of(bandit), bandit, **known)
    ratio, error = relative_regret(played, ideal)
    rows = []
    columns = {"share": played.correct * 1.0, "mean_ms": played.time_ms,
               "difference": played.difference}  # fmt: skip
    for group in range(EVERY // 5):
        row: dict[str, Any] = {"since": 5 * group + 2}
        for name, values in columns.items():
            blocks = values.reshape(-1, EVERY, runs)[1:, 5 * group : 5 * group + 5]
            of_run = blocks.mean(axis=(0, 1))
            row[name] = of_run.mean()
            row[f"{name}_se"] = of_run.std(ddof=1) / np.sqrt(runs)
        rows.append(row)
    return pd.DataFrame(rows).assign(
        dopamine=level, runs=runs, relative_regret=ratio, relative_regret_se=error
    )


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield bandits, and the circuit with given and with learned values."""
    runs = 40 if fast else 400
    for better, kind in BANDITS:
        make = partial(regrets, better, kind, runs)
        yield Piece("bandit", f"{better:g} {kind}", 1000 * runs, 3, make)
    yield Piece("reversal", "courses", 1000 * runs, 3, partial(reversals, runs))
    few = 200 if fast else 4000
    yield Piece("times", "differences", few, 0.006 * few, partial(times, few))
    some, trials = (8, 100) if fast else (64, 500)
    for level in LEVELS:
        make = partial(loops, level, some, trials)
        yield Piece("loop", f"dopamine {level:g}", some * trials, 0.1 * trials, make)


SCORE = Score("values", SCORING_SEED, (2,), pieces, circuit=DEFAULT)
