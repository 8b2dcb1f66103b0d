"""The task, the runs and the comparison that all scores on stopping share."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from bgmodel import stream
from bgmodel.deciding.decision import UNDECIDED, Decision
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.plots import wilson
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.stopping.inputs import StopSignal, receiving, with_stop
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.engines import Spikes
from circuits.errors import EditWarning

SCORING_SEED = 87_001
POSTERIOR = 0.82
"""Criterion of the circuit, at its own gain."""
D_PRIME, STEP_MS, STEPS = 0.35, 10.0, 150
"""Evidence: d' of one reading, the time between readings, and the readings of a trial."""
ENGINES: dict[str, Any] = {"population": "population", "spikes": Spikes(workers=1)}


def evidence_of(name: str, trials: int, channels: int = 2, **more: Any) -> Evidence:
    """Return evidence for the go task; a name gives the same evidence for every model."""
    settings = {"d_prime": D_PRIME, "t_max": STEPS, "step_ms": STEP_MS, **more}
    return gaussian_evidence(trials, channels=channels, seed=stream(SCORING_SEED, name), **settings)


def model_of(channels: int = 2, engine: str = "population", noise: int = 0) -> BasalGanglia:
    """Return the default circuit; ``noise`` chooses the noise of its cells."""
    return BasalGanglia(load_circuit(DEFAULT, channels), ENGINES[engine], seed=SCORING_SEED + noise)


def pulse(duration_ms: float, **more: Any) -> StopSignal:
    """Return a stop signal that ends, without the warning that it cancels nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EditWarning)
        return StopSignal(duration_ms=duration_ms, **more)


def response_times(decision: Decision, responses: int) -> Array:
    """Return the response time of each trial, ms; NaN without a response."""
    made = (decision.choice != UNDECIDED) & (decision.choice < responses)
    return np.where(made, decision.time_ms, np.nan)


def go_times(model: BasalGanglia, evidence: Evidence, level: float | None = None) -> Array:
    """Return the response times of a circuit (trials,), ms; NaN without a response."""
    level = model.threshold(None, POSTERIOR) if level is None else level
    return response_times(model.decided(evidence, level, forced=False), evidence.hypotheses)


def stop_times(
    model: BasalGanglia,
    evidence: Evidence,
    ssd_ms: float,
    signal: StopSignal,
    level: float | None = None,
) -> Array:
    """Return the response times of a circuit with a stop signal in every trial."""
    shown = with_stop(evidence, np.full(evidence.trials, float(ssd_ms)), signal)
    return go_times(receiving(model, signal), shown, level)


def share(hits: Array, name: str = "p_respond") -> dict[str, float]:
    """Return a proportion with its 95 % Wilson interval, by name."""
    low, high = map(float, wilson(int(hits.sum()), len(hits)))
    return {name: float(hits.mean()), f"{name}_low": low, f"{name}_high": high}


def agreement(one: Array, other: Array) -> dict[str, float]:
    """Compare which trials have a response, and the times of those that have one in both.

    Returns same with its interval; same_chance, the agreement of independent trials of the same
    proportions; same_corrected, the share of the possible excess over it; times_r, the correlation
    of response times, and times_ms, their mean difference, ``one - other``.
    """
    a, b = ~np.isnan(one), ~np.isnan(other)
    chance = float(a.mean() * b.mean() + (1 - a.mean()) * (1 - b.mean()))
    shares = share(a == b, "same") | {"same_chance": chance}
    for end in ("", "_low", "_high"):
        excess = shares[f"same{end}"] - chance
        shares[f"same_corrected{end}"] = excess / (1 - chance) if chance < 1 else np.nan
    both = a & b
    few = both.sum() < 30
    shares["times_r"] = np.nan if few else float(np.corrcoef(one[both], other[both])[0, 1])
    return shares | {"times_ms": float((one - other)[both].mean()) if both.any() else np.nan}


def nth(times_ms: Array, p: float) -> float:
    """Return the quantile of go times at p, ms, where omissions count as the slowest time."""
    replaced = np.where(np.isnan(times_ms), np.nanmax(times_ms), times_ms)
    return float(np.quantile(replaced, p, method="inverted_cdf"))
