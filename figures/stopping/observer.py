"""The ideal observer of the stop-signal task next to the circuit, on the same evidence.

The circuit receives ``ln(1 + exp z)``, z the observer's log odds of a stop trial, as an input to
STN (``with_observed_stop``), and should then do what ``StopMsprt`` does. The rival is a test in
which the stop is one more alternative: its effect shrinks as S grows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.deciding.decision import Decision
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.stopping.inputs import StopSignal, with_observed_stop
from bgmodel.stopping.observer import StopEvidence, StopMsprt, gaussian_stop_evidence
from bgmodel.stopping.trials import drawn_delays
from circuits.arrays import Array
from figures.stopping.runs import (
    POSTERIOR,
    SCORING_SEED,
    STEP_MS,
    agreement,
    evidence_of,
    go_times,
    model_of,
    response_times,
    share,
    stop_times,
)

STOP_D_PRIME = 0.6
"""d' of one reading of the stop signal, assumed."""
STOP_POSTERIOR = 0.95
"""Probability of a stop trial at which the observer withholds the response for good."""
SHARE, SIMULATED = 0.1, 0.5
"""Share of stop trials that the observer expects in the comparison, and the share there is."""
PAIRED_MS = np.arange(50.0, 351.0, 50.0)
"""Delays of the comparison on the same evidence, N = 2."""
TONES, TONE_SSD_MS, TONE_NATS = (0.0, 1.0, 2.0, 3.0), 800.0, 1.0
ALTERNATIVES = 4
"""Input common to all channels, nats; delay and size of the stop signal, and number of alternatives
of that comparison."""


def observed(go: Evidence, ssd_ms: Array, prior: float, name: str, expected: Array) -> StopEvidence:
    """Return evidence for a stop signal; a name gives the same random numbers."""
    return gaussian_stop_evidence(
        go, ssd_ms, d_prime=STOP_D_PRIME, share=prior, delays_ms=expected,
        rng=stream(SCORING_SEED, "stop evidence", name),
    )  # fmt: skip


def decisions(evidence: StopEvidence, gain: float) -> Decision:
    """Return the decisions of the observer."""
    return StopMsprt(gain).decide(evidence, POSTERIOR, STOP_POSTERIOR)


def commitments(decision: Decision, responses: int) -> Array:
    """Return when each trial's response is withheld for good, ms; infinite for never."""
    return np.where(decision.choice == responses, decision.time_ms, np.inf)


def paired(channels: int, engine: str, prior: float, trials: int) -> pd.DataFrame:
    """Compare the circuit with the observer, and with itself under other noise."""
    go = evidence_of("paired", trials, channels)
    ssd = drawn_delays(trials, PAIRED_MS, SIMULATED, stream(SCORING_SEED, "paired delays"))
    shown = observed(go, ssd, prior, f"paired, N = {channels}", PAIRED_MS)
    circuit = model_of(channels, engine)
    ideal = decisions(shown, circuit.gain)
    held = commitments(ideal, channels)
    runs = [_with_input(model_of(channels, engine, noise), shown, held) for noise in (0, 1)]
    others = {
        "ideal observer": response_times(ideal, channels),
        "the circuit, other noise": runs[1],
    }
    rows: list[dict[str, Any]] = []
    stop = ~np.isnan(ssd)
    for name, times in others.items():
        row = {"alternatives": channels, "engine": engine, "stop_share": prior, "compared": name,
               "stop_trials": int(stop.sum()), "p_respond": (~np.isnan(runs[0][stop])).mean(),
               "p_compared": (~np.isnan(times[stop])).mean()}  # fmt: skip
        same = agreement(runs[0][stop], times[stop])
        rows.append(row | {k: v for k, v in same.items() if k.startswith("same")})
    return pd.DataFrame(rows)


def _with_input(model: BasalGanglia, evidence: StopEvidence, held_ms: Array) -> Array:
    """Return the times of a circuit with the observer's input; none after its commitment."""
    circuit = replace(model, circuit=model.circuit.with_inputs("STN"))
    times = go_times(circuit, with_observed_stop(evidence))
    return np.where(times < held_ms, times, np.nan)


def with_tone(evidence: Evidence, nats: float) -> Evidence:
    """Return evidence with input common to all hypotheses from the first reading on.

    It changes no posterior, and raises S by as much.
    """
    values = evidence.log_likelihood.copy()
    values[:, 0] += nats
    return replace(evidence, log_likelihood=values)


def abrupt(go: Evidence, ssd_ms: float, odds: float) -> StopEvidence:
    """Return stop evidence whose log odds jump from -30 to a value at the delay."""
    ratio = np.zeros((go.trials, go.steps))
    ratio[:, 0], ratio[:, round(ssd_ms / STEP_MS)] = -30.0, 30.0 + odds
    begins = np.eye(1, go.steps)[0]
    return StopEvidence(go, ratio, np.full(go.trials, ssd_ms), 0.5, begins)


def by_tone(engine: str, trials: int) -> pd.DataFrame:
    """Return p(respond) with rising common input, of circuit, observer and rival.

    All add ``TONE_NATS`` to OUT where S has its mean at the delay; the rival's log odds are set
    for it. As S rises by the tone, circuit and observer do not change in theory, and the
    rival adds only ``ln(1 + exp(odds - S))``.
    """
    model, plain = model_of(ALTERNATIVES, engine), evidence_of("tone", trials, ALTERNATIVES)
    at = round(TONE_SSD_MS / STEP_MS)
    s = float(np.logaddexp.reduce(model.gain * plain.own_totals[:, at], axis=1).mean())
    odds = float(np.log(np.expm1(TONE_NATS)))
    rows = []
    for tone in TONES:
        go = with_tone(plain, tone / model.gain)
        tests = {
            "ideal observer": (StopMsprt(model.gain), odds),
            "extra channel": (StopMsprt(model.gain, extra_channel=True), odds + s),
        }
        row = {"engine": engine, "common_nats": tone, "s_nats": s + tone, "trials": trials}
        went = Msprt(model.gain).decide(go, posterior=POSTERIOR, forced=False)
        went_ms = response_times(went, ALTERNATIVES)
        for name, (test, at_odds) in tests.items():
            made = test.decide(abrupt(go, TONE_SSD_MS, at_odds), POSTERIOR, 1 - 1e-12)
            added = TONE_NATS if "ideal" in name else float(np.logaddexp(0, odds - tone))
            known = {"compared": name, "added_nats": added}
            rows.append(row | known | _both(response_times(made, ALTERNATIVES), went_ms))
        stopped = stop_times(model, go, TONE_SSD_MS, StopSignal(amount_nats=TONE_NATS))
        known = {"compared": "circuit", "added_nats": TONE_NATS}
        rows.append(row | known | _both(stopped, go_times(model, go)))
    return pd.DataFrame(rows)


def _both(stopped: Array, went: Array) -> dict[str, float]:
    """Return p(respond) with and without the signal, and the mean go time."""
    known = share(~np.isnan(stopped)) | share(~np.isnan(went), "p_go")
    return known | {"go_ms": float(np.nanmean(went))}
