"""From decisions to responses: non-decision time, lapses and the likelihood of data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.support.compiling import compiled
from circuits.arrays import Array, Integers, Truths

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of response times at which data and models are compared."""
BIN_S = 0.01
"""Width of a bin of time, s."""
TINY = 1e-300
"""Lower limit of probabilities before their logarithm is taken."""
FARTHEST = 8.5
"""Standard deviations beyond which the non-decision time has no mass in double precision."""
ENDS_S = 5.0
"""Time by which choices without times are taken to be made, s."""
EVERY_TIME = (0.0, math.inf)
"""Window that includes all responses, s."""


@dataclass(frozen=True)
class Grid:
    """Times at which densities are stored: the centres of bins from 0 on."""

    bins: int
    # Models whose decisions are simulated have no other width than ``BIN_S``.
    width_s: float = BIN_S
    # Number of bins, from the first, in which lapses respond; all by default.
    lapse_bins: int | None = None

    @cached_property
    def middles_s(self) -> Array:
        """Centres of the bins, (bins,), s."""
        return np.asarray((np.arange(self.bins) + 0.5) * self.width_s, dtype=np.float64)


def responded(
    decided: Array,
    grid: Grid,
    *,
    t0_s: Array,
    t0_sd_s: Array,
    lapse: Array,
    alternatives: int = 2,
) -> Array:
    """Return the density of responses, (cells, 2, bins), 1/s, from probabilities of decisions.

    The non-decision time is Gaussian; lapses are uniform up to ``lapse_bins``.
    """
    delayed = np.zeros(decided.shape)
    _delay(np.ascontiguousarray(decided), t0_s / grid.width_s, t0_sd_s / grid.width_s, delayed)
    # Estimates from simulated trials may be negative, by less than their error.
    np.maximum(delayed, 0.0, out=delayed)
    share = lapse[:, None, None]
    lapsed = np.array([alternatives - 1, 1])[:, None] / alternatives
    width_s = grid.width_s
    answers = (1 - share) / width_s * delayed
    until = grid.lapse_bins or grid.bins
    answers[:, :, :until] += share * lapsed / (until * width_s)
    return np.asarray(answers)


@compiled
def _delay(decided: Array, t0: Array, t0_sd: Array, delayed: Array) -> None:
    """Add the decisions of each bin to later bins; times are in bins."""
    bins = decided.shape[2]
    for cell in range(len(decided)):
        # Bins of decisions and of responses, and interpolation between the latter, each add to the
        # variance of times (Sheppard's corrections): together a third of a squared bin.
        sd = np.sqrt(max(t0_sd[cell] ** 2 - 1 / 3, 0.05**2))
        first = int(max(np.floor(t0[cell] - FARTHEST * sd), -bins + 1))
        last = int(min(np.ceil(t0[cell] + FARTHEST * sd), bins - 1))
        below = math.erfc((t0[cell] - first + 0.5) / (sd * np.sqrt(2.0))) / 2
        for late in range(first, last + 1):
            above = math.erfc((t0[cell] - late - 0.5) / (sd * np.sqrt(2.0))) / 2
            share, below = above - below, above
            start, end = max(late, 0), min(bins, bins + late)
            for side in range(2):
                # Slices, whose loop is compiled to vector instructions.
                now = decided[cell, side, start - late : end - late]
                then = delayed[cell, side, start:end]
                for k in range(len(then)):
                    then[k] += share * now[k]


@dataclass(frozen=True)
class BinnedResponses:
    """Responses binned on a grid, so that their likelihood is a few sums.

    It is conditional on responses within ``window_s``. A response without a time has the likelihood
    of its probability; trials without a response by the deadline count as a withheld one (Gomez,
    Ratcliff & Perea 2007). Wrong ``alternatives`` are equally likely.
    """

    cell: Integers
    # (trials,): 1 (correct if more than two), 0 (any wrong), -1 without a response
    response: Integers
    rt_s: Array  # (trials,), s; NaN without a response
    grid: Grid
    # No responses come later, and a missing response is an outcome.
    deadline_s: float | None = None
    # Earliest and latest time of a response that is fitted.
    window_s: tuple[float, float] = EVERY_TIME
    alternatives: int = 2
    # (cells, 2): which responses have no times; by default all have.
    untimed: Truths | None = None

    def recorded(self, density: Array) -> Array:
        """Return densities (cells, 2, bins), those of responses without times in the first bin."""
        if self.untimed is None:
            return density
        mass = density.sum(axis=2) * self.grid.width_s
        decided = mass.sum(axis=1, keepdims=True)
        every = self.untimed.all(axis=1, keepdims=True)
        mass = np.where(every, mass / np.maximum(decided, TINY), mass + np.maximum(1 - decided, 0))
        recorded = self.with_times(density)
        recorded[:, :, 0] += np.where(self.untimed, mass / self.grid.width_s, 0.0)
        return recorded

    def with_times(self, density: Array) -> Array:
        """Return densities, or masses, of the responses that have times."""
        return density if self.untimed is None else np.where(self.untimed[:, :, None], 0.0, density)

    @cached_property
    def _places(self) -> tuple[Integers, Array]:
        """Bin below each time, and its fractional distance to the next one."""
        place = np.clip(self.rt_s / self.grid.width_s - 0.5, 0, self.grid.bins - 1.000001)
        place = np.where(np.isnan(place), 0.0, place)
        low = place.astype(np.int64)
        return low, place - low

    def each(self, density: Array) -> Array:
        """Return the log likelihood of each trial under densities (cells, 2, bins), nats."""
        low, toward = self._places
        answer = np.maximum(self.response, 0)
        likelihood = (1 - toward) * density[self.cell, answer, low]
        likelihood += toward * density[self.cell, answer, low + 1]
        likelihood = np.where(np.isnan(self.rt_s), likelihood * self.grid.width_s, likelihood)
        if self.alternatives > 2:
            likelihood = np.where(
                self.response == 0, likelihood / (self.alternatives - 1), likelihood
            )
        missing = np.zeros(len(density))
        if self.deadline_s is not None:
            within = self.grid.middles_s < self.deadline_s
            missing = 1 - density[:, :, within].sum(axis=(1, 2)) * self.grid.width_s
            likelihood = np.where(self.response < 0, missing[self.cell], likelihood)
        log = np.log(np.maximum(likelihood, TINY))
        if self.window_s == EVERY_TIME:
            return np.asarray(log)
        kept = np.maximum(missing + self._inside(density), TINY)
        return np.asarray(log - np.log(kept)[self.cell])

    def outcomes(self, density: Array) -> tuple[Array, Array]:
        """Return probabilities of a response in each bin and of none, given the window."""
        mass = density * self.grid.width_s
        missing = np.zeros(len(mass))
        if self.deadline_s is not None:
            missing = np.maximum(1 - mass.sum(axis=(1, 2)), 0.0)
        start_s = np.arange(mass.shape[2]) * self.grid.width_s
        early, late = (np.clip((t - start_s) / self.grid.width_s, 0, 1) for t in self.window_s)
        mass = mass * (late - early) + (mass - self.with_times(mass)) * (1 - late + early)
        total = mass.sum(axis=(1, 2)) + missing
        return mass / total[:, None, None], missing / total

    def drawn(self, density: Array, rng: np.random.Generator) -> tuple[Array, Integers]:
        """Return times, s, and responses of new trials, (trials,); NaN and -1 for no response."""
        mass, missing = self.outcomes(density)
        bins = self.grid.bins
        below = np.cumsum(np.column_stack([mass.reshape(len(mass), -1), missing]), axis=1)
        place = np.empty(len(self.cell), dtype=np.int64)
        for cell in np.unique(self.cell):
            here = self.cell == cell
            at = rng.random(here.sum()) * below[cell, -1]
            place[here] = np.searchsorted(below[cell], at, side="right")
        response, bin_of = np.divmod(place, bins)
        width_s = self.grid.width_s
        early, late = (np.clip(t / width_s - bin_of, 0, 1) for t in self.window_s)
        rt_s = (bin_of + early + (late - early) * rng.random(len(place))) * width_s
        never = response == 2
        if self.untimed is not None:
            rt_s[self.untimed[self.cell, np.minimum(response, 1)]] = np.nan
        return np.where(never, np.nan, rt_s), np.where(never, -1, response)

    def _inside(self, density: Array) -> Array:
        """Return the probability of a response in the window, (cells,)."""
        bins, width_s = self.grid.bins, self.grid.width_s
        timed = self.with_times(density)
        mass = timed.sum(axis=1) * width_s

        def by(time_s: float) -> Array:
            return np.asarray(mass @ np.clip(time_s / width_s - np.arange(bins), 0, 1))

        early, late = self.window_s
        # Without a deadline the grid may end before the latest responses.
        unlimited = late > bins * width_s and self.deadline_s is None
        inside = (np.ones(len(mass)) if unlimited else by(late)) - by(early)
        return np.asarray(inside + (density - timed).sum(axis=(1, 2)) * width_s)


def moments(density: Array, grid: Grid) -> dict[str, Array]:
    """Return accuracy, mean time and sd, s, of trials that responded in time, (cells,)."""
    mass = density * grid.width_s
    answered = mass.sum(axis=(1, 2))
    times = mass.sum(axis=1) / answered[:, None]
    mean = times @ grid.middles_s
    return {
        "answered": answered,
        "accuracy": mass[:, 1].sum(axis=1) / answered,
        "mean_s": mean,
        "sd_s": np.sqrt(np.maximum(times @ grid.middles_s**2 - mean**2, 0.0)),
    }
