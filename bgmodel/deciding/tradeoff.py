"""Speed-accuracy tradeoff: decisions at many settings, from hasty to careful."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import posterior_at
from bgmodel.deciding.decision import first_crossing
from bgmodel.deciding.trace import Trace, check_trace, ready
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.support.checks import reals
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers, Truths
from circuits.errors import InputError

OF_TRIALS = ("choice", "time_ms", "forced", "premature", "posterior")
"""Fields of a ``Tradeoff`` with a value for each setting and trial."""
REST_MS = 500.0
"""Time at rest over which responses are counted, ms."""


WITHOUT_EVIDENCE_SHARE = 0.5
"""If more than this share of a circuit's decisions comes before the first reading or in a
foreperiod, it decides without evidence, and its other measures are not informative."""


MARGIN = 0.01
"""Accuracies are equivalent if their difference is within this margin with 95 % confidence."""


SHARE_OF_ERRORS = 0.1
"""An accuracy counts as reached within this fraction of its error rate, and within ``MARGIN``."""


PLACED = np.concatenate(
    [np.arange(0.005, 0.95, 0.005), np.arange(0.95, 0.98, 0.0025), np.arange(0.98, 1, 0.001)]
)
"""Expected accuracies at which thresholds are placed, whatever the number of readings."""
SPREAD = 33
"""Number of further thresholds, which divide all changes of decisions evenly."""
GOLDEN = (np.sqrt(5) - 1) / 2
"""Multiples of this ratio are spread evenly over 0..1, modulo 1, in any stretch of trials."""


@dataclass(frozen=True)
class ChoicesAndTimes:
    """Decisions of one integrator at one setting: choice (trials,) and time_ms (trials,)."""

    choice: Integers
    time_ms: Array


@dataclass(frozen=True, repr=False)
class Tradeoff(Facts):
    """Decisions of one integrator at K settings, from careless to careful or the reverse."""

    settings: Array  # (K,), falling: thresholds in the unit of OUT, or levels of dopamine
    choice: Integers  # (K, trials)
    time_ms: Array  # (K, trials), from the onset of evidence
    forced: Truths  # (K, trials), at the end of the trace
    premature: Truths  # (K, trials), before the first reading
    # (K, trials), of the choice, by all readings up to it. Its mean is the expected accuracy,
    # with a smaller standard error than the proportion correct; it requires correct likelihoods.
    posterior: Array

    def facts(self) -> dict[str, str]:
        """Return trials, settings, and how fast and accurate they are."""
        return {
            "trials": f"{self.trials}",
            "settings": f"{len(self.settings)} of {span(self.settings)}",
            "mean_time_ms": span(self.time_ms.mean(axis=1)),
            "expected_accuracy": span(self.posterior.mean(axis=1)),
        }

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.choice.shape[1])

    @property
    def without_evidence(self) -> Truths:
        """Whether most trials decide before their first reading, (K,)."""
        return np.asarray(self.premature.mean(axis=1) > WITHOUT_EVIDENCE_SHARE)

    def __add__(self, more: Tradeoff) -> Tradeoff:
        """Append trials; both must have the same settings."""
        if not np.array_equal(self.settings, more.settings):
            raise InputError("tradeoffs can be joined only over the same settings", "thresholds")
        of_both = ((name, getattr(self, name), getattr(more, name)) for name in OF_TRIALS)
        return replace(self, **{name: np.concatenate(both, axis=1) for name, *both in of_both})

    def __or__(self, more: Tradeoff) -> Tradeoff:
        """Add settings; both must have the same trials."""
        order = np.argsort(-np.concatenate([self.settings, more.settings]), kind="stable")
        both = ((getattr(self, name), getattr(more, name)) for name in ("settings", *OF_TRIALS))
        return Tradeoff(*(np.concatenate(each)[order] for each in both))

    def at(self, chosen: Truths) -> Tradeoff:
        """Return the decisions at a subset of the settings."""
        return Tradeoff(*(getattr(self, name)[chosen] for name in ("settings", *OF_TRIALS)))

    def choices(self, k: int) -> ChoicesAndTimes:
        """Return choices and times at the k-th setting."""
        return ChoicesAndTimes(self.choice[k], self.time_ms[k])

    @cached_property
    def reached(self) -> Array:
        """Expected accuracy at each setting, made monotone, (K,)."""
        return np.asarray(curve(self, np.ones((1, self.trials)))[0][0])

    def setting(self, accuracy: float) -> float:
        """Return the setting whose expected accuracy is nearest to ``accuracy``."""
        return float(self.settings[np.abs(self.reached - accuracy).argmin()])

    def reaches(self, accuracy: float) -> bool:
        """Whether an accuracy is within the range of its settings, and ``margin`` beyond."""
        low, high = self.reached[[0, -1]]
        return bool(low - margin(accuracy) <= accuracy <= high + margin(accuracy))

    def at_accuracy(self, accuracy: float) -> Tradeoff:
        """Return the decisions at an expected accuracy, or at the nearest end of the range reached.

        Between two settings, trials are divided among these such that their expected accuracy is
        the one asked for: a randomised test, which reaches any accuracy even if readings have few
        values (Lehmann & Romano 2005, section 3.2). Integrators share the division of trials, and
        ``settings`` (1,) holds the interpolated setting.
        """
        place = np.interp(accuracy, self.reached, np.arange(len(self.settings)))
        k, share = int(place), place % 1
        trial = np.arange(self.trials)
        row = k + ((1 + trial) * GOLDEN % 1 < share)
        setting = np.interp([place], np.arange(len(self.settings)), self.settings)
        return Tradeoff(setting, *(getattr(self, name)[row, trial][None] for name in OF_TRIALS))


def decides_without_evidence(premature: float, anticipatory: float, foreperiod_ms: float) -> bool:
    """Whether a circuit decides without evidence, judged by two shares of its responses.

    ``premature`` is that of trials decided before their first reading, ``anticipatory`` that of
    foreperiods that end in a response. At a constant hazard a share p corresponds to
    ``1 - (1 - p)^(500 / foreperiod_ms)`` in half a second; this value is compared, so that the
    result does not depend on the duration.
    """
    within = 1 - (1 - anticipatory) ** (REST_MS / foreperiod_ms)
    return bool(max(premature, within) > WITHOUT_EVIDENCE_SHARE)


def levels(trace: Trace, evidence: Evidence, accuracies: Sequence[float] = ()) -> Array:
    """Return thresholds placed by expected accuracy: at ``PLACED``, and about those asked for.

    Expected accuracy is a step function of the threshold, with a step wherever the lowest OUT of a
    trial falls below all before. It is computed exactly and inverted, so that the accuracies which
    have a threshold do not depend on the number of readings, unless the deadline decides.
    """
    at, accuracy = _steps(trace, evidence)
    rising = np.maximum.accumulate(accuracy)
    exact = np.searchsorted(rising, accuracies)
    spread = np.linspace(0, len(at) - 1, SPREAD).astype(np.intp)
    chosen = np.concatenate([np.searchsorted(rising, PLACED), exact, exact - 1, spread])
    return np.asarray(at[np.unique(chosen[(chosen >= 0) & (chosen < len(at))])])


def _steps(trace: Trace, evidence: Evidence) -> tuple[Array, Array]:
    """Return all thresholds at which decisions change, falling, and their expected accuracies."""
    # Importing Numba takes most of a second: only when decisions are made.
    from bgmodel.deciding.kernel import ROUNDING

    out, first, ends, _ = ready(trace)
    trials, ticks = out.shape[:2]
    low = np.where(np.arange(ticks) < ends[:, None], out.min(axis=2), np.inf)
    since_ms = np.broadcast_to((trace.time_ms - trace.onset_ms)[:, None], (ticks, trials))
    posterior = posterior_at(evidence, since_ms, out.argmin(axis=2).T).T
    at_end = posterior[np.arange(trials), ends - 1]
    before = np.minimum.accumulate(np.insert(low, 0, np.inf, axis=1)[:, :-1], axis=1)
    falls = low < before - ROUNDING
    falls[:, :first] = False
    trial, tick = np.nonzero(falls)
    if not len(trial):
        return np.array([low.min()]), np.array([at_end.mean()])
    reached = posterior[trial, tick]
    new = np.append(True, np.diff(trial) > 0)
    later = np.where(np.append(new[1:], True), at_end[trial], np.append(reached[1:], 0.0))
    hasty = at_end.copy()
    hasty[trial[new]] = reached[new]
    order = np.argsort(-low[trial, tick], kind="stable")
    at = low[trial, tick][order]
    risen = np.cumsum((later - reached)[order])
    accuracy = hasty.mean() + np.append(0.0, risen[:-1]) / trials
    # Sums of readings that differ by rounding alone are one threshold.
    apart = np.append(True, np.diff(at) < -ROUNDING)
    return at[apart], accuracy[apart]


def tradeoff(
    trace: Trace,
    evidence: Evidence,
    thresholds: npt.ArrayLike | None = None,
    accuracies: Sequence[float] = (),
) -> Tradeoff:
    """Return an integrator's decisions at many thresholds, (K,), placed by accuracy if omitted.

    Placed thresholds reach ``accuracies`` to within a single decision, see ``levels``.
    """
    check_trace(trace)
    if np.shape(trace.out_nats)[::2] != (check_evidence(evidence).trials, evidence.hypotheses):
        raise InputError(
            f"the trace must be of this evidence, {evidence.trials} trials of "
            f"{evidence.hypotheses} hypotheses, got OUT of shape {np.shape(trace.out_nats)}",
            "trace",
        )
    if thresholds is not None and np.ndim(reals("thresholds", thresholds)) != 1:
        raise InputError.of("thresholds", "must be (K,)", np.shape(thresholds))
    if thresholds is None:
        chosen = levels(trace, evidence, accuracies)
    else:
        chosen = np.sort(np.asarray(thresholds))[::-1]
    decided = first_crossing(trace, chosen, checked=False)
    posterior = posterior_at(evidence, decided.time_ms, decided.choice)
    return Tradeoff(
        chosen, decided.choice, decided.time_ms, decided.forced, decided.premature, posterior
    )


def curve(swept: Tradeoff, weights: Array) -> tuple[Array, Array]:
    """Return expected accuracy, made monotone, and mean time, (B, K) for weights (B, trials)."""
    # Importing scipy.optimize takes a third of a second: only when tradeoffs are compared.
    from scipy.optimize import isotonic_regression

    share = weights / weights.sum(axis=1, keepdims=True)
    accuracy = np.stack([isotonic_regression(row).x for row in share @ swept.posterior.T])
    # A negligible slope makes the curve invertible.
    return accuracy + np.linspace(0, 1e-9, accuracy.shape[1]), share @ swept.time_ms.T


def time_at(accuracies: Sequence[float] | Array, curves: tuple[Array, Array]) -> Array:
    """Return mean times at given expected accuracies, ms (B, A); NaN outside the curve."""
    return np.stack(
        [np.interp(accuracies, *row, np.nan, np.nan) for row in zip(*curves, strict=True)]
    )


def margin(accuracy: float) -> float:
    """Return the margin within which an accuracy counts as reached; it shrinks towards 1."""
    return min(MARGIN, SHARE_OF_ERRORS * (1 - accuracy))
