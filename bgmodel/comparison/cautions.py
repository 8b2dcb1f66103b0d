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


def warn_of_calibration(stated: npt.ArrayLike, correct: npt.ArrayLike) -> None:
    """Warn if the mean posterior at the decision differs from the accuracy.

    If likelihoods and prior are those of the readings, the two are equal under any stopping rule,
    because the posterior is a martingale.

    Parameters
    ----------
    stated : array (trials,)
        Posterior of the choice, at the decision.
    correct : array (trials,)
        Whether the choice is right.
    """
    posterior, right = np.asarray(stated, dtype=np.float64), np.asarray(correct, dtype=np.float64)
    off = right - posterior
    # Without errors there is no scatter: the variance is at least that of calibrated posteriors.
    variance = max(off.var(), float((posterior * (1 - posterior)).mean()))
    half = STANDARD_ERRORS * np.sqrt(variance / len(off))
    if abs(off.mean()) > half:
        sure = "sure" if off.mean() < 0 else "unsure"
        low, high = off.mean() - half, off.mean() + half
        warnings.warn(
            f"the evidence is too {sure}: its mean posterior at the decision is "
            f"{posterior.mean():.3f}, and {right.mean():.3f} of {len(off)} decisions are right "
            f"(difference {off.mean():+.3f}, 99.9 % interval {low:+.3f} to {high:+.3f}); its "
            "likelihoods or its prior are not calibrated, and accuracies that are expected from "
            "posteriors are off by as much",
            stacklevel=3,
        )


def listed(values: Iterable[float]) -> str:
    """Return numbers as text."""
    return ", ".join(f"{value:.3g}" for value in values)
