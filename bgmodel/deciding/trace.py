"""The trace of OUT over time, and what the loops that decide need of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.readout import ReadOut
from bgmodel.support.checks import (
    check_finite,
    check_inside,
    check_positive,
    one_per_trial,
    reals,
)
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers, Reals, Truths
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Trace(Facts):
    """The output of an integrator in response to evidence, before any stopping rule.

    Parameters
    ----------
    out_nats : array (trials, ticks, hypotheses), nats
        The output of each channel; the lower, the more its hypothesis is favoured
        (Bogacz & Gurney 2007: OUT_i = -ln P_i).
    time_ms : array (ticks,), ms
        Time of each tick from the start of the trial, increasing.
    onset_ms, step_ms : float, ms
        Onset of evidence and time between readings, as in ``Evidence``.
    ends : array (trials,), int, optional
        Number of ticks of each trial: at the last one it must respond. All ticks if omitted.
    numbers : array (trials,), int, optional
        Number of each trial, as in ``Evidence``: used to break ties. 0, 1, 2, ... if omitted.
    readout : ReadOut, optional
        Resting and lowest possible OUT, against which decisions are checked.
    truth : array (trials,), int, optional
        The true hypotheses, if known; decisions keep them.
    gain : float, optional
        Nats in the circuit per nat of evidence, as run; None for a test. Decisions keep it.
    """

    out_nats: Reals
    time_ms: Array
    onset_ms: float = 0.0
    step_ms: float = 1.0
    ends: Integers | None = None
    numbers: Integers | None = None
    readout: ReadOut | None = None
    truth: Integers | None = None
    gain: float | None = None

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
            **({} if self.gain is None else {"gain": f"{self.gain:g}"}),
        }

    def plot(self, trial: int = 0, ax: Axes | None = None) -> Figure:
        """Draw OUT of one trial, a line per hypothesis; the onset of evidence is marked.

        Parameters
        ----------
        trial : int
            Number of the trial.
        ax : Axes, optional
            Axes to draw on; by default those of a new figure.

        Returns
        -------
        Figure
            One panel.
        """
        from bgmodel.plots import output

        last = len(self.out_nats) - 1
        require(trial in range(last + 1), "trial", f"must be within 0..{last}", trial)
        ticks = self.of_trials()[0][trial]
        relative_ms = self.time_ms[:ticks] - self.onset_ms
        return output(relative_ms, self.out_nats[trial, :ticks], ax)

    def of_trials(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the number of ticks of each trial, and the number used to break its ties.

        ValueError if either is not one per trial, or a trial has no tick or more ticks than OUT.
        """
        trials, ticks = np.shape(self.out_nats)[:2]
        ends = np.full(trials, ticks) if self.ends is None else self.ends
        ends = one_per_trial("ends", ends, trials)
        check_inside("ends", ends, 1, ticks)
        numbers = np.arange(trials) if self.numbers is None else self.numbers
        numbers = one_per_trial("numbers", numbers, trials)
        return ends.astype(np.int64), numbers.astype(np.int64)


def of_test(trace: Trace) -> bool:
    """Whether a trace is that of a test, which shows the resting OUT without noise."""
    return trace.readout is not None and bool(np.isinf(trace.readout.rest))


def check_trace(trace: Trace) -> None:
    """Raise ValueError for anything but a Trace, such as a bare array."""
    require(isinstance(trace, Trace), "trace", "must be a Trace, as from Msprt().run", trace)


def ready(trace: Trace) -> tuple[Reals, int, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return OUT, its first reading, and ends and numbers of trials, as compiled loops need them.

    The compiled loops do no bounds checking, so arrays that do not fit are refused here.
    """
    check_trace(trace)
    out = np.ascontiguousarray(reals("out_nats", trace.out_nats))
    if out.ndim != 3 or 0 in out.shape:
        raise InputError.of("out_nats", "must be (trials, ticks, hypotheses), not empty", out.shape)
    time_ms = np.asarray(trace.time_ms)
    if time_ms.shape != out.shape[1:2] or not (time_ms[1:] >= time_ms[:-1]).all():
        raise InputError(
            f"time_ms must hold the time of each of {out.shape[1]} ticks, increasing, got "
            f"{span(time_ms)} in shape {time_ms.shape}",
            "time_ms",
        )
    check_positive(step_ms=trace.step_ms)
    check_finite(onset_ms=trace.onset_ms)
    return out, first_reading(trace), *trace.of_trials()


def check_ended(out: Reals, ends: Integers, late: Truths) -> None:
    """Refuse trials that met no threshold and were dropped before their end."""
    trials = np.flatnonzero(late)
    unknown = np.isnan(out[trials, ends[trials] - 1]).any(axis=1)
    if unknown.any():
        raise InputError(
            f"OUT of {unknown.sum()} trials is NaN at their end, and they met no threshold before: "
            "give a threshold above the OUT at which trials were dropped",
            "thresholds",
        )


def first_reading(trace: Trace) -> int:
    """Return the first tick at which a reading can have arrived."""
    reading_ms = trace.onset_ms + trace.step_ms
    return int(np.searchsorted(trace.time_ms, reading_ms * (1 - 1e-12), side="left"))


def sorted_levels(thresholds: npt.ArrayLike, hypotheses: int) -> tuple[Integers, Array]:
    """Return, for each channel, the order that sorts the thresholds (highest first), and these."""
    levels = reals("thresholds", thresholds)
    require(np.isfinite(levels).all(), "thresholds", "must be finite nats", levels)
    if levels.ndim < 2:
        levels = np.repeat(levels.reshape(-1, 1), hypotheses, axis=1)
    if levels.ndim != 2 or levels.shape[1] != hypotheses or len(levels) == 0:
        must = f"must be a number, (K,) or (K, {hypotheses})"
        raise InputError.of("thresholds", must, np.shape(thresholds))
    order = np.ascontiguousarray(np.argsort(-levels, axis=0, kind="stable").T)
    return order, np.ascontiguousarray(np.take_along_axis(levels.T, order, axis=1))
