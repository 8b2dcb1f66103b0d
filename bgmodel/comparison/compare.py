"""Algorithm against circuit, decision by decision, on the same evidence.

A ``Tradeoff`` holds the decisions of one integrator at many settings, as a rule thresholds. Two on
the same evidence are compared at equal accuracy: their settings are matched, then trial stands
against trial. Every interval is a bootstrap over trials (Efron 1979), drawn as weights of trials,
so that one expression gives the value and its resamples.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.arrays import Array, Integers
from bgmodel.calibration import posterior_at
from bgmodel.checks import reals, whole
from bgmodel.comparison.pairs import Choices, side_by_side
from bgmodel.decision import Trace, check_trace, first_crossing
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.facts import Facts, span
from bgmodel.seeds import generator

ACCURACIES = (0.90, 0.95, 0.97)
FEWEST_TRIALS = 100
RESAMPLES = 1000
FEWEST_DRAWN = {"resamples": 100, "groups": 10}
"""Resamples and groups below which an interval is warned of."""
# Accuracies over which the extra time is fitted by a line.
SPAN = np.linspace(0.85, 0.98, 14)
REST_MS = 500.0
"""The time at rest in which responses are counted."""
WITHOUT_EVIDENCE_SHARE = 0.5
"""A circuit of which more than this share of decisions come before the first reading, or in a
foreperiod, decides without evidence: its other measures say nothing of decisions."""
MOST_FORCED = 0.5
"""Share of trials that the deadline may decide where thresholds are compared."""
MINUS_INTACT = "circuit minus intact"
"""The model in rows that hold an edited circuit's measures minus the intact circuit's."""
OTHER_NOISE = "circuit with other noise"
"""The reference in rows that hold a circuit to itself with noise of another seed: the ceiling."""
MARGIN = 0.01
"""Accuracies are called equivalent if their difference lies within this, with 95 % confidence."""
SHARE_OF_ERRORS = 0.1
"""An accuracy is reached within this share of the errors that it leaves, and within ``MARGIN``."""


@dataclass(frozen=True, repr=False)
class Tradeoff(Facts):
    """Decisions of one integrator at K settings of what makes it hasty or careful.

    Parameters
    ----------
    settings : array (K,)
        Falling: thresholds in the units of its OUT, or levels of dopamine at one threshold.
    choice : int array (K, trials)
        What it chose, forced at the end of the trace.
    time_ms : array (K, trials)
        When, ms from the onset of evidence.
    forced, premature : bool arrays (K, trials)
        Whether the end of the trace made the choice; whether it came before the first reading.
    posterior : array (K, trials)
        Probability of what was chosen, given all readings that there were by then. Its mean is the
        expected accuracy, with a smaller error than counting; it is right if the likelihoods are.
    """

    settings: Array
    choice: npt.NDArray[np.integer]
    time_ms: Array
    forced: npt.NDArray[np.bool_]
    premature: npt.NDArray[np.bool_]
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
    def without_evidence(self) -> npt.NDArray[np.bool_]:
        """Whether most trials decide before their first reading, (K,)."""
        return np.asarray(self.premature.mean(axis=1) > WITHOUT_EVIDENCE_SHARE)

    def __add__(self, more: Tradeoff) -> Tradeoff:
        """Append trials; both must have the same settings."""
        if not np.array_equal(self.settings, more.settings):
            raise ValueError("tradeoffs can be joined only over the same settings")
        names = ("choice", "time_ms", "forced", "premature", "posterior")
        joined = {n: np.concatenate([getattr(self, n), getattr(more, n)], axis=1) for n in names}
        return replace(self, **joined)

    def at(self, chosen: npt.NDArray[np.bool_]) -> Tradeoff:
        """Return the decisions at some of the settings."""
        names = ("settings", "choice", "time_ms", "forced", "premature", "posterior")
        return Tradeoff(*(getattr(self, name)[chosen] for name in names))

    def choices(self, k: int) -> Choices:
        """Return choices and times at the k-th setting."""
        return Choices(self.choice[k], self.time_ms[k])

    def setting(self, accuracy: float) -> float:
        """Return the setting at which the expected accuracy is nearest."""
        reached, _ = curve(self, np.ones((1, self.trials)))
        return float(self.settings[np.abs(reached[0] - accuracy).argmin()])


def reads_nothing(premature: float, anticipatory: float, foreperiod_ms: float) -> bool:
    """Whether a circuit decides without evidence, by two shares of its responses.

    Parameters
    ----------
    premature, anticipatory : float
        Shares of trials decided before their first reading, and of foreperiods that end in a
        response.
    foreperiod_ms : float
        How long these waited, ms. At a constant hazard a share p becomes
        ``1 - (1 - p)^(500 / foreperiod_ms)`` in half a second: that is what counts, so that the
        length of the foreperiod does not.
    """
    within = 1 - (1 - anticipatory) ** (REST_MS / foreperiod_ms)
    return bool(max(premature, within) > WITHOUT_EVIDENCE_SHARE)


def levels(trace: Trace, count: int = 200) -> Array:
    """Return thresholds that cut a trace's decisions evenly: quantiles of its lowest OUT."""
    return np.unique(np.quantile(trace.out_nats.min(axis=2), np.linspace(0, 1, count)))[::-1]


def tradeoff(trace: Trace, evidence: Evidence, thresholds: npt.ArrayLike | None = None) -> Tradeoff:
    """Let an integrator decide at many thresholds.

    Parameters
    ----------
    trace : Trace
        OUT, as an integrator gives it for this evidence.
    evidence : Evidence
        What it was given.
    thresholds : array (K,), optional
        ``levels(trace)`` if left out.
    """
    check_trace(trace)
    if np.shape(trace.out_nats)[::2] != (check_evidence(evidence).trials, evidence.hypotheses):
        raise ValueError(
            f"the trace must be of this evidence, {evidence.trials} trials of "
            f"{evidence.hypotheses} hypotheses, got OUT of shape {np.shape(trace.out_nats)}"
        )
    if thresholds is not None and np.ndim(reals("thresholds", thresholds)) != 1:
        raise ValueError(f"thresholds must be (K,), got shape {np.shape(thresholds)}")
    chosen = levels(trace) if thresholds is None else np.sort(np.asarray(thresholds))[::-1]
    decided = first_crossing(trace, chosen, checked=False)
    posterior = posterior_at(evidence, decided.time_ms, decided.choice)
    return Tradeoff(
        chosen, decided.choice, decided.time_ms, decided.forced, decided.premature, posterior
    )


def curve(swept: Tradeoff, weights: Array) -> tuple[Array, Array]:
    """Return expected accuracy, made monotone, and mean time, (B, K) for weights (B, trials)."""
    # Importing scipy.optimize takes a third of a second: only where tradeoffs are compared.
    from scipy.optimize import isotonic_regression

    share = weights / weights.sum(axis=1, keepdims=True)
    accuracy = np.stack([isotonic_regression(row).x for row in share @ swept.posterior.T])
    # A rise too small to matter makes the curve invertible.
    return accuracy + np.linspace(0, 1e-9, accuracy.shape[1]), share @ swept.time_ms.T


def time_at(accuracies: Sequence[float] | Array, curves: tuple[Array, Array]) -> Array:
    """Return mean times at given expected accuracies, ms (B, A); NaN beyond the curve."""
    return np.stack(
        [np.interp(accuracies, *row, np.nan, np.nan) for row in zip(*curves, strict=True)]
    )


def latency(test: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return what the other takes longer than the test at equal accuracy, as a line.

    Parameters
    ----------
    test, other : pairs of arrays (B, K)
        As from ``curve``.

    Returns
    -------
    offset_ms, slope : arrays (B,)
        Of the extra time against the test's own time, over accuracies .85 to .98 as far as both
        reach; NaN where they share fewer than three.
    """
    x, late = time_at(SPAN, test), time_at(SPAN, other) - time_at(SPAN, test)
    known = np.isfinite(late)
    about = x - _row_means(np.where(known, x, np.nan))[:, None]
    spread = np.where(known, about**2, 0).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(known, about * late, 0).sum(axis=1) / spread
    slope[known.sum(axis=1) < 3] = np.nan
    return _row_means(late - slope[:, None] * x), slope


def compare(
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

    Parameters
    ----------
    test, other : Tradeoff
        The reference, and what is held to it.
    rng : numpy.random.Generator
        For the bootstrap.
    truth : int array (trials,), optional
        For the accuracy that is counted, the test's error trials, and chance: it is that of trials
        shuffled within each truth, or among all if left out.
    minus : Tradeoff, optional
        A third: every measure is then the other's minus this one's, with the interval of that.
    again : Tradeoff, optional
        The other with noise of another seed, for pearson_r_of_ceiling.
    latency_ms : float, optional
        What is not decision time and taken off before accuracies are compared in equal time: 0 for
        an abstract integrator; the mean extra time over accuracies .85 to .98 if left out.
    accuracies : sequence of float
        Where the test's threshold is put.
    resamples : int
        Of the bootstrap.
    groups : array (trials,), optional
        As for ``resampled``.

    Returns
    -------
    DataFrame
        One row an accuracy and measure: accuracy, measure, value, low, high (95 % interval).
        Measures: threshold; accuracy, test_accuracy (counted); agreement, error_agreement (on
        trials that the test gets wrong) and within_50_ms (share of times within 50 ms of the
        median lag), each also as NAME_chance, for trials shuffled within a truth, and
        NAME_corrected, (share - chance) / (1 - chance); pearson_r (of decision times) and
        pearson_r_chance, spearman_r; residual_sd_ms (of the lag); test_ms, extra_ms; accuracy_gap
        (in equal time); forced; with ``again`` pearson_r_of_ceiling, r over the square root of the
        other's r with itself (Spearman 1904: what r would be without the other's noise). All are
        NaN where one does not reach the accuracy within ``margin``, or where the deadline decides
        most trials of one; what goes trial by trial has its interval for the thresholds as matched.
        With accuracy NaN: offset_ms and slope of ``latency``.

    Raises
    ------
    ValueError
        If the tradeoffs do not hold the same trials, or are too few for an interval.
    """
    for one in (other, minus or other, again or other):
        if one.trials != test.trials:
            raise ValueError(
                f"the same trials must be compared, got {test.trials} and {one.trials}"
            )
    n = test.trials
    check_trials(n)
    weights = resampled(n, resamples, rng, groups)
    found = _measures(test, other, truth, accuracies, weights, latency_ms, again)
    if minus is not None:
        base = _measures(test, minus, truth, accuracies, weights, latency_ms)
        found = {key: found[key] - base[key] for key in base}
    rows = []
    for (accuracy, name), values in found.items():
        value, low, high = interval(values)
        # A line through few points is none: without an interval it says nothing.
        line = np.isnan(accuracy) and not np.isfinite(low)
        rows.append((accuracy, name, np.nan if line else value, low, high))
    return pd.DataFrame(rows, columns=["accuracy", "measure", "value", "low", "high"])


def margin(accuracy: float) -> float:
    """Return the margin within which an accuracy counts as reached: smaller towards 1."""
    return min(MARGIN, SHARE_OF_ERRORS * (1 - accuracy))


def resampled(
    trials: int,
    resamples: int,
    rng: np.random.Generator | int,
    groups: npt.ArrayLike | None = None,
) -> Array:
    """Return weights (1 + resamples, trials): each trial once, then how often each is drawn.

    Parameters
    ----------
    trials, resamples : int
        Their numbers.
    rng : numpy.random.Generator or int
        Of the draws, or a seed.
    groups : array (trials,), optional
        A number or name per trial: whole groups are drawn (Efron & Tibshirani 1993), as where
        trials share taps. Of G groups the interval is too narrow by about sqrt(1 - 1 / G), and of
        few it is rough.

    Raises
    ------
    ValueError
        If groups are not one per trial, or fewer than two.
    """
    resamples, rng = whole("resamples", resamples, 1), generator(rng)
    of = np.arange(trials) if groups is None else _numbered(groups, trials)
    count = int(of.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples)
    return np.concatenate([np.ones((1, trials)), drawn[:, of]])


def check_resamples(resamples: int, groups: npt.ArrayLike | None) -> None:
    """Refuse a number of resamples that is none; warn of intervals that are too rough to tell.

    Parameters
    ----------
    resamples, groups :
        As for ``resampled``.
    """
    drawn = {"resamples": whole("resamples", resamples, 1)}
    if groups is not None:
        drawn["groups"] = len(np.unique(np.asarray(groups)))
    for name, count in drawn.items():
        if count < FEWEST_DRAWN[name]:
            warnings.warn(
                f"95 % intervals from {count} {name} are too rough to tell: give "
                f"{FEWEST_DRAWN[name]} or more",
                stacklevel=4,
            )


def _numbered(groups: npt.ArrayLike, trials: int) -> npt.NDArray[np.intp]:
    """Return the group of each trial as a number, 0, 1, ..."""
    given = np.asarray(groups)
    if given.shape != (trials,):
        raise ValueError(f"groups must be one per trial, ({trials},), got shape {given.shape}")
    kinds, of = np.unique(given, return_inverse=True)
    if len(kinds) < 2:
        raise ValueError(f"groups must be two or more for an interval, got {len(kinds)}")
    return of


def interval(values: Array) -> tuple[float, float, float]:
    """Return the value, the first entry, and the 95 % interval of its resamples, the others."""
    ends = np.nanquantile(values[1:], [0.025, 0.975]) if _known(values) else (np.nan, np.nan)
    return float(values[0]), float(ends[0]), float(ends[1])


def shown(value: float, low: float, high: float, form: str) -> str:
    """Return a value and its interval as text; what is not known is said to be so."""
    if not np.isfinite(value):
        return "unknown"
    inside = f"{low:{form}}, {high:{form}}" if np.isfinite(low) and np.isfinite(high) else "unknown"
    return f"{value:{form}} [{inside}]"


def check_trials(trials: int) -> None:
    """Raise ValueError if these are too few for an interval."""
    if trials < FEWEST_TRIALS:
        raise ValueError(f"an interval needs {FEWEST_TRIALS} trials or more, got {trials}")


def checked_accuracies(accuracies: Sequence[float] | float, hypotheses: int) -> tuple[float, ...]:
    """Return the accuracies that are asked for, one or several, as a tuple.

    Raises
    ------
    ValueError
        If the list is empty, or an accuracy is not a number between chance plus ``MARGIN`` and 1.
    """
    given = np.atleast_1d(np.asarray(reals("accuracies", accuracies), dtype=np.float64))
    if given.ndim != 1 or not given.size:
        raise ValueError(f"accuracies must hold one number or more, got {given.tolist()}")
    least = 1 / hypotheses + MARGIN
    for value in given.tolist():
        if not least < value < 1:
            raise ValueError(
                f"accuracies must lie above chance, {1 / hypotheses:.3g}, and below 1, got "
                f"{value:g}"
            )
    return tuple(given.tolist())


def equivalent(table: pd.DataFrame, margin: float = MARGIN) -> pd.Series:
    """Return, for each accuracy, whether the gap's 95 % interval lies within +-margin.

    Two one-sided tests at 2.5 % (Schuirmann 1987): a gap that is merely not significant does not
    pass.
    """
    gaps = table[table["measure"] == "accuracy_gap"].set_index("accuracy")
    return (gaps["low"] > -margin) & (gaps["high"] < margin)


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
    """Return every measure, (B,) each; the first entry is the value itself."""
    curves = curve(test, weights), curve(other, weights)
    offset, slope = latency(*curves)
    found = {(np.nan, "offset_ms"): offset, (np.nan, "slope"): slope}
    late = np.full_like(offset, latency_ms)
    if latency_ms is None:
        late = _row_means(time_at(SPAN, curves[1]) - time_at(SPAN, curves[0]))
    sides = [test, other, *([] if again is None else [again])]
    reached = [curve(one, weights[:1])[0][0] for one in sides]
    for accuracy in accuracies:
        at = _matched(reached, accuracy)
        j = at[1]
        chosen = [one.choices(k) for one, k in zip(sides, at, strict=True)]
        third = chosen[2] if again is not None else None
        values = side_by_side(chosen[0], chosen[1], truth, weights, again=third)
        values["forced"] = weights @ other.forced[j] / weights.sum(axis=1)
        values["extra_ms"] = (time_at([accuracy], curves[1]) - time_at([accuracy], curves[0]))[:, 0]
        values["accuracy_gap"] = _gap(*curves, accuracy, late)
        values["threshold"] = np.full(len(weights), other.settings[j])
        missed = max(abs(curve[k] - accuracy) for curve, k in zip(reached, at, strict=True))
        # What the deadline decides crosses no threshold.
        at_end = max(one.forced[k].mean() for one, k in zip(sides, at, strict=True))
        if missed > margin(accuracy) or at_end > MOST_FORCED:
            values = {name: np.full_like(value, np.nan) for name, value in values.items()}
        found |= {(accuracy, name): value for name, value in values.items()}
    return found


def _matched(reached: Sequence[Array], accuracy: float) -> list[int]:
    """Return the setting of each nearest to an accuracy: of the first, then of others to it."""
    first = int(np.abs(reached[0] - accuracy).argmin())
    others = [int(np.abs(one - reached[0][first]).argmin()) for one in reached[1:]]
    return [first, *others]


def _gap(
    test: tuple[Array, Array], other: tuple[Array, Array], accuracy: float, late: Array
) -> Array:
    """Return accuracy of the other minus the test's in equal time, the latency taken off, (B,)."""
    at_ms = time_at([accuracy], test)[:, 0] + late
    reached = [
        np.interp(at, time, known, np.nan, np.nan)
        for at, known, time in zip(at_ms, *other, strict=True)
    ]
    return np.array(reached) - accuracy


def _row_means(values: Array) -> Array:
    """Return the mean of what is known in each row, NaN where nothing is."""
    known = np.isfinite(values)
    counts = known.sum(axis=1)
    sums = np.where(known, values, 0).sum(axis=1)
    means = np.full(len(values), np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means


def _known(values: Array) -> bool:
    """Whether a value and nearly all of its resamples are there."""
    return bool(np.isfinite(values[0]) and np.isfinite(values[1:]).mean() > 0.95)
