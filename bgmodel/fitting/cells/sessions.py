"""Sessions of recorded cells: clicks, choices, spikes in bins, and the recent rate of each cell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from bgmodel.trials.record import Trials
from bgmodel.trials.spikes import BEFORE_S, without_silent
from circuits.arrays import Array, Integers, Truths
from circuits.errors import InputError, require

BIN_S = 0.05
"""Width of the bins in which spikes are counted, s."""
LAG_S = 0.05
"""Time from the sum of clicks to the spikes that it drives, s."""
KNOTS = 6
"""Number of cubic splines of a cell's course during the clicks."""
PAST_S, PAST_LOG = 0.3, 2.0
"""Time constant of a cell's recent rate, s; and the log of that rate + 1 Hz that has no effect."""
FEWEST_SPIKES = 50
"""Least number of spikes of a cell that is fitted."""
LONGEST_S = 10.0
"""Longest evidence, s."""


@dataclass(frozen=True, eq=False)
class RecordedSession:
    """The trials in which the same cells were recorded.

    Spikes are counted in bins from ``LAG_S`` after the onset; the last bin of a trial ends at most
    ``LAG_S`` after its clicks. A trial shorter than a bin has one.
    """

    trials: Integers  # (trials,), index among all trials
    names: tuple[str, ...]  # of the cells
    end_s: Array  # (trials,), end of the clicks
    choice: Integers  # (trials,), 1 or 0; -1 without a choice
    click_s: Array  # (trials, clicks), infinite after the last
    click: Array  # (trials, clicks), weight for response 1 minus that for response 0
    counts: Array  # (cells, trials, bins)
    past: Array  # (cells, trials, bins), recent rate before each bin on a logarithmic scale
    basis: Array  # (bins, KNOTS)

    @cached_property
    def bins(self) -> Integers:
        """Number of bins of each trial, (trials,)."""
        return np.maximum((self.end_s / BIN_S + 1e-9).astype(np.int64), 1)

    @cached_property
    def on(self) -> Truths:
        """Whether a bin belongs to a trial, (trials, bins)."""
        return np.asarray(np.arange(self.counts.shape[2]) < self.bins[:, None])

    @property
    def middles_s(self) -> Array:
        """Time of the sum of clicks that drives the spikes of each bin, (bins,)."""
        return np.asarray((np.arange(self.counts.shape[2]) + 0.5) * BIN_S)

    def where(self, kept: Truths) -> Self:
        """Return some of the trials."""
        per_trial = ("trials", "end_s", "choice", "click_s", "click")
        parts = {name: getattr(self, name)[kept] for name in per_trial}
        return replace(self, counts=self.counts[:, kept], past=self.past[:, kept], **parts)

    def sums(self, leak_per_s: float, adaptation: float, recovery_s: float) -> Array:
        """Return the sum of clicks in each bin and, last, at the end, (trials, bins + 1).

        Each click reduces the effect of those after it to the share ``adaptation``; the effect
        then recovers (Brunton et al. 2013).
        """
        return _sums(self, leak_per_s, adaptation, recovery_s)

    @cached_property
    def seen(self) -> tuple[Array, Integers]:
        """Times of the sum, s, and the number of clicks until then, (trials, bins + 1)."""
        when = np.column_stack([np.tile(self.middles_s, (len(self.end_s), 1)), self.end_s])
        pairs = zip(self.click_s, when, strict=True)
        return when, np.array([np.searchsorted(click_s, by, side="right") for click_s, by in pairs])


@lru_cache(maxsize=256)
def _sums(
    session: RecordedSession, leak_per_s: float, adaptation: float, recovery_s: float
) -> Array:
    """Return ``RecordedSession.sums``, which derivatives by other parameters need repeatedly."""
    when, seen = session.seen
    effect = session.click * _effects(session.click_s, adaptation, recovery_s)
    grown = np.exp(leak_per_s * np.where(np.isfinite(session.click_s), session.click_s, 0.0))
    total = np.pad((effect * grown).cumsum(axis=1), ((0, 0), (1, 0)))
    return np.asarray(np.exp(-leak_per_s * when) * np.take_along_axis(total, seen, axis=1))


def _effects(click_s: Array, adaptation: float, recovery_s: float) -> Array:
    """Return the effect of each click after those before it, (trials, clicks)."""
    effects = np.ones(click_s.shape)
    click_s = np.where(np.isfinite(click_s), click_s, 1e9)
    for k in range(1, click_s.shape[1]):
        apart = click_s[:, k] - click_s[:, k - 1]
        effects[:, k] = 1 - (1 - adaptation * effects[:, k - 1]) * np.exp(-apart / recovery_s)
    return effects


def courses(bins: int) -> Array:
    """Return the basis of splines for the time course of a cell's rate, (bins, KNOTS)."""
    from scipy.interpolate import BSpline

    ends = max(bins * BIN_S, 4 * BIN_S)
    knots = np.concatenate([[0.0] * 3, np.linspace(0, ends, KNOTS - 2), [ends] * 3])
    at = (np.arange(bins) + 0.5) * BIN_S
    return np.asarray(BSpline.design_matrix(at, knots, 3).toarray())


def recent(rate_hz: Array) -> Array:
    """Return a recent rate on the scale on which it moves a cell."""
    return np.asarray(np.log1p(rate_hz) - PAST_LOG)


def seen_share(edges_s: Array) -> Array:
    """Return the share of the recent past that was recorded, by times from the onset."""
    return np.asarray(1 - np.exp(-(edges_s + BEFORE_S) / PAST_S))


@lru_cache(maxsize=16)
def sessions_of(trials: Trials, fewest: int = FEWEST_SPIKES) -> tuple[RecordedSession, ...]:
    """Return the sessions of one person's trials; ValueError without spikes or clicks.

    Cells with fewer spikes than ``fewest`` are left out.
    """
    from scipy.sparse.csgraph import connected_components

    readings = trials.readings
    if trials.spikes is None or readings is None or readings.choice is None:
        raise InputError("these trials have no spikes: give read_trials spikes", "spikes")
    require(len(readings.names) == 2, "evidence", "must have two sides", readings.names)
    last_s = np.where(np.isfinite(readings.time_s), readings.time_s, 0.0).max(axis=1)
    end_s = np.where(np.isnan(trials.rt_s), last_s, trials.rt_s)
    require(end_s.max() <= LONGEST_S, "rt", f"must be at most {LONGEST_S:g} s", float(end_s.max()))
    spikes = without_silent(trials.spikes, fewest)
    click = readings.log_likelihood[:, :, 1] - readings.log_likelihood[:, :, 0]
    # Trials with different cells share the course of a cell that was recorded in both.
    group = connected_components(spikes.recorded.T.astype(int) @ spikes.recorded)[1]
    patterns, which = np.unique(spikes.recorded, axis=0, return_inverse=True)
    sessions = []
    for number, pattern in enumerate(patterns):
        if not pattern.any():
            continue
        rows, cells = np.flatnonzero(which.ravel() == number), np.flatnonzero(pattern)
        some = np.isin(spikes.trial, rows)
        trial = np.searchsorted(rows, spikes.trial[some])
        cell = np.searchsorted(cells, spikes.cell[some])
        shared = spikes.recorded[:, group == group[cells[0]]].any(axis=1)
        longest, bins = (max(int(end_s[x].max() / BIN_S + 1e-9), 1) for x in (shared, rows))
        shape = (len(cells), len(rows), bins)
        time_s = spikes.time_s[some]
        counts, past = np.zeros(shape), np.zeros(shape)
        place = np.floor((time_s - LAG_S) / BIN_S).astype(np.int64)
        inside = (place >= 0) & (place < bins)
        np.add.at(counts, (cell[inside], trial[inside], place[inside]), 1.0)
        edges_s = np.asarray(np.arange(bins) * BIN_S + LAG_S, np.float64)
        for k, edge in enumerate(edges_s):
            before = time_s < edge
            weight = np.exp(-(edge - time_s[before]) / PAST_S) / PAST_S
            np.add.at(past[:, :, k], (cell[before], trial[before]), weight)
        made = RecordedSession(
            rows, tuple(spikes.names[k] for k in cells), end_s[rows], readings.choice[rows],
            readings.time_s[rows], click[rows], counts, recent(past / seen_share(edges_s)),
            courses(longest)[:bins],
        )  # fmt: skip
        sessions.append(replace(made, counts=counts * made.on))
    return tuple(sessions)
