"""Warnings of what makes numbers of a comparison absent or wrong."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from bgmodel.comparison.compare import Tradeoff, curve, margin
from bgmodel.evidence import Evidence

STANDARD_ERRORS = 3.29
"""Half the width of a 99.9 % interval: one false alarm in a thousand comparisons."""


def ceiling(evidence: Evidence) -> float:
    """Return the expected accuracy of the most probable hypothesis after all readings of a trial.

    No decider that knows the same likelihoods is more accurate, whatever its threshold.
    """
    last = evidence.posterior[np.arange(evidence.trials), evidence.readings]
    return float(last.max(axis=1).mean())


def warn_of_ceiling(evidence: Evidence, accuracies: Sequence[float]) -> list[float]:
    """Warn of accuracies that the readings do not allow, and return the others.

    Parameters
    ----------
    evidence : Evidence
        The trials that are decided.
    accuracies : sequence of float
        The requested accuracies.
    """
    top = ceiling(evidence)
    lost = [accuracy for accuracy in accuracies if accuracy - top > margin(accuracy)]
    if lost:
        warnings.warn(
            f"no threshold reaches an accuracy of {listed(lost)}: all readings of a trial, "
            f"{evidence.steps} at most, allow {top:.3f}; give more readings (t_max) or ask for a "
            "lower accuracy",
            stacklevel=3,
        )
    return [accuracy for accuracy in accuracies if accuracy not in lost]


def warn_of_own_ceiling(name: str, found: Tradeoff, accuracies: Sequence[float]) -> None:
    """Warn of accuracies that the readings allow but a model does not reach.

    Parameters
    ----------
    name : str
        The model, as the warning names it.
    found : Tradeoff
        The model's decisions.
    accuracies : sequence of float
        Accuracies that the readings allow, as from ``warn_of_ceiling``.
    """
    reached = curve(found, np.ones((1, found.trials)))[0][0]
    best = int(reached.argmax())
    lost = [accuracy for accuracy in accuracies if accuracy - reached[best] > margin(accuracy)]
    if lost:
        warnings.warn(
            f"{name} reaches no accuracy of {listed(lost)}: at the best of its thresholds it has "
            f"{reached[best]:.3f}, and the deadline decides {found.forced[best].mean():.0%} of its "
            "trials there",
            stacklevel=3,
        )


def calibration(posterior: float, accuracy: float, decisions: float) -> str:
    """Return a sentence if the mean posterior at the decision differs from accuracy, or no text.

    If likelihoods and prior are those of the readings, the two are equal under any stopping rule,
    because the posterior is a martingale.

    Parameters
    ----------
    posterior : float
        Mean posterior of the choice, at the decision.
    accuracy : float
        Share of the same decisions that are right.
    decisions : float
        Their number.

    Notes
    -----
    The variance of ``right - posterior`` is ``E[P (1 - P)]`` where posteriors are calibrated, at
    most that of their mean.
    """
    off, which = accuracy - posterior, miscalibrated(posterior, accuracy, decisions)
    if not which:
        return ""
    half = _half_width(posterior, accuracy, decisions)
    return (
        f"the evidence is too {which}: its mean posterior at the decision is {posterior:.3f}, and "
        f"{accuracy:.3f} of {decisions:.0f} decisions are right (difference {off:+.3f}, 99.9 % "
        f"interval {off - half:+.3f} to {off + half:+.3f}); its likelihoods or its prior are not "
        "those of these trials (under conflict they never are), so posteriors are not calibrated: "
        "accuracies that are expected from them are off by as much"
    )


def miscalibrated(posterior: float, accuracy: float, decisions: float) -> str:
    """Return "sure" or "unsure" where ``calibration`` says that the evidence is, or no text."""
    off = accuracy - posterior
    if not abs(off) > _half_width(posterior, accuracy, decisions):
        return ""
    return "sure" if off < 0 else "unsure"


def _half_width(posterior: float, accuracy: float, decisions: float) -> float:
    """Return half the width of the difference's 99.9 % interval; infinity without decisions."""
    if not decisions > 0:
        return np.inf
    # Without errors there is no scatter: the variance is at least that of calibrated posteriors.
    variance = max(posterior * (1 - posterior), accuracy * (1 - accuracy))
    return STANDARD_ERRORS * float(np.sqrt(variance / decisions))


def warn_of_calibration(stated: npt.ArrayLike, correct: npt.ArrayLike) -> None:
    """Warn if the mean posterior at the decision differs from the accuracy: see ``calibration``.

    Parameters
    ----------
    stated : array (trials,)
        Posterior of the choice, at the decision.
    correct : array (trials,)
        Whether the choice is right.
    """
    posterior, right = np.asarray(stated, dtype=np.float64), np.asarray(correct, dtype=np.float64)
    if len(right) and (said := calibration(posterior.mean(), right.mean(), len(right))):
        warnings.warn(said, stacklevel=3)


def listed(values: Iterable[float]) -> str:
    """Return numbers as text."""
    return ", ".join(f"{value:.3g}" for value in values)
