"""Loss of STN in the default circuit: acute, recovered, and with a rebound of SNr: make score.

All circuits decide on the same evidence, with the same noise, at the threshold found for the intact
circuit on other seeds, where its accuracy without conflict is about 0.9. The rebound is an
assumption, and its size determines the sign of the change of time, so complete loss is scored over
a range of rebounds. ``REBOUND_NATS`` leaves the time without conflict nearly unchanged on the
tuning seeds; after partial loss the rebound is the same fraction of it. In a foreperiod with a ramp
of expectancy, common to all channels, responses before the onset are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import expecting, gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.engines import Populations
from figures.pieces import Made, Piece, Score, wide

SCORING_SEED = 60_001
TRIALS, COARSE_TRIALS = 2000, 400
STEP_MS = 50.0
CONFLICT = 0.9
LOST = (0.1, 0.5, 1.0)
REBOUND_NATS = {2: 0.3, 4: 0.6}
"""Rebound of SNr after a whole loss by alternatives, nats; from the tuning seeds."""
REBOUNDS_NATS = tuple(np.round(np.arange(0, 0.85, 0.1), 1))
EXPECTED_NATS, EXPECTED_MS = (3.0, 5.0), 800.0
"""Most expectancy by the onset, in the circuit's nats, and the foreperiod."""
CHANGED = ("accuracy", "mean_ms")
"""Measures reported as changes from the intact circuit."""
INTACT, ACUTE, RECOVERED = "intact", "acute", "recovered"


class LesionTask(NamedTuple):
    """Gaussian evidence, its longest trial, and the intact circuit's threshold."""

    channels: int
    d_prime: float
    readings: int
    threshold_nats: float

    @property
    def name(self) -> str:
        """What a row of the tables calls it."""
        return f"d' {self.d_prime:g}, N = {self.channels}"


TASKS = (LesionTask(2, 0.5, 120, 0.30), LesionTask(4, 0.5, 120, 0.45), LesionTask(4, 1.0, 40, 0.48))
"""Thresholds from the tuning seeds, for an accuracy of 0.9 without conflict."""


def evidence(task: LesionTask, conflict: float, trials: int, seed: int = SCORING_SEED) -> Evidence:
    """Draw the evidence of a task; that with conflict differs from that without in one mean."""
    settings = {"d_prime": task.d_prime, "channels": task.channels, "t_max": task.readings}
    rng = stream(seed, "loss", task.name)
    return gaussian_evidence(trials, step_ms=STEP_MS, conflict=conflict, seed=rng, **settings)


def lesioned(task: LesionTask) -> dict[tuple[float, str, float], Circuit]:
    """Return the circuits by share of STN lost, state (acute or recovered), and rebound in nats."""
    table = load_circuit(DEFAULT, task.channels)
    circuits = {(0.0, INTACT, 0.0): table}
    for lost in LOST:
        acute = table.lesion("STN", lost)
        circuits[lost, ACUTE, 0.0] = acute
        part = round(lost * REBOUND_NATS[task.channels], 2)
        for nats in REBOUNDS_NATS if lost == 1 else (0.0, part):
            circuits[lost, RECOVERED, nats] = acute.compensate(rebound_nats={"SNr": nats})
    return circuits


def decided(
    table: Circuit,
    shown: Evidence,
    threshold_nats: float,
    workers: int,
    seed: int = SCORING_SEED,
) -> Tradeoff:
    """Let a circuit decide at one threshold."""
    engine = Populations(workers=workers, rates=False)
    model = BasalGanglia(table, engine, gain_of(table), seed)
    return decide_at_thresholds(model, shown, [threshold_nats], decoder_tau_ms=None)[CIRCUIT]


def measures(decisions: Tradeoff, truth: Array, weights: Array) -> dict[str, Array]:
    """Return each measure for weights of trials (B, trials); late decisions are forced."""
    share = weights / weights.sum(axis=1, keepdims=True)
    each = {
        "accuracy": decisions.choice[0] == truth,
        "mean_ms": decisions.time_ms[0],
        "forced": decisions.forced[0],
        "premature": decisions.premature[0],
    }
    return {name: share @ values.astype(np.float64) for name, values in each.items()}


def behaviour(task: LesionTask, trials: int, workers: int) -> pd.DataFrame:
    """Return each measure, its change from the intact circuit, and that change's by conflict."""
    weights = resampled(trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"))
    rows: list[tuple[object, ...]] = []
    changes: dict[tuple[object, ...], dict[str, Array]] = {}
    for conflict in (0.0, CONFLICT):
        shown = evidence(task, conflict, trials)
        truth = np.asarray(shown.truth)
        intact: dict[str, Array] = {}
        for key, table in lesioned(task).items():
            measured = measures(decided(table, shown, task.threshold_nats, workers), truth, weights)
            intact = intact or measured
            new = {f"{name}_change": measured[name] - intact[name] for name in CHANGED}
            by = {
                f"{name}_by_conflict": new[name] - old for name, old in changes.get(key, {}).items()
            }
            changes[key] = new
            for name, values in (measured | new | by).items():
                rows.append((task.name, conflict, *key, name, *interval(values)))
    columns = ["evidence", "conflict", "lost", "state", "rebound_nats", "measure"]
    return pd.DataFrame(rows, columns=[*columns, "value", "low", "high"]).assign(trials=trials)


def anticipation(task: LesionTask, trials: int, workers: int) -> pd.DataFrame:
    """Return the share of responses before the onset, and behaviour, by the ramp's top."""
    weights = resampled(trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"))
    share = weights / weights.sum(axis=1, keepdims=True)
    plain = evidence(task, 0.0, trials)
    gain = gain_of(load_circuit(DEFAULT, task.channels))
    rows = []
    for most in EXPECTED_NATS:
        rng = stream(SCORING_SEED, "expectancy")
        shown = expecting(plain, most / gain, EXPECTED_MS, rng=rng)
        for key, table in lesioned(task).items():
            if key[1] == ACUTE:
                continue
            decisions = decided(table, shown, task.threshold_nats, workers)
            each = {
                "anticipatory": decisions.time_ms[0] < 0,
                "accuracy": decisions.choice[0] == np.asarray(plain.truth),
                "mean_ms": decisions.time_ms[0],
            }
            for name, values in each.items():
                row = interval(share @ values.astype(np.float64))
                rows.append((task.name, most, *key, name, *row))
    columns = ["evidence", "most_nats", "lost", "state", "rebound_nats", "measure"]
    return pd.DataFrame(rows, columns=[*columns, "value", "low", "high"]).assign(trials=trials)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield behaviour in every task, and anticipation in the slow ones."""
    trials = COARSE_TRIALS if fast else TRIALS
    for task in TASKS:
        seconds = trials / 1000 * task.readings / 5
        make = partial(behaviour, task, trials, workers)
        yield Piece("behaviour", task.name, trials, seconds, make)
        if task.d_prime == TASKS[0].d_prime:
            make = partial(anticipation, task, trials, workers)
            yield Piece("anticipation", task.name, trials, seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a row per evidence, conflict and circuit, and a row per ramp and circuit."""
    by = ["lost", "state", "rebound_nats"]
    behaved = wide(made["behaviour"], ["evidence", "conflict", *by, "trials"])
    ahead = wide(made["anticipation"], ["evidence", "most_nats", *by, "trials"])
    return {"behaviour": ("behaviour", behaved), "anticipation": ("anticipation", ahead)}


SCORE = Score("loss", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
