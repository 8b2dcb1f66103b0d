"""Decisions of the population engine and of spikes, on scoring seeds.

Both decide on the same evidence with independent noise; the difference is compared with that
between two noise seeds of spikes, which no engine can fall below. No constant of the population
engine was fitted to spikes, and the seeds are held out. Before the evidence both are at rest for a
second, because spikes start from a burst that takes about as long to decay.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel import stream
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import engine_of
from figures.pieces import Made, Piece, Score

SCORING_SEED = 50_001
OTHER_SEED, POPULATION_SEED = SCORING_SEED + 1, SCORING_SEED + 2
STEP_MS, SETTLE_MS = 50.0, 1000.0
POSTERIORS = (0.8, 0.85, 0.9, 0.95)
D_PRIMES = {2: (0.35, 0.5, 0.8), 4: (0.35, 0.5, 0.8), 8: (0.35, 0.5, 0.8)}
READINGS = {0.35: 120, 0.5: 80, 0.8: 40}
"""Most readings of a trial, by d': nearly all decide."""
SPIKES, AGAIN, POPULATION = "spikes", "spikes, another seed", "population"
DECISIONS = {2: 600, 4: 300, 8: 100}
"""Trials, by alternatives: a spiking trial is of 60 000 cells a channel."""
SECONDS = {2: 0.3, 4: 0.4, 8: 0.8}
"""CPU time of a trial of decisions on three engines, about, by alternatives."""
ENGINES = {
    SPIKES: ("spikes", SCORING_SEED),
    AGAIN: ("spikes", OTHER_SEED),
    POPULATION: ("population", POPULATION_SEED),
}


def evidence(channels: int, d_prime: float, trials: int) -> Evidence:
    """Draw the evidence of one condition."""
    rng = stream(SCORING_SEED, "population", str(channels), str(d_prime))
    settings = {"d_prime": d_prime, "t_max": READINGS[d_prime], "step_ms": STEP_MS}
    return gaussian_evidence(trials, channels=channels, seed=rng, **settings)


def decided(table: Circuit, shown: Evidence, name: str, workers: int) -> Tradeoff:
    """Let a circuit decide on an engine, at every posterior."""
    engine, seed = ENGINES[name]
    chosen = engine_of(engine, workers=workers, settle_ms=SETTLE_MS)
    model = BasalGanglia(table, chosen, gain_of(table), seed)
    thresholds = -np.log(POSTERIORS)
    return decide_at_thresholds(model, shown, thresholds, decoder_tau_ms=None)[CIRCUIT]


def _measures(
    swept: Tradeoff, other: Tradeoff, truth: npt.NDArray[Any], k: int
) -> dict[str, float]:
    times = swept.time_ms[k]
    return {
        "accuracy": (swept.choice[k] == truth).mean(),
        "forced": swept.forced[k].mean(),
        "mean_ms": times.mean(),
        "r": float(np.corrcoef(times, other.time_ms[k])[0, 1]),
    }


def decisions(channels: int, d_prime: float, trials: int, workers: int) -> pd.DataFrame:
    """Return accuracy and times of each engine, and the correlation of times with spikes."""
    rows, shown = [], evidence(channels, d_prime, trials)
    assert shown.truth is not None
    by_engine = {
        name: decided(load_circuit(DEFAULT, channels), shown, name, workers) for name in ENGINES
    }
    for k, threshold in enumerate(by_engine[SPIKES].settings):
        for name, swept in by_engine.items():
            of = {"channels": channels, "d_prime": d_prime}
            of |= {"posterior": float(np.exp(-threshold)), "engine": name}
            rows.append(of | _measures(swept, by_engine[SPIKES], shown.truth, k))
    return pd.DataFrame(rows)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the distance of decisions from those in spikes."""
    rows = []
    for (channels, d_prime), part in made["decisions"].groupby(["channels", "d_prime"]):
        by = part.set_index(["posterior", "engine"]).unstack("engine")
        both = [SPIKES, AGAIN]
        wrong = by["accuracy"][POPULATION] - by["accuracy"][both].mean(axis=1)
        off = by["mean_ms"][POPULATION] / by["mean_ms"][both].mean(axis=1) - 1
        rows.append(
            {"channels": channels, "d_prime": d_prime, "accuracy_off": wrong.abs().max(),
             "mean_ms_off": off.abs().max(),
             "r_below": (by["r"][AGAIN] - by["r"][POPULATION]).max(),
             "forced": part["forced"].max()}
        )  # fmt: skip
    return {"decisions": ("decisions", pd.DataFrame(rows))}


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per condition.

    There is no coarse form: on few trials two seeds of spikes differ by more than the engines.
    """
    if fast:
        return
    for channels, d_primes in D_PRIMES.items():
        many = DECISIONS[channels]
        for d_prime in d_primes:
            made = partial(decisions, channels, d_prime, many, workers)
            name = f"N = {channels}, d' {d_prime:g}"
            yield Piece("decisions", name, many, SECONDS[channels] * many, made)


SCORE = Score("population", SCORING_SEED, tuple(D_PRIMES), pieces, tables, circuit=DEFAULT)
