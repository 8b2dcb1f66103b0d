"""Trials whose evidence is known, reading by reading, with their choices and response times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from bgmodel.fitting.design import ALONE, Design, cells_of
from bgmodel.fitting.responses import BIN_S, BinnedResponses, Grid
from bgmodel.fitting.sides import name_of
from bgmodel.trials.columns import EVERYONE
from bgmodel.trials.record import Trials
from bgmodel.trials.timed_readings import Readings
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require

FEWEST = 20
"""Least number of trials of a fit."""
LONE_S = 0.1
"""Time for which a reading counts if no trial has a second one, s."""
MOST_EARLY = 0.5
"""Largest tolerated share of responses that precede the first reading of their trial."""


@dataclass(frozen=True, eq=False)
class KnownTrials:
    """Choices and response times of one participant, with the readings of each trial."""

    # (trials, readings, alternatives), nats, up to a common constant; 0 after the last reading.
    log_likelihood: Array
    time_s: Array  # (trials, readings), s, on the clock of ``rt_s``; infinite after the last
    lengths: Integers  # (trials,), number of readings
    names: tuple[str, ...]  # the alternatives
    choice: Integers  # (trials,), index of the alternative; -1 without a response
    rt_s: Array  # (trials,), s; NaN without a response, or everywhere for choices alone
    ids: tuple[str, ...]
    forced: bool = False  # Whether the last reading of a trial forces a response.
    who: str = EVERYONE

    def __post_init__(self) -> None:
        require(self.trials >= FEWEST, "trials", f"must be at least {FEWEST}", self.trials)
        answered = self.choice >= 0
        if self.timed and not np.array_equal(answered, np.isfinite(self.rt_s)):
            trial = self.ids[int(np.argmax(answered != np.isfinite(self.rt_s)))]
            raise InputError(f"trial {trial} must have a response and a time, or neither", "rt")
        if len(np.unique(self.choice[answered])) == 1:  # none at all: yet to be simulated
            raise InputError(
                "two different responses or more must occur in the trials of a fit", "response"
            )
        early = answered & (self.seen == 0)
        if not early.any():
            return
        first = int(np.argmax(early))
        message = (
            f"{early.sum()} of {answered.sum()} responses precede the first reading of their "
            f"trial, such as trial {self.ids[first]} (response at {self.rt_s[first]:.3g} s, first "
            f"reading at {self.time_s[first, 0]:.3g} s)"
        )
        if early.sum() > MOST_EARLY * answered.sum():
            raise InputError(f"{message}: do both tables count time from the same onset?", "time")
        DataWarning.warn(f"{message}: they count as lapses")

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.rt_s)

    @cached_property
    def timed(self) -> bool:
        """Whether responses have times."""
        return bool(np.isfinite(self.rt_s).any() or (self.choice < 0).all())

    @property
    def alternatives(self) -> int:
        """Number of alternatives."""
        return len(self.names)

    @cached_property
    def seen(self) -> Integers:
        """Number of readings before the response, (trials,); all of them without its time."""
        before = np.isfinite(self.time_s) & (self.time_s < self.until_s[:, None])
        return np.asarray(before.sum(axis=1))

    @cached_property
    def seen_places(self) -> tuple[Integers, Integers]:
        """Trial and number, from 0, of each reading before the response, in order."""
        places = np.nonzero(np.arange(max(int(self.seen.max()), 1)) < self.seen[:, None])
        return places[0], places[1]

    @cached_property
    def offsets(self) -> Integers:
        """Place of the first seen reading of each trial among all, and their number."""
        return np.concatenate([[0], np.cumsum(self.seen)])

    @cached_property
    def seen_s(self) -> Array:
        """Time of each reading before the response, in order, s."""
        return np.asarray(self.time_s[self.seen_places])

    @cached_property
    def ends(self) -> Truths:
        """Whether the last seen reading forces a response, (trials,)."""
        return np.asarray(self.forced & (self.seen == self.lengths))

    @cached_property
    def until_s(self) -> Array:
        """Time until which a trial has no response, (trials,), s; infinite without one."""
        return np.where(np.isfinite(self.rt_s), self.rt_s, np.inf)

    @cached_property
    def design(self) -> Design:
        """One cell with all trials; response 1 is the second alternative.

        Of more than two, it is that which the readings before the response favour.
        """
        right = np.asarray(
            self.choice == self.favoured(self.until_s[:, None])[:, 0], dtype=np.int64
        )
        grid = Grid(int(np.ceil(self.span_s / BIN_S)) + 1)
        silent = bool((self.choice < 0).any())
        observed = BinnedResponses(
            np.zeros(self.trials, dtype=np.int64), np.where(self.choice < 0, -1, right), self.rt_s,
            grid, grid.bins * BIN_S if silent else None, alternatives=self.alternatives,
            untimed=None if self.timed else np.ones((1, 2), dtype=bool),
        )  # fmt: skip
        return Design(np.array([ALONE]), {}, observed, who=self.who)

    def favoured(self, by_s: Array) -> Integers:
        """Return which alternative is response 1 at times (trials, times); see ``design``."""
        if self.alternatives == 2:
            return np.ones(by_s.shape, dtype=np.int64)
        pairs = zip(self.time_s, by_s, self._leaders, strict=True)
        return np.array([first[np.searchsorted(time_s, by)] for time_s, by, first in pairs])

    @cached_property
    def _leaders(self) -> Integers:
        """The alternative that readings favour before the first, and after each."""
        sums = np.pad(self.log_likelihood.cumsum(axis=1), ((0, 0), (1, 0), (0, 0)))
        return np.asarray(sums.argmax(axis=2))

    @property
    def span_s(self) -> float:
        """Time over which lapses are spread, s: up to the latest response, or reading without."""
        seen = np.isfinite(self.rt_s)
        return float(
            self.rt_s[seen].max() if seen.any() else self.time_s[self.time_s < np.inf].max()
        )


@lru_cache(maxsize=64)
def known_trials(trials: Trials) -> KnownTrials:
    """Return the trials of one participant, or of all pooled; ValueError without readings."""
    readings = trials.readings
    if readings is None or readings.choice is None:
        raise InputError("these trials have no readings: give read_trials evidence", "evidence")
    blank = waiting(readings, readings.forced)
    return replace(blank, choice=readings.choice, rt_s=trials.rt_s, who=name_of(trials))


def known_design(trials: Trials, by: Sequence[str] = ()) -> Design:
    """Return the cells of some conditions with their trials; see ``KnownTrials.design``."""
    alone = known_trials(trials).design
    strength, conditions, cell = cells_of(trials, by)
    untimed = alone.observed.untimed
    untimed = None if untimed is None else np.repeat(untimed, len(strength), axis=0)
    observed = replace(alone.observed, cell=cell, untimed=untimed)
    return replace(
        alone, strength=strength, conditions=conditions, observed=observed, choices=trials
    )


def gaps_s(trials: KnownTrials) -> Array:
    """Return all times between two readings of a trial, s."""
    gaps = np.diff(np.where(np.isfinite(trials.time_s), trials.time_s, np.nan), axis=1)
    return np.asarray(gaps[np.isfinite(gaps)])


def intervals(trials: KnownTrials) -> tuple[Array, Array]:
    """Return when each reading before the response and the next one come, (trials, readings), s."""
    after = np.concatenate([trials.time_s[:, 1:], np.full((trials.trials, 1), np.inf)], axis=1)
    starts, gaps = trials.time_s, gaps_s(trials)
    median_s = float(np.median(gaps)) if gaps.size else LONE_S
    ends = np.where(np.isfinite(after), after, starts + median_s)
    most = max(int(trials.seen.max()), 1)
    return starts[:, :most], ends[:, :most]


def waiting(readings: Readings, forced: bool = True) -> KnownTrials:
    """Return trials without responses; whether the last reading forces one is ``forced``."""
    count = len(readings.ids)
    return KnownTrials(
        readings.log_likelihood, readings.time_s, readings.lengths, readings.names,
        np.full(count, -1), np.full(count, np.nan), tuple(trial for _, trial in readings.ids),
        forced,
    )  # fmt: skip


def responding(
    trials: KnownTrials,
    choice: Integers,
    decided_s: Array,
    values: Mapping[str, Array | float],
    rng: np.random.Generator,
) -> KnownTrials:
    """Return trials with responses: decisions with non-decision times, and lapses."""
    delay = values["t0_s"] + values["t0_sd_s"] * rng.standard_normal(len(choice))
    rt_s = decided_s + np.maximum(delay, 0.001)
    lapsed = rng.random(len(choice)) < values["lapse"]
    rt_s = np.where(lapsed, np.nanmax(rt_s) * rng.uniform(0.001, 1.0, len(choice)), rt_s)
    guess = rng.integers(trials.alternatives, size=len(choice))
    choice = np.where(lapsed, guess, choice).astype(np.int64)
    return replace(trials, choice=choice, rt_s=rt_s)
