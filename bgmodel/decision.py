"""The stopping rule: the only place where an output trace becomes a decision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.arrays import Array, Integers, Reals, Truths
from bgmodel.facts import Facts, span

if TYPE_CHECKING:
    from matplotlib.axes import Axes

UNDECIDED = -1


@dataclass(frozen=True, repr=False)
class Trace(Facts):
    """What an integrator makes of evidence.

    Parameters
    ----------
    out_nats : array (trials, ticks, hypotheses), nats
        The output of each channel; the lower, the more its hypothesis is favoured
        (Bogacz & Gurney 2007: OUT_i = -ln P_i).
    time_ms : array (ticks,), ms
        When each tick happens, from the start of the trial, rising.
    onset_ms, step_ms : float, ms
        When evidence sets in, and the time between readings, as in ``Evidence``.
    ends : array (trials,), int, optional
        Number of ticks of each trial: at its last one it must respond. All ticks if left out.
    numbers : array (trials,), int, optional
        Number of each trial, as in ``Evidence``: it decides ties. 0, 1, 2, ... if left out.
    """

    out_nats: Reals
    time_ms: Array
    onset_ms: float = 0.0
    step_ms: float = 1.0
    ends: Integers | None = None
    numbers: Integers | None = None

    def facts(self) -> dict[str, str]:
        """Return shape, clock and range of OUT."""
        trials, ticks, hypotheses = self.out_nats.shape
        return {
            "trials": f"{trials}",
            "ticks": f"{ticks}",
            "hypotheses": f"{hypotheses}",
            "time_ms": span(self.time_ms),
            "onset_ms": f"{self.onset_ms:g}",
            "step_ms": f"{self.step_ms:g}",
            "out_nats": span(self.out_nats),
        }

    def plot(self, trial: int = 0, ax: Axes | None = None) -> Axes:
        """Draw OUT of one trial, a line per hypothesis.

        Parameters
        ----------
        trial : int
            Number of the trial.
        ax : Axes, optional
            Drawn on and returned; that of a new figure unless given.
        """
        from bgmodel.plots import new_axes, output

        if trial not in range(len(self.out_nats)):
            raise ValueError(f"trial must lie in 0..{len(self.out_nats) - 1}, got {trial}")
        ticks = self.of_trials()[0][trial]
        relative_ms = self.time_ms[:ticks] - self.onset_ms
        return output(new_axes(ax), relative_ms, self.out_nats[trial, :ticks])

    def of_trials(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the number of ticks of each trial, and the number that decides its ties."""
        trials, ticks = self.out_nats.shape[:2]
        ends = np.full(trials, ticks) if self.ends is None else self.ends
        numbers = np.arange(trials) if self.numbers is None else self.numbers
        return np.asarray(ends, dtype=np.int64), np.asarray(numbers, dtype=np.int64)


@dataclass(frozen=True, repr=False)
class Decision(Facts):
    """Decisions, one a trial (and one row a threshold where several were given).

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
    """

    choice: Integers
    time_ms: Array
    forced: Truths
    premature: Truths
    step_ms: float
    deadline_ms: Array

    def facts(self) -> dict[str, str]:
        """Return the numbers of decided and forced trials, and the mean time."""
        *thresholds, trials = self.choice.shape
        found = {"thresholds": f"{thresholds[0]}"} if thresholds else {}
        decided = self.choice != UNDECIDED
        times = np.where(decided, self.time_ms, 0.0).sum(axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean_ms = times / decided.sum(axis=-1)
        return {
            **found,
            "trials": f"{trials}",
            "mean_time_ms": span(mean_ms),
            "forced": span(self.forced.sum(axis=-1), ".0f"),
            "undecided": span((~decided).sum(axis=-1), ".0f"),
            "premature": span(self.premature.sum(axis=-1), ".0f"),
        }

    def plot(self, ax: Axes | None = None, truth: Integers | None = None) -> Axes:
        """Draw the times of each choice; of several thresholds, accuracy against mean time.

        Parameters
        ----------
        ax : Axes, optional
            Drawn on and returned; that of a new figure unless given.
        truth : int array (trials,), optional
            The true hypotheses: several thresholds need them.

        Raises
        ------
        ValueError
            If there are several thresholds and no truth.
        """
        from bgmodel.plots import choice_times, new_axes, speed_accuracy

        if self.choice.ndim == 1:
            return choice_times(new_axes(ax), self.choice, self.time_ms)
        if truth is None:
            raise ValueError("decisions at several thresholds need the truth: plot(truth=...)")
        decided = (self.choice >= 0).sum(axis=1)
        accuracy = (self.choice == np.asarray(truth)).sum(axis=1) / np.maximum(decided, 1)
        # Where all trials are undecided there is no mean time.
        known = (self.choice != UNDECIDED).any(axis=1)
        mean_steps = np.nanmean(self.steps[known], axis=1)
        return speed_accuracy(new_axes(ax), mean_steps, accuracy[known], None, marker=".")

    @property
    def steps(self) -> Array:
        """Time in readings, the paper's T (never below 0; NaN where undecided)."""
        return np.maximum(self.time_ms, 0.0) / self.step_ms


def joined(parts: Sequence[Decision]) -> Decision:
    """Return the decisions of several parts of the same trials as one; all at one threshold."""
    names = ("choice", "time_ms", "forced", "premature", "deadline_ms")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Decision(**arrays, step_ms=parts[0].step_ms)


def first_crossing(trace: Trace, thresholds: npt.ArrayLike, *, forced: bool = True) -> Decision:
    """Decide each trial at the first tick at which some channel's output is at its threshold.

    Response i is made when ``OUT_i <= threshold_i``; up to the onset of evidence only when
    ``OUT_i < threshold_i``, so a flat prior never decides by itself at a zero gap.  If several
    channels cross at one tick, the one furthest below its threshold wins; a response forced at the
    end of a trial goes to the lowest output.  Differences below 1e-10 nats are rounding, and count
    as equality: among equal channels the choice is drawn, each with the same chance, by a hash of
    the trial's number, so that it is the same in every run, batch and integrator.

    Parameters
    ----------
    trace : Trace
        Output (trials, ticks, hypotheses) in nats.
    thresholds : float, array (K,) or array (K, hypotheses), nats
        One threshold for all responses, K such thresholds, or K sets of one a response.  All K
        are served in one pass over the trace.
    forced : bool
        Whether the deadline forces a response; if not, such trials stay undecided.

    Returns
    -------
    Decision
        Arrays of shape (trials,) for one threshold, (K, trials) otherwise.

    Raises
    ------
    ValueError
        If a threshold is not finite or the shape is none of the three.
    """
    # Importing Numba takes most of a second: only where a decision is made.
    from bgmodel.crossing import cross_all

    out = _contiguous(trace.out_nats)
    order, level = _sorted_levels(thresholds, out.shape[2])
    ends, numbers = trace.of_trials()
    tick, choice = cross_all(out, _first_reading(trace), order, level, ends, numbers)
    if np.ndim(thresholds) == 0:
        tick, choice = tick[:, 0], choice[:, 0]
    return _decision(trace, tick.T, choice.T, forced)


def crossing_of_each(trace: Trace, thresholds: Reals, *, forced: bool = True) -> Decision:
    """Decide each trial with a threshold of its own, as a learner that explores does.

    Parameters
    ----------
    trace : Trace
        Output (trials, ticks, hypotheses) in nats.
    thresholds : array (trials,), nats
        One threshold a trial, for all of its responses; the rule is ``first_crossing``'s.
    forced : bool
        Whether the deadline forces a response.
    """
    from bgmodel.crossing import cross_each

    levels = np.asarray(thresholds, dtype=np.float64)
    if levels.shape != trace.out_nats.shape[:1] or not np.isfinite(levels).all():
        raise ValueError(
            f"thresholds must be {len(trace.out_nats)} finite nats, one a trial, got {levels}"
        )
    out = _contiguous(trace.out_nats)
    ends, numbers = trace.of_trials()
    tick, choice = cross_each(out, _first_reading(trace), levels, ends, numbers)
    return _decision(trace, tick, choice, forced)


def any_crossing(out_nats: Reals, threshold_nats: float) -> Truths:
    """Whether each trial of a time without evidence ends in a response, (trials,).

    The rule is that of ``first_crossing`` up to the onset of evidence.

    Parameters
    ----------
    out_nats : array (trials, ticks, hypotheses), nats
        Output without evidence.
    threshold_nats : float
        For all responses.
    """
    ticks = out_nats.shape[1]
    before_onset = Trace(out_nats, np.arange(ticks, dtype=np.float64), onset_ms=float(ticks))
    decision = first_crossing(before_onset, float(threshold_nats), forced=False)
    return np.asarray(decision.choice != UNDECIDED)


@dataclass(frozen=True, repr=False)
class Tally(Facts):
    """Sums over trials for each of K thresholds: trials (int), and arrays (K,) of the rest."""

    trials: int
    correct: npt.NDArray[np.int64]
    steps: Array
    forced: npt.NDArray[np.int64]

    def facts(self) -> dict[str, str]:
        """Return trials, thresholds, accuracy and mean time."""
        return {
            "trials": f"{self.trials}",
            "thresholds": f"{len(self.correct)}",
            "accuracy": span(self.accuracy),
            "mean_steps": span(self.mean_steps),
            "forced": span(self.forced, ".0f"),
        }

    def __add__(self, other: Tally) -> Tally:
        """Pool two sets of trials."""
        return Tally(
            self.trials + other.trials,
            self.correct + other.correct,
            self.steps + other.steps,
            self.forced + other.forced,
        )

    @property
    def accuracy(self) -> Array:
        """Proportion correct, (K,)."""
        return self.correct / self.trials

    @property
    def mean_steps(self) -> Array:
        """Mean decision time in readings, (K,)."""
        return self.steps / self.trials


def tally(trace: Trace, truth: Integers | None, thresholds: npt.ArrayLike) -> Tally:
    """Count what ``first_crossing`` would decide, without keeping each decision.

    Parameters
    ----------
    trace : Trace
        Output (trials, ticks, hypotheses) in nats.
    truth : int array (trials,)
        The true hypothesis of each trial.
    thresholds : array (K,), nats
        Each for all responses; responses are forced at the deadline.

    Raises
    ------
    ValueError
        If the truth is not known, or thresholds are not (K,) finite numbers.
    """
    from bgmodel.crossing import tally_all

    if np.ndim(thresholds) != 1:
        raise ValueError(f"thresholds must be (K,), got shape {np.shape(thresholds)}")
    if truth is None:
        raise ValueError("tally counts correct choices: it needs the truth of each trial")
    out = _contiguous(trace.out_nats)
    order, level = _sorted_levels(thresholds, out.shape[2])
    steps_at = np.maximum(trace.time_ms - trace.onset_ms, 0.0) / trace.step_ms
    truth, first = np.asarray(truth), _first_reading(trace)
    correct, steps, forced = tally_all(out, truth, first, level[0], steps_at, *trace.of_trials())
    back = np.argsort(order[0])
    return Tally(len(out), correct[back], steps[back], forced[back])


def _decision(trace: Trace, tick: Integers, choice: Integers, forced: bool) -> Decision:
    """Put crossings into the words of a task; tick is -1 where no threshold was reached."""
    reached = tick >= 0
    relative_ms = trace.time_ms - trace.onset_ms
    last = trace.of_trials()[0] - 1
    time_ms = relative_ms[np.where(reached, tick, last)]
    if not forced:
        choice = np.where(reached, choice, np.int16(UNDECIDED))
        time_ms = np.where(reached, time_ms, np.nan)
    return Decision(
        choice,
        time_ms,
        ~reached & forced,
        reached & (tick < _first_reading(trace)),
        trace.step_ms,
        relative_ms[last],
    )


def _first_reading(trace: Trace) -> int:
    """Return the first tick at which a reading can have arrived."""
    reading_ms = trace.onset_ms + trace.step_ms
    return int(np.searchsorted(trace.time_ms, reading_ms * (1 - 1e-12), side="left"))


def _contiguous(out: Reals) -> Reals:
    if out.ndim != 3 or 0 in out.shape:
        raise ValueError(
            f"out_nats must be (trials, ticks, hypotheses), not empty, got {out.shape}"
        )
    return np.ascontiguousarray(out)


def _sorted_levels(thresholds: npt.ArrayLike, hypotheses: int) -> tuple[Integers, Array]:
    """Return, for each channel, the thresholds from highest to lowest and where they came from."""
    levels = np.asarray(thresholds, dtype=np.float64)
    if not np.isfinite(levels).all():
        raise ValueError(f"thresholds must be finite nats, got {levels.tolist()}")
    if levels.ndim < 2:
        levels = np.repeat(levels.reshape(-1, 1), hypotheses, axis=1)
    if levels.ndim != 2 or levels.shape[1] != hypotheses or len(levels) == 0:
        raise ValueError(
            f"thresholds must be a number, (K,) or (K, {hypotheses}), got shape "
            f"{np.shape(thresholds)}"
        )
    order = np.ascontiguousarray(np.argsort(-levels, axis=0, kind="stable").T)
    return order, np.ascontiguousarray(np.take_along_axis(levels.T, order, axis=1))
