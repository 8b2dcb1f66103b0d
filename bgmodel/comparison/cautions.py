"""Warnings about missing or wrong numbers in a comparison."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from bgmodel.deciding.tradeoff import Tradeoff, curve, margin
from bgmodel.evidence import Evidence
from circuits.errors import DeadlineWarning


def ceiling(evidence: Evidence) -> float:
    """Return the expected accuracy of the most probable hypothesis after all readings of a trial.

    No integrator with the same likelihoods is more accurate, whatever its threshold.
    """
    last = evidence.posterior[np.arange(evidence.trials), evidence.readings]
    return float(last.max(axis=1).mean())


def warn_of_ceiling(evidence: Evidence, accuracies: Sequence[float]) -> list[float]:
    """Warn about accuracies that the readings do not allow, and return the others.

    Parameters
    ----------
    evidence : Evidence
        Readings of all trials.
    accuracies : sequence of float
        The requested accuracies.
    """
    top = ceiling(evidence)
    lost = [accuracy for accuracy in accuracies if accuracy - top > margin(accuracy)]
    if lost:
        DeadlineWarning.warn(
            f"no threshold reaches an accuracy of {listed(lost)}: all readings of a trial, "
            f"{evidence.steps} at most, allow {top:.3f}; give more readings (t_max) or ask for a "
            "lower accuracy"
        )
    return [accuracy for accuracy in accuracies if accuracy not in lost]


def warn_of_own_ceiling(name: str, found: Tradeoff, accuracies: Sequence[float]) -> None:
    """Warn about accuracies that the readings allow but a model does not reach.

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
        DeadlineWarning.warn(
            f"{name} reaches no accuracy of {listed(lost)}: at the best of its thresholds it has "
            f"{reached[best]:.3f}, and the deadline decides {found.forced[best].mean():.0%} of its "
            "trials there"
        )


def listed(values: Iterable[float]) -> str:
    """Return numbers as text."""
    return ", ".join(f"{value:.3g}" for value in values)
