"""Inputs of a circuit at their own time in each trial, such as a stop signal, and its closed form.

A constant input of A nats to STN adds A to every output of the default circuit at its fixed point,
``OUT_i = -ln P_i + A``. This holds at every S because GPe responds to Sigma, the sum of STN, with
Sigma - ln Sigma (``circuits.anatomy.macaque``). In time, ``OUT_stop(t) = OUT_go(t) + c(t - SSD)``,
where c is the response of OUT to the input alone, and SSD the stop-signal delay. As -ln P is never
negative, c blocks every response once it exceeds the threshold, so that
``p(respond | SSD) = F_go(SSD + latency)``, where F_go is the distribution of go response times: the
horse race of Logan & Cowan (1984).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.observer import StopEvidence, log_odds_of_stop
from bgmodel.stopping.trials import StopTrials, stop_trials
from bgmodel.support.checks import check_range, reals
from circuits.arrays import Array
from circuits.checks import check_types
from circuits.errors import DataWarning, EditWarning, InputError, RangeWarning, quiet, require

MOST_NATS = 2.0
"""Larger inputs to STN ring near 20 Hz and rebound by more than 0.15 nats when they end."""
RESOLUTION_MS = 10.0
"""Longest interval within which an input is constant."""


@dataclass(frozen=True)
class StopSignal:
    """How a stop signal reaches a circuit."""

    nucleus: str = "STN"
    """Nucleus that receives the signal, in all channels, or one channel of it: "STN[0]"."""
    amount_nats: float = 1.0
    """Input to the nucleus, nats; negative inhibits."""
    delay_ms: float = 0.0
    """Delay from the signal to the nucleus, due to afferent pathways, ms."""
    duration_ms: float = float("inf")
    """How long the input lasts, ms; without an end by default. An input that ends postpones
    responses but does not cancel them, because the evidence is still there when it ends."""
    cancel_ms: float = float("inf")
    """Time from the signal until the response is cancelled, ms; never by default. The evidence of
    the trial is back at the prior from then on (Schmidt & Berke 2017)."""

    def __post_init__(self) -> None:
        check_types(self, type(self).__name__)
        check_range(0, np.inf, delay_ms=self.delay_ms)
        require(self.cancel_ms >= 0, "cancel_ms", "must be >= 0", self.cancel_ms)
        require(self.duration_ms > 0, "duration_ms", "must be > 0", self.duration_ms)
        require(np.isfinite(self.amount_nats), "amount_nats", "must be finite", self.amount_nats)
        if self.nucleus == "STN" and self.amount_nats > MOST_NATS:
            RangeWarning.warn(
                f"amount_nats = {self.amount_nats:g} to STN, more than {MOST_NATS:g}: STN rings "
                "near 20 Hz and rebounds when the input ends"
            )
        if np.isfinite(self.cancel_ms):
            return
        if self.amount_nats == 0:
            EditWarning.warn("a signal of 0 nats without a cancel has no effect")
        elif np.isfinite(self.duration_ms):
            EditWarning.warn(
                f"an input of {self.duration_ms:g} ms postpones responses but does not cancel "
                "them: the evidence is still there when it ends"
            )

    def onsets(self, ssd_ms: npt.ArrayLike) -> Array:
        """Return when it reaches the nucleus in each trial, ms from the go stimulus, or NaN."""
        return np.asarray(reals("ssd_ms", ssd_ms), dtype=np.float64) + self.delay_ms


def with_stop(
    evidence: Evidence, ssd_ms: npt.ArrayLike, signal: StopSignal, every_ms: float | None = None
) -> Evidence:
    """Return evidence with a stop signal as an input; delays (trials,) ms are NaN in go trials."""
    check_evidence(evidence)
    ssd = np.asarray(reals("ssd_ms", ssd_ms), dtype=np.float64)
    require(ssd.shape == (evidence.trials,), "ssd_ms", f"must be ({evidence.trials},)", ssd.shape)
    return with_onsets(evidence, signal.onsets(ssd), signal, every_ms)


def with_onsets(
    evidence: Evidence, onset_ms: Array, signal: StopSignal, every_ms: float | None = None
) -> Evidence:
    """Return evidence with a stop signal that reaches the nucleus at ``onset_ms``, (trials,)."""
    end = evidence.step_ms * (evidence.steps + 1)
    if np.isfinite(onset_ms).any() and np.nanmin(onset_ms) >= end:
        must = f"must leave the signal time before the end, {end:g} ms"
        raise InputError.of("ssd_ms", must, float(np.nanmin(onset_ms)) - signal.delay_ms)
    with_signal = with_input(evidence, onset_ms, signal.amount_nats, signal.duration_ms, every_ms)
    return cancelled(with_signal, onset_ms - signal.delay_ms + signal.cancel_ms)


def with_input(
    evidence: Evidence,
    onset_ms: npt.ArrayLike,
    amount_nats: npt.ArrayLike = 1.0,
    duration_ms: npt.ArrayLike = np.inf,
    every_ms: float | None = None,
) -> Evidence:
    """Return evidence with an input of a circuit that has its own time and size in each trial.

    It is added to the inputs that the evidence has, as the next of ``circuit.with_inputs``. Each
    number is one for all trials or one per trial; an onset of NaN means no input: draw such trials
    at random, since of every second one all may have the same truth. The resolution is a whole
    fraction of the time between readings; an input that begins within an interval counts in
    proportion to the rest of it.
    """
    per_step = _per_step(evidence.step_ms, every_ms)
    step, times = evidence.step_ms / per_step, per_step * (evidence.steps + 1)
    begins = step * np.arange(times)
    values = {"onset_ms": onset_ms, "amount_nats": amount_nats, "duration_ms": duration_ms}
    onset, amount, lasts = (_per_trial(name, evidence, each) for name, each in values.items())
    timed = ~np.isnan(onset)
    for name, value, allowed, must in (
        ("onset_ms", onset, ~timed | ((onset >= 0) & (onset < np.inf)), "must be >= 0 and finite"),
        ("amount_nats", amount, np.isfinite(amount), "must be finite"),
        ("duration_ms", lasts, lasts > 0, "must be > 0"),
    ):
        require(allowed.all(), name, must, float(value.ravel()[np.argmin(allowed)]))
    marks = onset.size > 2 and set(onset.ravel()) == {0.0, 1.0}
    if marks:
        EditWarning.warn(
            "every trial receives the input, from 0 or 1 ms on: is this a mask of trials? Give the "
            "onset in ms, and NaN for trials without it"
        )
    onset = np.where(timed, onset, np.inf)
    on = np.clip((begins + step - onset) / step, 0, 1)
    off = np.clip((begins + step - onset - lasts) / step, 0, 1)
    added = (amount * (on - off))[:, :, None]
    if (timed & (amount != 0)).any() and not added.any():
        EditWarning.warn(f"the input has no effect: all trials end by {step * times:g} ms")
    if evidence.inputs_nats is not None:
        same = evidence.inputs_nats.shape[1] == times
        must = "must be the resolution of the inputs that the evidence has"
        require(same, "every_ms", must, f"{step:g} ms")
        added = np.concatenate([evidence.inputs_nats, added], axis=2)
    return replace(evidence, inputs_nats=added)


def _per_step(step_ms: float, every_ms: float | None) -> int:
    if every_ms is None:
        return int(np.ceil(step_ms / RESOLUTION_MS - 1e-9))
    count = round(step_ms / every_ms)
    divides = count >= 1 and abs(count * every_ms - step_ms) < 1e-9
    must = f"must be a whole fraction of the time between readings, {step_ms:g} ms"
    require(divides, "every_ms", must, every_ms)
    return count


def _per_trial(name: str, evidence: Evidence, numbers: npt.ArrayLike) -> Array:
    # A mask would be onsets of 0 and 1 ms, and amounts of 0 and 1 nat.
    require(np.asarray(numbers).dtype != bool, name, "must be numbers, not true and false", numbers)
    values = np.asarray(reals(name, numbers), dtype=np.float64)
    must = f"must be one number, or ({evidence.trials},)"
    require(values.shape in ((), (evidence.trials,)), name, must, values.shape)
    return np.broadcast_to(values, (evidence.trials,))[:, None]


def cancelled(evidence: Evidence, at_ms: npt.ArrayLike) -> Evidence:
    """Return evidence that is back at the prior from a time of each trial on, (trials,) ms."""
    reading = np.arange(1, evidence.steps + 1)
    read = reading <= evidence.readings[:, None]
    late = read & (evidence.step_ms * reading >= np.asarray(at_ms, float)[:, None])
    if not late.any():
        return evidence
    first = late & (np.cumsum(late, axis=1) == 1)
    # A circuit whose channels get their own evidence subtracts the baseline from every reading.
    tone = evidence.baseline or 0.0
    values = np.where(late[:, :, None], tone, evidence.log_likelihood)
    before = (read & ~late)[:, :, None]
    heard = np.where(before, evidence.log_likelihood - tone, 0.0).sum(axis=1)
    values[first] -= heard[first.any(axis=1)]
    # They were checked before; readings after a cancel are alike for all hypotheses on purpose.
    with quiet(DataWarning):
        return replace(evidence, log_likelihood=values)


SETTLE_MS, LEADS = 300.0, 0.8
"""Time for which ``step_response`` holds the evidence constant before the signal, and the posterior
of the leader."""
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
) -> StopTrials:
    """Simulate a circuit in stop-signal trials; parameters as of ``with_stop`` and ``decide``."""
    model = receiving(model, signal)
    level = model.threshold(threshold, posterior)
    model.warn_beyond_range(evidence)
    model.warn_of_noise(level)
    stopped = with_stop(evidence, ssd_ms, signal)
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
    model: BasalGanglia, signal: StopSignal, *, time_ms: float = 1000.0
) -> tuple[Array, Array]:
    """Return times and c(t), nats: how a signal at time 0 changes the leader's OUT, without noise.

    The leader's posterior is constant, ``LEADS``; the afferent delay is left out.
    """
    channels, steps = model.circuit.channels, round((SETTLE_MS + time_ms) / RESOLUTION_MS)
    nats = np.log([LEADS, *[(1 - LEADS) / (channels - 1)] * (channels - 1)]) / model.gain
    prior = np.exp(nats - nats.max())
    held = Evidence(
        np.zeros((2, steps, channels)), prior=prior / prior.sum(), step_ms=RESOLUTION_MS,
        baseline=0.0,
    )  # fmt: skip
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
