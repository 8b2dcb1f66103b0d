"""One person's stop-signal trials, laid out for fits, and the person's go process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.trials.design import design_of
from bgmodel.stopping.people import AFTER, slowing
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array, Integers
from bgmodel.trials.record import Trials
from circuits.errors import InputError, require

KEPT = 1024
"""Number of people whose layout is kept."""
FEWEST_GO = 10
"""Fewest go responses of a person in a fit."""
LAPSE = 0.02
"""Share of lapses in fits of the go process, which is not fitted."""
GO = ("sensitivity", "bound", "t0_s", "t0_sd_s")
"""Parameters of the go process: a diffusion between constant bounds (``GapModel``)."""


@dataclass(frozen=True, eq=False)
class StopData:
    """The stop trials of one person, and the go times that race with them.

    Parameters
    ----------
    go_ms, go_response : array (go trials,)
        Time of each go trial without the slowing after stop trials, ms, NaN without a response; and
        the response.
    slower_ms : array (trials,), ms
        How much slower go responses are after the kind of trial that came before.
    stop : int array (stop trials,)
        Places of the stop trials.
    ssd_ms, rt_ms : array (stop trials,), ms
        Their delays; their response times, NaN without a response.
    end_ms : float
        The deadline, or the longest time of a response or, by 1 ms, of a signal.
    """

    go_ms: Array
    go_response: Integers
    slower_ms: Array
    stop: Integers
    ssd_ms: Array
    rt_ms: Array
    end_ms: float

    @cached_property
    def times_ms(self) -> Array:
        """Times of go responses, sorted, ms."""
        return np.sort(self.go_ms[~np.isnan(self.go_ms)])

    @property
    def responded(self) -> float:
        """Share of go trials with a response."""
        return len(self.times_ms) / len(self.go_ms)

    @cached_property
    def shown_ms(self) -> Array:
        """Delay of each stop trial, earlier by the slowing of its go process, ms."""
        return np.asarray(self.ssd_ms - self.slower_ms[self.stop])

    @cached_property
    def alike(self) -> tuple[Integers, Integers]:
        """One stop trial of each delay after slowing, and which of them each trial is like."""
        _, first, which = np.unique(self.shown_ms, return_index=True, return_inverse=True)
        return first, which


@lru_cache(maxsize=KEPT)
def laid(trials: Trials, slowing_ms: tuple[float, float] | None = None) -> StopData:
    """Lay out one person's trials, in the order in which they were run.

    Parameters
    ----------
    trials : Trials
        The trials.
    slowing_ms : (float, float), ms, optional
        How much slower go responses are after failed and after successful stops; by default the
        person's own slowing, or 0 where it is unknown.

    Raises
    ------
    ValueError
        Without stop trials, with fewer than 10 go responses, and as for ``StopTrials``.
    """
    one = StopTrials.of(trials)
    go, stop = ~one.stop, np.flatnonzero(one.stop)
    enough = len(stop) and (go & one.responded).sum() >= FEWEST_GO
    must = f"must be given in some trials, and {FEWEST_GO} go trials must have a response"
    require(enough, "ssd", must, trials.people())
    if slowing_ms is None:
        known = slowing(one)
        slowings = (known[f"after_{name.replace(' ', '_')}_ms"] for name in AFTER)
        slowing_ms = tuple(np.nan_to_num(list(slowings)).tolist())
    before = np.append("", one.outcome[:-1])
    slower = np.select([before == name for name in AFTER], slowing_ms)
    end_ms = one.deadline_ms or max(float(np.nanmax(one.rt_ms)), float(np.nanmax(one.ssd_ms)) + 1)
    return StopData((one.rt_ms - slower)[go], trials.response[go].astype(np.int64), slower, stop,
                    one.ssd_ms[stop], one.rt_ms[stop], end_ms)  # fmt: skip


def go_process(trials: Trials) -> dict[str, float]:
    """Fit a diffusion between constant bounds to one person's go trials, by maximum likelihood.

    Returns
    -------
    dict
        ``GO``; NaN where it is unknown which responses are correct, where fewer are correct than by
        chance, and with fewer than 10 go responses.
    """
    unknown = dict.fromkeys(GO, np.nan)
    one = StopTrials.of(trials)
    go = ~one.stop & one.responded
    if one.correct is None or go.sum() < FEWEST_GO:
        return unknown
    try:
        design = design_of(trials.where(go))
    except InputError:
        return unknown
    fitted = optimum(likelihood_of(GapModel(), design, fixed={"lapse": LAPSE})).values
    return {name: fitted[name] for name in GO}
