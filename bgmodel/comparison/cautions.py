"""Warnings about missing or wrong numbers in a comparison."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from bgmodel.comparison.matched import MOST_FORCED
from bgmodel.deciding.tradeoff import Tradeoff, margin
from bgmodel.evidence import Evidence
from circuits.errors import DeadlineWarning, RangeWarning


def accuracy_after(evidence: Evidence, readings: int | None = None) -> float:
    """Return the expected accuracy of the most probable hypothesis after some readings, or all.

    No integrator with the same likelihoods is more accurate after them, whatever its threshold.
    """
    count = evidence.readings if readings is None else np.minimum(readings, evidence.readings)
    return float(evidence.posterior[np.arange(evidence.trials), count].max(axis=1).mean())


def warn_of_readings(evidence: Evidence, accuracies: Sequence[float]) -> list[float]:
    """Warn about accuracies that one reading exceeds or all do not allow, and return the others."""
    one, top = accuracy_after(evidence, 1), accuracy_after(evidence)
    hasty = [accuracy for accuracy in accuracies if one - accuracy > margin(accuracy)]
    lost = [accuracy for accuracy in accuracies if accuracy - top > margin(accuracy)]
    if hasty:
        RangeWarning.warn(
            f"the test has no accuracy of {listed(hasty)}: one reading alone gives {one:.3f}, and "
            "no decision takes fewer; ask for a higher accuracy, or give weaker evidence"
        )
    if lost:
        DeadlineWarning.warn(
            f"no threshold reaches an accuracy of {listed(lost)}: all readings of a trial, "
            f"{evidence.steps} at most, allow {top:.3f}; give more readings (t_max) or ask for a "
            "lower accuracy"
        )
    return [accuracy for accuracy in accuracies if accuracy not in hasty + lost]


def warn_of_missed(name: str, swept: Tradeoff, accuracies: Sequence[float]) -> list[float]:
    """Warn about accuracies at which a model cannot be compared, and return the others."""
    low, high = swept.reached[[0, -1]]
    within = [accuracy for accuracy in accuracies if swept.reaches(accuracy)]
    late = {a: share for a in within if (share := swept.at_accuracy(a).forced.mean()) > MOST_FORCED}
    if lost := [accuracy for accuracy in accuracies if accuracy > high and accuracy not in within]:
        DeadlineWarning.warn(
            f"{name} reaches no accuracy of {listed(lost)}: at the best of its thresholds it has "
            f"{high:.3f}, and the deadline decides {swept.forced[-1].mean():.0%} of its trials "
            "there"
        )
    if hasty := [accuracy for accuracy in accuracies if accuracy < low and accuracy not in within]:
        RangeWarning.warn(
            f"{name} has no accuracy of {listed(hasty)}: at the hastiest of its thresholds it has "
            f"{low:.3f}; ask for a higher accuracy"
        )
    if late:
        DeadlineWarning.warn(
            f"{name} is not compared at an accuracy of {listed(late)}: the deadline decides "
            f"{max(late.values()):.0%} of its trials there; give more readings (t_max)"
        )
    return [accuracy for accuracy in within if accuracy not in late]


def listed(values: Iterable[float]) -> str:
    """Return numbers as text."""
    return ", ".join(f"{value:.3g}" for value in values)
