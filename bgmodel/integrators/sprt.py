"""The abstract sequential tests: SPRT for two hypotheses, MSPRT for any number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import warn_of_decisions
from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.deciding.readout import LOG_ODDS, ReadOut, meant
from bgmodel.deciding.readout import threshold_from_posterior as threshold_from_posterior
from bgmodel.deciding.reward import Tally
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence, minus_log_softmax, needed_truth
from bgmodel.integrators.session import Session
from bgmodel.support.checks import check_positive, reals, whole
from circuits.arrays import Array
from circuits.errors import InputError, require

OF_SPRT = ReadOut("the SPRT", unit=LOG_ODDS)
OF_MSPRT = ReadOut("the MSPRT", lowest=0.0)
"""OUT = -ln P falls to 0 and no further."""


class Integrator(Protocol):
    """Maps evidence to an output trace: a test, a baseline model or a circuit."""

    def run(self, evidence: Evidence) -> Trace:
        """Return the output trace of every trial."""
        ...


class Decides:
    """A test that decides where its OUT first crosses a threshold."""

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT."""
        raise NotImplementedError

    def decide(
        self,
        evidence: Evidence,
        threshold: float | None = None,
        *,
        posterior: float | None = None,
        forced: bool = True,
    ) -> Decision:
        """Return the decision of each trial.

        Parameters
        ----------
        evidence : Evidence
            Readings of all trials.
        threshold : float, optional
            OUT at which it decides, nats.
        posterior : float, optional
            Posterior at which it decides; replaces the threshold.
        forced : bool
            Whether the deadline forces a response.

        Raises
        ------
        ValueError
            As for ``first_crossing``.

        Warns
        -----
        UserWarning
            As for ``first_crossing``; if posteriors at decisions are not the proportion correct.
        """
        decision = first_crossing(self.run(evidence), threshold, posterior=posterior, forced=forced)
        warn_of_decisions(evidence, decision)
        return decision

    def session(
        self,
        hypotheses: int = 2,
        threshold: float | None = None,
        *,
        posterior: float | None = None,
        step_ms: float = 1.0,
        t_max: int = 1000,
        prior: npt.ArrayLike | None = None,
        forced: bool = True,
    ) -> Session:
        """Return a session that decides as readings come; options as for ``Session``."""
        count = whole("hypotheses", hypotheses, 2)
        before = self.run(Evidence(np.zeros((1, 1, count)), prior=prior))  # type: ignore[arg-type]
        assert before.readout is not None
        level = before.readout.one(threshold, posterior, count)
        if (before.out_nats[0, 0] < level).any():
            reason = f"the prior is past the threshold of {level:.3g} already{meant(level)}"
            raise InputError(
                f"a session would decide before its first reading: {reason}", "threshold"
            )
        return Session(
            lambda trial: self.run, count, level,
            step_ms=step_ms, t_max=t_max, prior=prior, forced=forced,
        )  # fmt: skip


@dataclass(frozen=True)
class Sprt(Decides):
    """Sequential probability ratio test (Wald 1945) on log posterior odds.

    ``OUT_1 = Z`` and ``OUT_2 = -Z`` with ``Z_t = Z_(t-1) + log p(x_t|S2)/p(x_t|S1)`` and ``Z_0``
    the log prior odds, so that ``OUT_i <= -delta/2`` is the paper's rule: R1 when
    ``Z <= -delta/2``, R2 when ``Z >= delta/2``.
    """

    def run(self, evidence: Evidence) -> Trace:
        """Return Z as a trace (trials, 1 + steps, 2); tick 0 is the prior."""
        start = _log_prior_odds(evidence)
        # Importing Numba takes most of a second: only when it is used.
        from bgmodel.deciding.kernel import log_odds

        out = np.empty((evidence.trials, evidence.steps + 1, 2))
        log_odds(evidence.log_likelihood, start, out)
        return at_readings(out, evidence, OF_SPRT)

    @staticmethod
    def threshold(boundary_separation: npt.ArrayLike) -> Array:
        """Return the threshold on OUT for a boundary separation delta: ``-delta/2``, nats.

        Raises
        ------
        ValueError
            If a separation is negative or not finite.
        """
        return -_checked_gap(boundary_separation) / 2


@dataclass(frozen=True)
class Msprt(Decides):
    """Multi-hypothesis SPRT (Baum & Veeravalli 1994): stop when a posterior is high enough.

    ``OUT_i = -ln P_i = -y_i + ln sum_j exp y_j`` with ``y_i`` the summed log-likelihoods and log
    prior (Bogacz & Gurney 2007).

    Parameters
    ----------
    gain : float
        Factor on the evidence, kappa; 1 is the exact test.
    """

    gain: float = 1.0

    def __post_init__(self) -> None:
        check_positive(gain=self.gain)

    def run(self, evidence: Evidence) -> Trace:
        """Return -ln P as a trace (trials, 1 + steps, hypotheses); tick 0 is the prior."""
        out = minus_log_softmax(self.gain * check_evidence(evidence).totals)
        return at_readings(out, evidence, OF_MSPRT)

    @staticmethod
    def threshold(boundary_separation: npt.ArrayLike) -> Array:
        """Return the threshold on OUT of two hypotheses for a boundary separation delta, nats.

        ``Z >= delta/2  <=>  -ln P_2 <= ln(1 + exp(-delta/2))``. For a posterior, use
        ``threshold_from_posterior``.

        Raises
        ------
        ValueError
            If a separation is negative or not finite.
        """
        return np.asarray(np.log1p(np.exp(-_checked_gap(boundary_separation) / 2)))


def tally_sprt(evidence: Evidence, thresholds: npt.ArrayLike) -> Tally:
    """Count the decisions of the SPRT at each threshold, (K,) nats, without its trace.

    Responses are forced at the deadline.
    """
    from bgmodel.deciding.kernel import tally_odds

    check_evidence(evidence)
    levels = np.asarray(reals("thresholds", thresholds), dtype=np.float64)
    if levels.ndim != 1 or not levels.size or not np.isfinite(levels).all():
        raise InputError.of("thresholds", "must be (K,) finite nats", levels)
    if levels.max() > 0:
        raise InputError(
            f"thresholds of the SPRT are -delta / 2, at most 0, got {levels.max():g}: it would "
            f"decide without evidence{meant(float(levels.max()))}",
            "thresholds",
        )
    truth = needed_truth(evidence)
    start = _log_prior_odds(evidence)
    order = np.argsort(-levels, kind="stable")
    correct, steps, forced = tally_odds(
        evidence.log_likelihood,
        start,
        truth,
        np.append(-levels[order], np.inf),
        np.asarray(evidence.readings, dtype=np.int64),
        np.asarray(evidence.trial_numbers, dtype=np.int64),
    )
    back = np.argsort(order)
    return Tally(evidence.trials, correct[back], steps[back], forced[back])


def _log_prior_odds(evidence: Evidence) -> float:
    """Return Z_0; ValueError unless there are two hypotheses, for which the SPRT is defined."""
    count = check_evidence(evidence).hypotheses
    require(count == 2, "evidence", "must be of exactly 2 hypotheses (or use Msprt)", count)
    return float(np.log(evidence.prior[1]) - np.log(evidence.prior[0]))


def _checked_gap(boundary_separation: npt.ArrayLike) -> Array:
    gap = np.asarray(reals("boundary_separation", boundary_separation), dtype=np.float64)
    if not (gap.size and np.isfinite(gap).all() and (gap >= 0).all()):
        raise InputError.of("boundary_separation", "must be finite and >= 0 nats", gap)
    return gap


def at_readings(out: Array, evidence: Evidence, readout: ReadOut | None = None) -> Trace:
    """Return OUT (trials, 1 + steps, hypotheses) as a trace: tick 0 is the prior.

    A trial ends with its last reading; ``readout`` defines the meaning of its thresholds.
    """
    readings = np.arange(evidence.steps + 1, dtype=np.float64)
    time_ms = evidence.onset_ms + evidence.step_ms * readings
    time_ms[0] = 0.0
    ends = evidence.readings + 1
    numbers = evidence.trial_numbers
    return Trace(
        out, time_ms, evidence.onset_ms, evidence.step_ms, ends, numbers, readout, evidence.truth
    )
