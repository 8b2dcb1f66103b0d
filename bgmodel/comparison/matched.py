"""Algorithm and circuit compared trial by trial on the same evidence.

A ``Tradeoff`` holds the decisions of one integrator at many settings, usually thresholds. Two on
the same evidence are compared at equal accuracy (``Tradeoff.at_accuracy``), and their decisions are
paired by trial. Every interval is a bootstrap over trials (Efron 1979), drawn as weights of
trials, so that one expression gives the value and its resamples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_trials, interval, resampled
from bgmodel.comparison.pairs import side_by_side
from bgmodel.deciding.tradeoff import MARGIN, Tradeoff, curve, margin, time_at
from bgmodel.evidence import Evidence
from bgmodel.support.checks import reals
from circuits.arrays import Array, Integers
from circuits.errors import DeadlineWarning, InputError, RangeWarning, require

ACCURACIES = (0.90, 0.95, 0.97)
# Accuracies over which the extra time is averaged, as latency.
SPAN = np.linspace(0.85, 0.98, 14)
MOST_FORCED = 0.5
"""Largest share of trials decided by the deadline at which thresholds are compared."""
MINUS_INTACT = "circuit minus intact"
"""Model name in rows of the edited circuit's measures minus those of the intact circuit."""
OTHER_NOISE = "circuit with other noise"
"""Reference in rows that compare a circuit with itself under other noise: the noise ceiling."""


def matched_measures(
    test: Tradeoff,
    other: Tradeoff,
    *,
    rng: np.random.Generator,
    truth: Integers | None = None,
    minus: Tradeoff | None = None,
    again: Tradeoff | None = None,
    latency_ms: float | None = None,
    accuracies: Sequence[float] = ACCURACIES,
    resamples: int = RESAMPLES,
    groups: npt.ArrayLike | None = None,
) -> pd.DataFrame:
    """Compare two integrators on the same evidence at equal expected accuracy.

    ``other`` is compared with ``test``, whose threshold is set at each of the accuracies. ``truth``
    gives the observed accuracies, the test's error trials, and chance agreement, for which trials
    are shuffled within each truth; without it, all trials are shuffled together. ``minus`` is a
    third integrator: measures are then those of ``other`` minus those of ``minus``, with intervals
    of the difference. ``again`` is ``other`` with noise of another seed, for r_noise_corrected.
    ``latency_ms`` is the non-decision time to subtract before accuracies are
    compared in equal time: 0 for an abstract integrator; by default the mean extra time over
    accuracies 0.85 to 0.98. ``resamples`` and ``groups`` are as for ``resampled``.

    One row per accuracy and measure: accuracy, measure, value, low, high (95 % interval). Measures:
    threshold; accuracy, test_accuracy (observed); agreement, agreement_chance (for trials shuffled
    within a truth) and agreement_corrected, (agreement - chance) / (1 - chance); error_agreement
    (on trials that the test gets wrong); within_50_ms (share of times within 50 ms of the median
    lag); pearson_r (of decision times); test_ms, extra_ms; accuracy_gap (in equal time); forced;
    with ``again`` r_noise_corrected, r over the square root of the other's r with itself (Spearman
    1904: an estimate of r without the other's noise). All are NaN if one does not reach the
    accuracy within ``margin``, or if the deadline decides most trials of one; intervals of
    trial-by-trial measures are for the matched thresholds.

    ValueError if the tradeoffs do not hold the same trials, or are too few for an interval.
    """
    for one in (other, minus or other, again or other):
        same = f"must have the {test.trials} trials of the test"
        require(one.trials == test.trials, "other", same, one.trials)
    n = test.trials
    check_trials(n)
    weights = resampled(n, resamples, rng, groups)
    measures = _measures(test, other, truth, accuracies, weights, latency_ms, again)
    if minus is not None:
        base = _measures(test, minus, truth, accuracies, weights, latency_ms)
        measures = {key: measures[key] - base[key] for key in base}
    rows = [(*key, *interval(values)) for key, values in measures.items()]
    return pd.DataFrame(rows, columns=["accuracy", "measure", "value", "low", "high"])


def checked_accuracies(accuracies: Sequence[float] | float, hypotheses: int) -> tuple[float, ...]:
    """Return the requested accuracies, one or several, as a tuple."""
    values = np.atleast_1d(np.asarray(reals("accuracies", accuracies), dtype=np.float64))
    require(values.ndim == 1 and values.size, "accuracies", "must hold one number or more", values)
    least = 1 / hypotheses + MARGIN
    for value in values.tolist():
        if not least < value < 1:
            raise InputError.of(
                "accuracies", f"must lie above chance, {1 / hypotheses:.3g}, and below 1", value
            )
    once = len(np.unique(values)) == len(values)
    require(once, "accuracies", "must differ from each other", values)
    return tuple(values.tolist())


def equivalent(table: pd.DataFrame, margin: float = MARGIN) -> pd.Series:
    """Return, for each accuracy, whether the gap's 95 % interval lies within +-margin.

    Two one-sided tests at 2.5 % (Schuirmann 1987): a gap that is merely not significant is not
    equivalent.
    """
    gaps = table[table["measure"] == "accuracy_gap"].set_index("accuracy")
    return (gaps["low"] > -margin) & (gaps["high"] < margin)


PAIRED = ["accuracy", "trial", "test_choice", "test_ms", "circuit_choice", "circuit_ms"]
"""Columns of ``paired``."""
Measures = dict[tuple[float, str], Array]


def _measures(
    test: Tradeoff,
    other: Tradeoff,
    truth: Integers | None,
    accuracies: Sequence[float],
    weights: Array,
    latency_ms: float | None,
    again: Tradeoff | None = None,
) -> Measures:
    """Return every measure, (B,) each; the first entry is the value."""
    curves = curve(test, weights), curve(other, weights)
    late = np.full(len(weights), latency_ms)
    if latency_ms is None:
        late = row_means(time_at(SPAN, curves[1]) - time_at(SPAN, curves[0]))
    measures: Measures = {}
    sides = [test, other, *([] if again is None else [again])]
    for accuracy in accuracies:
        matched = at_equal_accuracy(sides, accuracy)
        chosen = [one.choices(0) for one in matched]
        third = chosen[2] if again is not None else None
        values = side_by_side(chosen[0], chosen[1], truth, weights, again=third)
        values["forced"] = weights @ matched[1].forced[0] / weights.sum(axis=1)
        values["extra_ms"] = (time_at([accuracy], curves[1]) - time_at([accuracy], curves[0]))[:, 0]
        values["accuracy_gap"] = _gap(*curves, accuracy, late)
        values["threshold"] = np.full(len(weights), matched[1].settings[0])
        # Trials decided by the deadline do not cross a threshold.
        at_end = max(one.forced.mean() for one in matched)
        if not all(one.reaches(accuracy) for one in sides) or at_end > MOST_FORCED:
            values = {name: np.full_like(value, np.nan) for name, value in values.items()}
        measures |= {(accuracy, name): value for name, value in values.items()}
    return measures


def paired(test: Tradeoff, other: Tradeoff, accuracies: Sequence[float]) -> pd.DataFrame:
    """Return choices and times of both, trial by trial, at the thresholds of each accuracy."""
    parts = []
    for accuracy in accuracies:
        first, second = at_equal_accuracy((test, other), accuracy)
        columns = {
            "accuracy": accuracy,
            "trial": np.arange(test.trials),
            "test_choice": first.choice[0],
            "test_ms": first.time_ms[0],
            "circuit_choice": second.choice[0],
            "circuit_ms": second.time_ms[0],
        }
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=PAIRED)


def at_equal_accuracy(sides: Sequence[Tradeoff], accuracy: float) -> list[Tradeoff]:
    """Return the decisions of each at an accuracy, or at the nearest that the first reaches."""
    reached = sides[0].reached
    nearest = float(np.clip(accuracy, reached[0], reached[-1]))
    return [one.at_accuracy(nearest) for one in sides]


def _gap(
    test: tuple[Array, Array], other: tuple[Array, Array], accuracy: float, late: Array
) -> Array:
    """Return accuracy of the other minus the test's in equal time, corrected for latency, (B,)."""
    at_ms = time_at([accuracy], test)[:, 0] + late
    reached = [
        np.interp(at, time, known, np.nan, np.nan)
        for at, known, time in zip(at_ms, *other, strict=True)
    ]
    return np.array(reached) - accuracy


def row_means(values: Array) -> Array:
    """Return the mean of each row ignoring NaN; NaN if all are."""
    known = np.isfinite(values)
    counts = known.sum(axis=1)
    sums = np.where(known, values, 0).sum(axis=1)
    means = np.full(len(values), np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means


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
