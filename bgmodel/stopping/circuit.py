"""A stop signal in a circuit, and its closed form.

A constant input of A nats to STN adds A to every output of the default circuit at its fixed point,
``OUT_i = -ln P_i + A``. This holds at every S because GPe responds to Sigma, the sum of STN, with
Sigma - ln Sigma (``circuits.anatomy.macaque``). In time, ``OUT_stop(t) = OUT_go(t) + c(t - SSD)``,
where c is the response of OUT to the input alone, and SSD the stop-signal delay. As -ln P is never
negative, c blocks every response once it exceeds the threshold, so that
``p(respond | SSD) = F_go(SSD + latency)``, where F_go is the distribution of go response times: the
horse race of Logan & Cowan (1984).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.inputs import MOST_NATS, StopSignal, with_stop
from bgmodel.stopping.observer import StopEvidence, log_odds_of_stop
from bgmodel.stopping.trials import StopTrials, stop_trials
from bgmodel.support.arrays import Array
from circuits.errors import InputError

SETTLE_MS = 300.0
"""Time for which ``step_response`` holds the evidence constant before the signal."""
CANCELLED = ("ctx", "ctx_inh", "GPe_ctx")
"""Populations at which a stop signal has no effect: circuits driven by raw evidence cancel input
that is common to all channels of cortex. The last two act on all channels even if only one receives
the signal."""


def with_observed_stop(evidence: StopEvidence) -> Evidence:
    """Return go evidence with the ideal observer's ``c = ln(1 + exp z)`` as an input."""
    added = np.minimum(np.logaddexp(0, log_odds_of_stop(evidence)), MOST_NATS)
    return replace(evidence.go, inputs_nats=added[:, :, None])


def decide_with_stop(
    model: BasalGanglia,
    evidence: Evidence,
    ssd_ms: npt.ArrayLike,
    signal: StopSignal,
    *,
    threshold: float | None = None,
    posterior: float | None = None,
    every_ms: float | None = None,
) -> StopTrials:
    """Simulate a circuit in stop-signal trials; parameters as of ``with_stop`` and ``decide``."""
    model = receiving(model, signal)
    level = model.threshold(threshold, posterior)
    model.warn_beyond_range(evidence)
    model.warn_of_noise(level)
    stopped = with_stop(evidence, ssd_ms, signal, every_ms)
    decision = model.decided(stopped, level, forced=False)
    return stop_trials(decision, ssd_ms, evidence.hypotheses)


def receiving(model: BasalGanglia, signal: StopSignal) -> BasalGanglia:
    """Return a model with an input for a signal; refuse nuclei at which it is cancelled."""
    name = signal.nucleus
    nucleus = name.partition("[")[0]
    if nucleus in (model.circuit.input, *CANCELLED) and not model.circuit.centred:
        raise InputError.of(
            "nucleus", "must be one that the signal can act through, such as STN; input common to "
            "all channels is cancelled behind cortex", name,
        )  # fmt: skip
    return replace(model, circuit=model.circuit.with_inputs(name))


def step_response(
    model: BasalGanglia,
    signal: StopSignal,
    *,
    posterior: float = 0.8,
    time_ms: float = 1000.0,
    step_ms: float = 10.0,
) -> tuple[Array, Array]:
    """Return times and c(t), nats: how a signal at time 0 changes the leader's OUT, without noise.

    The leader's posterior is constant; the afferent delay is left out.
    """
    channels, steps = model.circuit.channels, round((SETTLE_MS + time_ms) / step_ms)
    nats = np.log([posterior, *[(1 - posterior) / (channels - 1)] * (channels - 1)]) / model.gain
    prior = np.exp(nats - nats.max())
    held = Evidence(
        np.zeros((2, steps, channels)), prior=prior / prior.sum(), step_ms=step_ms, baseline=0.0
    )
    signalled = with_stop(held, [SETTLE_MS, np.nan], replace(signal, delay_ms=0.0))
    quiet = replace(model, circuit=model.circuit.with_inputs(signal.nucleus), engine="rate")
    activity = quiet.activity(signalled)
    late = activity.time_ms > SETTLE_MS
    out = activity.output_nats[:, late, 0]
    return activity.time_ms[late] - SETTLE_MS, out[0] - out[1]


def closed_form(trace: Trace, ssd_ms: npt.ArrayLike, signal: StopSignal, added: Array) -> Trace:
    """Add a stop signal to go trials by the closed form: OUT plus c(t - SSD), c in ticks."""
    sample_ms = trace.time_ms[1] - trace.time_ms[0]
    onset = np.nan_to_num(signal.onsets(ssd_ms), nan=np.inf)
    since = (trace.time_ms - trace.onset_ms - onset[:, None]) / sample_ms
    # The first value of ``added`` is the response one sample after the onset.
    ticks = np.arange(len(added) + 1)
    c = np.interp(since, ticks, np.append(0.0, added), left=0.0)
    return replace(trace, out_nats=trace.out_nats + c[:, :, None])
