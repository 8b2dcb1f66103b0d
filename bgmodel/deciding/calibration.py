"""Calibration: whether posteriors at decisions equal the proportion correct."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import UNDECIDED, Decision
from bgmodel.evidence import Evidence, minus_log_softmax
from circuits.arrays import Array, Integers
from circuits.errors import CalibrationWarning

FEWEST_CHOICES = 20
"""Smallest number of choices for a check of whether they go against the evidence."""
SHORT_NATS = 0.35
"""How far, in log odds, decisions may rest on less evidence than their threshold asks for. The
noise of ``macaque_small``, an eighth of the default circuit's cells, accounts for up to 0.3."""
ROUNDING = 1e-9
STANDARD_ERRORS = 3.29
"""Half the width of a 99.9 % interval: one false alarm in a thousand comparisons."""


LEAST_SCALE = 0.02
"""Nats per unit below which log-likelihoods tell nothing of the truth."""
STOP = 0.9
"""Readings are compared with the truth up to this posterior: later ones add little."""
SCALED_TRIALS = 10_000
"""Number of trials examined, evenly spaced."""
UNITS = {"log2": np.log(2), "log10": np.log(10)}
"""Logarithms that can be mistaken for natural ones, and nats per unit of each."""
NEAR = 0.3
"""A factor is taken for that of a unit within this distance, in natural logarithms."""
SCALES = (0.83, 1.52)
"""Range of nats per unit outside which log2 (0.69) or log10 (2.3) is nearer than 1 (by ratio)."""


def posterior_at(evidence: Evidence, time_ms: Array, choice: Integers) -> Array:
    """Return the posterior of choices at times since the onset of evidence, ms, (..., trials).

    It is the posterior after the decision's last reading, or the prior before the first.
    """
    reading = _last_reading(evidence, time_ms)
    return np.asarray(evidence.posterior[np.arange(evidence.trials), reading, choice])


def _last_reading(evidence: Evidence, time_ms: Array) -> Integers:
    reading = np.floor(np.maximum(time_ms, 0) / evidence.step_ms + 1e-9).astype(np.intp)
    return np.minimum(reading, evidence.readings)


def warn_of_units(evidence: Evidence) -> None:
    """Warn if, judging by the truth, log-likelihoods of independent trials are not in nats.

    If their unit is ``k`` nats, posteriors are those of ``k`` times the evidence. Each trial is
    read up to a posterior of ``STOP``. At that point the derivative with respect to k of the log
    posterior of the truth, ``L_true - sum_i P_i L_i`` at k = 1, has a mean of 0 if the unit is
    nats, under any stopping rule. Its z score is tested at 99.9 %: at most one false alarm in a
    thousand tables, since k must also be outside ``SCALES``.
    """
    some = evidence[:: -(-evidence.trials // SCALED_TRIALS)]
    if (
        some.truth is None
        or some.trials < FEWEST_CHOICES
        or len(np.unique(some.truth)) < some.hypotheses
    ):
        return
    sure = some.posterior.max(axis=2) >= STOP
    sure[:, 0] = False
    read = np.where(sure.any(axis=1), sure.argmax(axis=1), some.readings)
    trial = np.arange(some.trials)
    told = some.totals[trial, read] - np.log(some.prior)
    posterior = some.posterior[trial, read]
    mean = (posterior * told).sum(axis=1)
    scores = told[trial, some.truth] - mean
    expected = (posterior * (told - mean[:, None]) ** 2).sum()
    variance = max(expected, float((scores**2).sum()))
    if not abs(scores.sum()) > STANDARD_ERRORS * np.sqrt(variance):
        return
    scale = _nats_per_unit(told, some)
    if SCALES[0] < scale < SCALES[1]:
        return
    if scale < LEAST_SCALE:
        CalibrationWarning.warn(
            "the log-likelihoods tell nothing of the truth or contradict it: look for reversed "
            "signs, exchanged columns, or the truth of other trials"
        )
        return
    likely = [name for name, nats in UNITS.items() if abs(np.log(scale / nats)) < NEAR]
    units = "".join(
        f"give natural logarithms, those of {u} times {UNITS[u]:.3f}, or " for u in likely
    )
    CalibrationWarning.warn(
        "the log-likelihoods do not fit the truth: posteriors would be right if each were "
        f"multiplied by about {scale:.2g}: {units}look for readings that are not independent, "
        "another truth, or likelihoods of other readings"
    )


def _nats_per_unit(told: Array, evidence: Evidence) -> float:
    """Return the maximum-likelihood factor on log-likelihoods (trials, hypotheses)."""
    # Importing scipy.optimize takes a third of a second: only when it is needed.
    from scipy.optimize import minimize_scalar

    def loss(log_scale: float) -> float:
        posterior = minus_log_softmax(np.log(evidence.prior) + np.exp(log_scale) * told)
        return float(posterior[np.arange(evidence.trials), evidence.truth].sum())

    return float(np.exp(minimize_scalar(loss, bounds=np.log([0.01, 100]), method="bounded").x))


def calibration(posterior: float, accuracy: float, decisions: float) -> str:
    """Return a warning if mean posterior at the decision and accuracy differ, or an empty string.

    If likelihoods and prior are those of the readings, the two are equal under any stopping rule,
    because the posterior is a martingale. The variance of ``right - posterior`` is ``E[P (1 - P)]``
    for calibrated posteriors, at most ``Q (1 - Q)`` with Q the mean posterior.
    """
    off, which = accuracy - posterior, miscalibrated(posterior, accuracy, decisions)
    if not which:
        return ""
    half = _half_width(posterior, accuracy, decisions)
    return (
        f"the evidence is too {which}: its mean posterior at the decision is {posterior:.3f}, and "
        f"{accuracy:.3f} of {decisions:.0f} decisions are correct (difference {off:+.3f}, 99.9 % "
        f"interval {off - half:+.3f} to {off + half:+.3f}); its likelihoods or its prior are not "
        "those of these trials (under conflict they never are), so posteriors are not calibrated: "
        "accuracies predicted from them are off by as much"
    )


def miscalibrated(posterior: float, accuracy: float, decisions: float) -> str:
    """Return "sure" or "unsure" if ``calibration`` finds the evidence to be so, or ""."""
    off = accuracy - posterior
    if not abs(off) > _half_width(posterior, accuracy, decisions):
        return ""
    return "sure" if off < 0 else "unsure"


def _half_width(posterior: float, accuracy: float, decisions: float) -> float:
    """Return the half-width of the difference's 99.9 % interval; infinity without decisions."""
    if not decisions > 0:
        return np.inf
    # Without errors accuracy has no variance: it is at least that of calibrated posteriors.
    variance = max(posterior * (1 - posterior), accuracy * (1 - accuracy))
    return STANDARD_ERRORS * float(np.sqrt(variance / decisions))


def warn_of_calibration(stated: npt.ArrayLike, correct: npt.ArrayLike) -> None:
    """Warn if mean posterior at the decision and accuracy differ: see ``calibration``."""
    posterior, right = np.asarray(stated, dtype=np.float64), np.asarray(correct, dtype=np.float64)
    if len(right) and (warning := calibration(posterior.mean(), right.mean(), len(right))):
        CalibrationWarning.warn(warning)


def against_evidence(stated: npt.ArrayLike, hypotheses: int) -> str:
    """Return a warning if choices go against the evidence, or an empty string.

    Random choices have a mean posterior of chance, ``1 / hypotheses``; choices guided by evidence
    have a higher one. It is below chance if OUT rises with evidence, as without dopamine. Fewer
    than ``FEWEST_CHOICES`` are not judged.
    """
    posterior, chance = np.asarray(stated, dtype=np.float64), 1 / hypotheses
    if len(posterior) < FEWEST_CHOICES:
        return ""
    mean = posterior.mean()
    if mean + STANDARD_ERRORS * posterior.std() / np.sqrt(len(posterior)) > chance - ROUNDING:
        return ""
    return (
        f"choices go against the evidence: their mean posterior at the decision is {mean:.3f}, and "
        f"random choices have {chance:.3g}; an edit has reversed the circuit's response, as "
        "dopamine near 0 does, so accuracy and times are not those of decisions by evidence"
    )


def warn_of_early_decisions(
    evidence: Evidence, decision: Decision, gain: float, asked: float
) -> None:
    """Warn if a circuit decides on much less evidence than it is asked for.

    OUT is -ln P of the evidence times the gain, and decisions stop at a posterior ``asked``: their
    mean posterior is about that, or more by the last reading. Strong noise lowers it, and so does
    evidence that rises faster in all channels than STN and GPe can balance.
    """
    in_time = (decision.choice != UNDECIDED) & ~decision.forced
    if in_time.sum() < FEWEST_CHOICES:
        return
    some, choice = np.flatnonzero(in_time), decision.choice[in_time]
    reading = _last_reading(evidence, np.where(in_time, decision.time_ms, 0.0))[in_time]
    log_p = -minus_log_softmax(gain * evidence.totals[some, reading])
    stated = np.exp(log_p[np.arange(len(some)), choice])
    if stated.mean() >= 1 / (1 + (1 / asked - 1) * np.exp(SHORT_NATS)):
        return
    CalibrationWarning.warn(
        f"the circuit decides too early: at its gain of {gain:.2g} the mean posterior at the "
        f"decision is {stated.mean():.3f}, and the threshold asks for {asked:.3g}; noise crosses "
        "the threshold, or evidence rises in all channels faster than the circuit balances it, as "
        "it does if one alternative is as good as ruled out: leave that out, or lower the gain"
    )


def warn_of_decisions(evidence: Evidence, decision: Decision) -> None:
    """Warn if decisions at one threshold go against the evidence or are not calibrated."""
    decided = decision.choice != UNDECIDED
    times = np.where(decided, decision.time_ms, 0.0)  # NaN is not the time of a reading
    stated = posterior_at(evidence, times, decision.choice)
    in_time, count = decided & ~decision.forced, evidence.hypotheses
    # Without a decision in time, those that the deadline made still have an accuracy.
    warning = against_evidence(stated[in_time], count) or against_evidence(stated[decided], count)
    if warning:
        CalibrationWarning.warn(warning)
    if evidence.truth is None:
        return
    warn_of_calibration(stated[decided], (decision.choice == evidence.truth)[decided])
