"""The stopping rule: the only place where an output trace becomes a decision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.readout import check_one_given, meant
from bgmodel.deciding.trace import Trace, check_ended, of_test, ready, sorted_levels
from bgmodel.support.checks import (
    check_flag,
    known_truth,
    one_per_trial,
    reals,
)
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers, Reals, Truths
from circuits.errors import DeadlineWarning, InputError, NoiseWarning

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNDECIDED = -1
MOST = 0.5
"""Warn if more than this share of trials is decided by the deadline, or before any reading."""


@dataclass(frozen=True, repr=False)
class Decision(Facts):
    """Decisions, one per trial (and one row per threshold if there are several).

    Parameters
    ----------
    choice : int array (..., trials)
        Index of the chosen hypothesis, or -1 (``UNDECIDED``).
    time_ms : float array (..., trials), ms
        Time of the decision from the *onset of evidence*; NaN where undecided.
    forced : bool array (..., trials)
        True where the deadline, not the threshold, made the choice.
    premature : bool array (..., trials)
        True where the response came before the first reading, without any evidence.
    step_ms : float
        Time between readings, ms.
    deadline_ms : array (trials,)
        End of each trial, from onset, ms.
    truth : int array (trials,), optional
        The true hypothesis of each trial, if known.
    gain : float, optional
        Nats in the circuit per nat of evidence, as run; None for a test.
    """

    choice: Integers
    time_ms: Array
    forced: Truths
    premature: Truths
    step_ms: float
    deadline_ms: Array
    truth: Integers | None = None
    gain: float | None = None

    def facts(self) -> dict[str, str]:
        """Return the numbers of decided and forced trials, and the mean time."""
        *thresholds, trials = self.choice.shape
        shape = {"thresholds": f"{thresholds[0]}"} if thresholds else {}
        decided = self.choice != UNDECIDED
        return {
            **shape,
            "trials": f"{trials}",
            **({} if self.truth is None else {"accuracy": span(self.accuracy)}),
            "mean_time_ms": span(self._mean_ms),
            "forced": span(self.forced.sum(axis=-1), ".0f"),
            "undecided": span((~decided).sum(axis=-1), ".0f"),
            "premature": span(self.premature.sum(axis=-1), ".0f"),
            **({} if self.gain is None else {"gain": f"{self.gain:g}"}),
        }

    @property
    def _mean_ms(self) -> Any:
        """Mean time of decided trials, ms, one per threshold; NaN without decided trials."""
        decided = self.choice != UNDECIDED
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(decided, self.time_ms, 0.0).sum(axis=-1) / decided.sum(axis=-1)

    @property
    def accuracy(self) -> Any:
        """Proportion correct of decided trials, one per threshold; NaN without decided trials.

        Raises
        ------
        ValueError
            If the truth is not known.
        """
        right = self._right().sum(axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return right / (self.choice != UNDECIDED).sum(axis=-1)

    def _right(self) -> Truths:
        return np.asarray(self.choice == known_truth(self.truth))

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per trial (and threshold, numbered from 0).

        Columns trial, choice (-1 where undecided), time_ms, forced and premature; where the truth
        is known also truth and correct (missing where undecided).
        """
        import pandas as pd

        names = ("choice", "time_ms", "forced", "premature")
        columns = {name: np.asarray(getattr(self, name)) for name in names}
        if self.truth is not None:
            columns["truth"] = np.broadcast_to(self.truth, self.choice.shape)
            columns["correct"] = self._right()
        axes = ("threshold", "trial")[-self.choice.ndim :]
        places = dict(zip(axes, np.indices(self.choice.shape), strict=True))
        every = {name: each.ravel() for name, each in {**places, **columns}.items()}
        table = pd.DataFrame(every)
        if "correct" in table:
            decided = table["choice"] != UNDECIDED
            table["correct"] = table["correct"].astype("boolean").where(decided)
        return table

    def summary(self) -> pd.DataFrame:
        """Return accuracy, mean time and numbers of trials, one row per threshold."""
        from bgmodel.support.tables import Readable

        decided = np.atleast_2d(self.choice != UNDECIDED)
        accuracy = np.nan if self.truth is None else np.atleast_1d(self.accuracy)
        columns = {
            "trials": decided.shape[1],
            "accuracy": accuracy,
            "mean_ms": np.atleast_1d(self._mean_ms),
            "undecided": (~decided).sum(axis=1),
            "forced": np.atleast_2d(self.forced).sum(axis=1),
            "premature": np.atleast_2d(self.premature).sum(axis=1),
        }
        return Readable(columns)

    def plot(self, ax: Axes | None = None, truth: Integers | None = None) -> Figure:
        """Draw the distribution of decision times; of several thresholds, accuracy against time.

        At one threshold, errors are drawn below correct responses, and trials that the deadline
        decided are hatched; without a truth there is one histogram per choice. The title has
        accuracy with Wilson's 95 % interval and the numbers of trials. Of several thresholds,
        each point is the accuracy of decided trials with that interval.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on; by default those of a new figure.
        truth : int array (trials,), optional
            The true hypotheses, by default those of the decisions.

        Returns
        -------
        Figure
            One panel.

        Raises
        ------
        ValueError
            If there are several thresholds and no truth.
        """
        from bgmodel.plots import choice_times, tradeoff

        truth = self.truth if truth is None else truth
        if truth is not None:
            truth = one_per_trial("truth", truth, self.choice.shape[-1])
        if self.choice.ndim == 1:
            return choice_times(self.choice, self.time_ms, self.forced, truth, ax)
        if truth is None:
            raise InputError("several thresholds need the truth: plot(truth=...)", "truth")
        decided = (self.choice != UNDECIDED).sum(axis=1)
        right = (self.choice == truth).sum(axis=1)
        known = decided > 0  # if all trials are undecided there is no mean time
        mean_ms = np.nanmean(self.time_ms[known], axis=1)
        return tradeoff(mean_ms, right[known], decided[known], ax)

    @property
    def steps(self) -> Array:
        """Time in readings, the paper's T (never below 0; NaN where undecided)."""
        return np.maximum(self.time_ms, 0.0) / self.step_ms


def joined(parts: Sequence[Decision]) -> Decision:
    """Concatenate decisions over several parts of the trials; all at one threshold."""
    names = ("choice", "time_ms", "forced", "premature", "deadline_ms")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Decision(**arrays, step_ms=parts[0].step_ms, gain=parts[0].gain)


def first_crossing(
    trace: Trace,
    thresholds: npt.ArrayLike | None = None,
    *,
    posterior: npt.ArrayLike | None = None,
    forced: bool = True,
    checked: bool = True,
) -> Decision:
    """Decide each trial at the first tick at which some channel's output meets its threshold.

    Response i is made when ``OUT_i <= threshold_i``; up to the onset of evidence only when
    ``OUT_i < threshold_i``, so that a flat prior does not decide by itself at a zero gap. If
    several channels cross at one tick, the one furthest below its threshold wins; a response forced
    at the end of a trial goes to the lowest output. Differences below 1e-10 nats are rounding error
    and count as ties. Tied channels are equally likely to be chosen, by a hash of the trial's
    number, so that the choice is the same in every run, batch and integrator.

    Parameters
    ----------
    trace : Trace
        Output (trials, ticks, hypotheses) in nats.
    thresholds : float, array (K,) or array (K, hypotheses), nats
        One threshold for all responses, K such thresholds, or K sets with one per response. One
        pass over the trace serves all K.
    posterior : float or array (K,), optional
        Posterior probability at which a trial stops, replaces ``thresholds``.
    forced : bool
        Whether the deadline forces a response; if not, such trials stay undecided.
    checked : bool
        Whether thresholds are compared with the range of OUT, and decisions with the available
        readings. False for a grid or a learner that leaves the range on purpose.

    Returns
    -------
    Decision
        Arrays of shape (trials,) for one threshold, (K, trials) otherwise.

    Raises
    ------
    ValueError
        If a threshold is not finite or its shape is none of the three; if it is below the lowest
        possible OUT; if every trial decides before its first reading.

    Warns
    -----
    UserWarning
        If the deadline decides most trials, or most decide before their first reading; if noise
        alone crosses the threshold; of several thresholds, how many are unusable.
    """
    # Importing Numba takes most of a second: only when a decision is made.
    from bgmodel.deciding.kernel import cross_all

    out, first, ends, numbers = ready(trace)
    levels = _chosen(trace, thresholds, posterior)
    order, level = sorted_levels(levels, out.shape[2])
    check_flag("checked", checked)
    if checked:
        _check_before(trace, levels, asked=thresholds is not None)
    tick, choice = cross_all(out, first, order, level, ends, numbers)
    check_ended(out, ends, tick.min(axis=1) < 0)
    if np.ndim(levels) == 0:
        tick, choice = tick[:, 0], choice[:, 0]
    decision = _decision(trace, tick.T, choice.T, forced, first, ends)
    if checked:
        check_decision(decision, levels, forced=forced, of_test=of_test(trace))
    return decision


def crossing_of_each(
    trace: Trace, thresholds: Reals, *, forced: bool = True, checked: bool = True
) -> Decision:
    """Decide each trial at its own threshold, (trials,) nats, as for a learner that explores."""
    from bgmodel.deciding.kernel import cross_each

    out, first, ends, numbers = ready(trace)
    levels = np.asarray(reals("thresholds", thresholds), dtype=np.float64)
    if levels.shape != out.shape[:1] or not np.isfinite(levels).all():
        raise InputError.of("thresholds", f"must be {len(out)} finite nats, one per trial", levels)
    if checked and trace.readout is not None:
        trace.readout.check(levels)
    tick, choice = cross_each(out, first, levels, ends, numbers)
    check_ended(out, ends, tick < 0)
    decision = _decision(trace, tick, choice, forced, first, ends)
    if checked:
        check_decision(decision, levels, forced=forced, of_test=of_test(trace))
    return decision


def check_decision(
    decision: Decision, thresholds: npt.ArrayLike, *, forced: bool, of_test: bool
) -> None:
    """Refuse if all decisions of a test came before any reading; warn if most did, or never came.

    ``of_test``: OUT has no noise, so that before evidence it is the same in each trial.
    """
    unmet = decision.forced | (decision.choice == UNDECIDED)
    late, early = (np.atleast_1d(t.sum(axis=-1)) for t in (unmet, decision.premature))
    levels, count, trials = np.atleast_1d(thresholds), len(late), unmet.shape[-1]
    if of_test and (early == trials).all():
        raise InputError(
            "every trial decides before its first reading, without evidence: the prior is past the "
            f"threshold of {levels.flat[0]:.3g} already{meant(levels.flat[0])}",
            "thresholds",
        )
    end = "the deadline decides them" if forced else "they stay undecided"
    for wrong, kind, what, better in (
        (early, NoiseWarning, "decide before their first reading, without evidence", "a lower "
         "threshold (a higher posterior or separation)"),
        (late, DeadlineWarning, f"never meet the threshold, {end}", "more readings or a higher "
         "threshold (a lower posterior or separation)"),
    ):  # fmt: skip
        most = wrong > MOST * trials
        if not most.any():
            continue
        who = f"{wrong[0]} of {trials} trials"
        if count > 1:
            who = f"at {most.sum()} of {count} thresholds most trials"
        kind.warn(f"{who} {what}: give {better}")


def any_crossing(out_nats: Reals, threshold_nats: float) -> Truths:
    """Whether each evidence-free trial ends in a response, (trials,).

    The rule is that of ``first_crossing`` up to the onset of evidence.
    """
    ticks = out_nats.shape[1]
    before_onset = Trace(out_nats, np.arange(ticks, dtype=np.float64), onset_ms=float(ticks))
    decision = first_crossing(before_onset, float(threshold_nats), forced=False, checked=False)
    return np.asarray(decision.choice != UNDECIDED)


def _chosen(
    trace: Trace, thresholds: npt.ArrayLike | None, posterior: npt.ArrayLike | None
) -> npt.ArrayLike:
    """Return the given thresholds, or those of a posterior."""
    check_one_given("thresholds", thresholds, posterior)
    if posterior is None:
        return reals("thresholds", thresholds)  # type: ignore[arg-type]
    if trace.readout is None:
        reason = "this trace does not define the posterior of an OUT: give thresholds"
        raise InputError(reason, "posterior")
    return trace.readout.threshold(posterior, trace.out_nats.shape[2])


def _check_before(trace: Trace, levels: npt.ArrayLike, *, asked: bool) -> None:
    """Check thresholds against the range of OUT; ``asked``: they were not given as a posterior."""
    known = trace.readout
    if known is None:
        return
    known.check(levels)
    if np.ndim(levels):
        return
    level = float(levels)  # type: ignore[arg-type]
    if asked:
        known.doubt(level, trace.out_nats.shape[2])
    if known.warn_of_noise is not None:
        known.warn_of_noise(level)


def _decision(
    trace: Trace, tick: Integers, choice: Integers, forced: bool, first: int, ends: Integers
) -> Decision:
    """Turn crossings into a Decision; tick is -1 where no threshold was reached."""
    check_flag("forced", forced)
    reached = tick >= 0
    relative_ms = trace.time_ms - trace.onset_ms
    last = ends - 1
    time_ms = relative_ms[np.where(reached, tick, last)]
    if not forced:
        choice = np.where(reached, choice, np.int16(UNDECIDED))
        time_ms = np.where(reached, time_ms, np.nan)
    return Decision(
        choice,
        time_ms,
        ~reached & forced,
        reached & (tick < first),
        trace.step_ms,
        relative_ms[last],
        trace.truth,
        trace.gain,
    )
