"""The ideal observer of the stop-signal task: a test with one more hypothesis, the stop signal.

Go and stop evidence are independent, so the probability that the trial is a go trial of response i
is ``P_i (1 - P_stop)``, and

    OUT_i = -ln P_i - ln(1 - P_stop) = -ln P_i + ln(1 + exp z),
    OUT_stop = -ln P_stop = ln(1 + exp(-z)),

where z is the log odds of a stop trial. The stop signal adds ``c = ln(1 + exp z)`` to all responses
alike, as an input to STN that all channels share would. Withholding is one more response, made if
OUT_stop crosses its threshold first. The probabilities of responses and of the stop sum to 1, so
the observer is calibrated like the MSPRT.

The signal may begin at any reading k of a known distribution f. With l_t the log-likelihood ratio
of reading t (signal on against off),

    z_t = logit(share) + ln(A_t + 1 - F_t),   A_t = (A_(t-1) + f_t) exp(l_t),

where F_t is the sum of f up to t. A_t sums over signals that have begun, each weighted by the
evidence since then, and 1 - F_t is the probability of those still to come.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.sprt import OF_MSPRT, Msprt
from bgmodel.support.checks import check_positive, reals
from bgmodel.support.seeds import generator
from circuits.arrays import Array
from circuits.errors import InputError, require


@dataclass(frozen=True)
class StopEvidence:
    """Evidence for a stop signal, reading by reading, and the evidence of the go task."""

    go: Evidence  # its readings come at the same times as those of the signal
    log_ratio: Array  # (trials, steps), nats, log p(reading | on) - log p(reading | off)
    ssd_ms: Array  # (trials,), from the onset; NaN in go trials. Readings after it have the signal.
    share: float  # prior probability of a stop trial
    begins: Array  # (steps,), prior that reading k of a stop trial is the first with it

    def __post_init__(self) -> None:
        check_evidence(self.go)
        wanted = {"log_ratio": (self.go.trials, self.go.steps), "ssd_ms": (self.go.trials,),
                  "begins": (self.go.steps,)}  # fmt: skip
        for name, shape in wanted.items():
            values = np.asarray(reals(name, getattr(self, name)), dtype=np.float64)
            require(values.shape == shape, name, f"must have shape {shape}", values.shape)
            object.__setattr__(self, name, values)
        require(np.isfinite(self.log_ratio).all(), "log_ratio", "must be finite", self.log_ratio)
        require(0 < self.share < 1, "share", "must be between 0 and 1", self.share)
        fits = (self.begins >= 0).all() and abs(self.begins.sum() - 1) < 1e-9
        require(fits, "begins", "must be probabilities that sum to 1", self.begins)


def first_reading(ssd_ms: Array, step_ms: float) -> npt.NDArray[np.int64]:
    """Return the number of the first reading (from 1 on) that comes after each delay."""
    return np.floor(np.asarray(ssd_ms) / step_ms + 1e-9).astype(np.int64) + 1


def gaussian_stop_evidence(
    go: Evidence,
    ssd_ms: npt.ArrayLike,
    *,
    d_prime: float,
    share: float,
    delays_ms: npt.ArrayLike,
    rng: np.random.Generator | int,
) -> StopEvidence:
    """Return Gaussian evidence for a stop signal of mean ``d_prime`` after the delay.

    Delays, (trials,) ms, are NaN in go trials; the prior is ``share`` of stop trials and equally
    likely ``delays_ms``.
    """
    check_positive(d_prime=d_prime)
    ssd = np.asarray(reals("ssd_ms", ssd_ms), dtype=np.float64)
    expected = first_reading(np.atleast_1d(np.asarray(delays_ms, float)), go.step_ms)
    if expected.max() > go.steps:
        latest = f"must leave a reading before the end, {go.steps * go.step_ms:g} ms"
        raise InputError.of("delays_ms", latest, float(np.max(delays_ms)))
    begins = np.bincount(expected - 1, minlength=go.steps) / len(expected)
    at = first_reading(np.where(np.isnan(ssd), np.inf, ssd).clip(max=1e12), go.step_ms)
    on = np.arange(1, go.steps + 1) >= at[:, None]
    readings = generator(rng).standard_normal(on.shape) + d_prime * on
    return StopEvidence(go, d_prime * readings - d_prime**2 / 2, ssd, share, begins)


def log_odds_of_stop(evidence: StopEvidence) -> Array:
    """Return z, the log odds of a stop trial after each reading, (trials, 1 + steps)."""
    from scipy import special

    trials, steps = evidence.log_ratio.shape
    with np.errstate(divide="ignore"):
        log_f = np.log(evidence.begins)
        to_come = np.log(np.clip(1 - np.cumsum(evidence.begins), 0, None))
    to_come[evidence.begins[::-1].cumsum()[::-1] - evidence.begins <= 1e-12] = -np.inf
    z = np.zeros((trials, 1 + steps))
    begun = np.full(trials, -np.inf)
    for t in range(steps):
        begun = np.logaddexp(begun, log_f[t]) + evidence.log_ratio[:, t]
        z[:, t + 1] = np.logaddexp(begun, to_come[t])
    return np.asarray(z + special.logit(evidence.share))


@dataclass(frozen=True)
class StopMsprt:
    """The MSPRT with a stop signal: the ideal observer of the stop-signal task.

    With ``extra_channel``, a baseline model, the stop is one more channel with evidence z, which
    adds ``ln(1 + exp(z - S))``, S = ln sum exp y, to OUT instead of ``ln(1 + exp z)``.
    """

    gain: float = 1.0  # on the evidence of the go task; 1 is the ideal observer
    extra_channel: bool = False

    def __post_init__(self) -> None:
        check_positive(gain=self.gain)

    def run(self, evidence: StopEvidence) -> Trace:
        """Return OUT (trials, 1 + steps, responses + 1), nats; the last channel is the stop."""
        from scipy import special

        z, go = log_odds_of_stop(evidence)[:, :, None], Msprt(self.gain).run(evidence.go)
        if self.extra_channel:
            totals = self.gain * evidence.go.own_totals
            every = np.concatenate([totals, z], axis=2)
            out = special.logsumexp(every, axis=2, keepdims=True) - every
        else:
            out = np.concatenate([go.out_nats + np.logaddexp(0, z), np.logaddexp(0, -z)], axis=2)
        return replace(go, out_nats=out, readout=OF_MSPRT)

    def decide(self, evidence: StopEvidence, posterior: float, stop_posterior: float) -> Decision:
        """Return the decision of each trial; the last choice is to withhold for good."""
        responses = evidence.go.hypotheses
        levels = -np.log(np.array([[*[posterior] * responses, stop_posterior]]))
        decision = first_crossing(self.run(evidence), levels, forced=False, checked=False)
        first = {name: getattr(decision, name)[0] for name in ("choice", "time_ms", "forced")}
        return replace(decision, **first, premature=decision.premature[0], truth=evidence.go.truth)
