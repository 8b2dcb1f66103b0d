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

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.observer import StopEvidence, log_odds_of_stop
from bgmodel.stopping.trials import StopTrials, stop_trials
from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_range, reals
from circuits.errors import EditWarning, InputError, RangeWarning, require

MOST_NATS = 2.0
"""Larger inputs to STN ring near 20 Hz and rebound by more than 0.15 nats when they end."""
SETTLE_MS = 300.0
"""Time for which ``step_response`` holds the evidence constant before the signal."""
CANCELLED = ("ctx", "ctx_inh")
"""Populations at which a stop signal has no effect: circuits driven by raw evidence cancel input
that is common to all channels of cortex."""


@dataclass(frozen=True)
class StopSignal:
    """How a stop signal reaches a circuit.

    Parameters
    ----------
    nucleus : str
        Nucleus that receives it, in all channels, or one channel of it: "STN[0]".
    amount_nats : float
        Input, nats; negative inhibits.
    delay_ms : float
        Delay from the signal to the nucleus, due to afferent pathways.
    duration_ms : float
        How long it lasts; infinite by default. A signal that ends postpones responses but does not
        cancel them, because the evidence is still there when it ends.
    """

    nucleus: str = "STN"
    amount_nats: float = 1.0
    delay_ms: float = 0.0
    duration_ms: float = float("inf")

    def __post_init__(self) -> None:
        check_range(0, np.inf, delay_ms=self.delay_ms)
        require(self.duration_ms > 0, "duration_ms", "must be > 0", self.duration_ms)
        require(np.isfinite(self.amount_nats), "amount_nats", "must be finite", self.amount_nats)
        if self.nucleus == "STN" and self.amount_nats > MOST_NATS:
            RangeWarning.warn(
                f"amount_nats = {self.amount_nats:g} to STN, more than {MOST_NATS:g}: STN rings "
                "near 20 Hz and rebounds when the input ends"
            )
        if np.isfinite(self.duration_ms):
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
    """Return evidence with a stop signal as an input of the circuit.

    Parameters
    ----------
    evidence : Evidence
        The go task.
    ssd_ms : array (trials,), ms
        Stop-signal delays from the onset of evidence; NaN in go trials.
    signal : StopSignal
        How it reaches the circuit.
    every_ms : float, optional
        Resolution of its onset, a whole fraction of the time between readings, which is the
        default. An onset within an interval counts in proportion to the rest of that interval.

    Raises
    ------
    ValueError
        If there is not one delay per trial, all signals would come after the end, or the resolution
        is not a whole fraction of the time between readings.
    """
    check_evidence(evidence)
    ssd = np.asarray(reals("ssd_ms", ssd_ms), dtype=np.float64)
    require(ssd.shape == (evidence.trials,), "ssd_ms", f"must be ({evidence.trials},)", ssd.shape)
    per_step = 1 if every_ms is None else round(evidence.step_ms / every_ms)
    whole = every_ms is None or abs(per_step * every_ms - evidence.step_ms) < 1e-9
    must = f"must be a whole fraction of the time between readings, {evidence.step_ms:g} ms"
    require(per_step >= 1 and whole, "every_ms", must, every_ms)
    step = evidence.step_ms / per_step
    begins = step * np.arange(per_step * (evidence.steps + 1))
    onset = np.nan_to_num(signal.onsets(ssd), nan=np.inf)[:, None]
    if np.isfinite(onset).any() and onset.min() >= begins[-1] + step:
        must = f"must leave the signal time before the end, {begins[-1] + step:g} ms"
        raise InputError.of("ssd_ms", must, float(np.nanmin(ssd)))
    on = np.clip((begins + step - onset) / step, 0, 1)
    off = np.clip((begins + step - onset - signal.duration_ms) / step, 0, 1)
    return replace(evidence, inputs_nats=signal.amount_nats * (on - off)[:, :, None])


def with_observed_stop(evidence: StopEvidence) -> Evidence:
    """Return the go evidence with the ideal observer's stop signal as an input of the circuit.

    The input is ``c = ln(1 + exp z)``, reading by reading, where z is the log odds of a stop trial:
    a circuit with ``with_inputs("STN")`` then computes the output of ``StopMsprt``. The input is
    limited to ``MOST_NATS``, which blocks every response already.
    """
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
    """Simulate a circuit in stop-signal trials.

    A response is made when OUT crosses the threshold, and withheld if it does not cross before the
    trial ends. Parameters are those of ``with_stop`` and ``BasalGanglia.decide``.

    Raises
    ------
    ValueError
        If the signal is given to a nucleus at which common input is cancelled, or as for
        ``with_stop`` and ``BasalGanglia.threshold``.

    Warns
    -----
    UserWarning
        If the evidence leaves the circuit's range, or noise alone crosses the threshold, as in
        ``BasalGanglia.decide``.
    """
    name = signal.nucleus
    if name in (model.circuit.input, *CANCELLED) and not model.circuit.centred:
        raise InputError.of(
            "nucleus", "must be one that the signal can act through, such as STN; input common to "
            "all channels is cancelled behind cortex", name,
        )  # fmt: skip
    model = replace(model, circuit=model.circuit.with_inputs(name))
    level = model.threshold(threshold, posterior)
    model.warn_beyond_range(evidence)
    model.warn_of_noise(level)
    given = with_stop(evidence, ssd_ms, signal, every_ms)
    decision = model.decided(given, level, forced=False)
    return stop_trials(decision, ssd_ms, evidence.hypotheses)


def step_response(
    model: BasalGanglia,
    signal: StopSignal,
    *,
    posterior: float = 0.8,
    time_ms: float = 1000.0,
    step_ms: float = 10.0,
) -> tuple[Array, Array]:
    """Return c(t), the change of the leader's OUT by a signal at time 0, in rates without noise.

    Parameters
    ----------
    model : BasalGanglia
        The circuit and its gain.
    signal : StopSignal
        The signal; its afferent delay is left out.
    posterior : float
        Posterior of the leader, held constant. Where OUT is high, as at rest, its rate saturates
        and the signal changes it less.
    time_ms, step_ms : float
        Length and resolution.

    Returns
    -------
    time_ms : array (ticks,)
        Times from the onset of the signal on.
    added_nats : array (ticks,)
        c at these times.
    """
    channels, steps = model.circuit.channels, round((SETTLE_MS + time_ms) / step_ms)
    nats = np.log([posterior, *[(1 - posterior) / (channels - 1)] * (channels - 1)]) / model.gain
    prior = np.exp(nats - nats.max())
    held = Evidence(
        np.zeros((2, steps, channels)), prior=prior / prior.sum(), step_ms=step_ms, baseline=0.0
    )
    given = with_stop(held, [SETTLE_MS, np.nan], replace(signal, delay_ms=0.0))
    quiet = replace(model, circuit=model.circuit.with_inputs(signal.nucleus), engine="rate")
    activity = quiet.activity(given)
    late = activity.time_ms > SETTLE_MS
    out = activity.output_nats[:, late, 0]
    return activity.time_ms[late] - SETTLE_MS, out[0] - out[1]


def closed_form(trace: Trace, ssd_ms: npt.ArrayLike, signal: StopSignal, added: Array) -> Trace:
    """Add a stop signal to go trials by the closed form: OUT plus c(t - SSD).

    Parameters
    ----------
    trace : Trace
        OUT of the trials without a signal.
    ssd_ms : array (trials,), ms
        Stop-signal delays; NaN in go trials.
    signal : StopSignal
        How it reaches the circuit.
    added : array (ticks,), nats
        c at the ticks of the trace, from the onset of the signal on; see ``step_response``.
    """
    sample_ms = trace.time_ms[1] - trace.time_ms[0]
    onset = np.nan_to_num(signal.onsets(ssd_ms), nan=np.inf)
    since = (trace.time_ms - trace.onset_ms - onset[:, None]) / sample_ms
    # The first value of ``added`` is the response one sample after the onset.
    ticks = np.arange(len(added) + 1)
    c = np.interp(since, ticks, np.append(0.0, added), left=0.0)
    return replace(trace, out_nats=trace.out_nats + c[:, :, None])
