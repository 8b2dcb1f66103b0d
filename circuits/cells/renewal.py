"""Intervals of renewal cells, drawn one by one.

A renewal cell fires whenever the number of spikes expected so far, the integral of its rate, passes
the end of an interval; intervals are independent, and their mean is 1. Time is thus rescaled by the
rate: however that changes, the spikes are a renewal process in rescaled time, and the mean rate is
exact. Every interval is read from a table of quantiles by a random word.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import Cell
from circuits.errors import require

BINS = 1 << 12
"""Bins of equal probability of a table; the highest bits of a random word choose one."""
LOW_BITS = 20
"""The other bits of a word, which choose a place within the bin."""
TAIL = 64
"""Points at which the longest intervals are averaged."""
MEAN_WITHIN = 1e-3
"""How close to 1 the mean of a cell's own quantiles must be."""


@lru_cache(maxsize=64)
def intervals(cell: Cell) -> Array:
    """Return the ends of bins of equal probability of a cell's intervals, (BINS + 1,).

    Within a bin all intervals are equally likely. The first bin begins at the quantile of a quarter
    of its probability, so that its mean is about right, and the last ends where the mean of all
    intervals is 1: the coefficient of variation of ``Phase`` is then exact to 0.05 %. The ends are
    rounded to single precision, which halves the table of the compiled engine.

    Raises
    ------
    ValueError
        If the cell's quantiles are not finite, fall, are below 0, or do not leave a mean of 1.
    """
    ends = np.empty(BINS + 1)
    ends[:-1] = cell.interval_quantiles(np.concatenate([[0.25], np.arange(1, BINS)]) / BINS)
    ends[-1] = 2 * (BINS - (ends[:-2].sum() + ends[1:-1].sum()) / 2) - ends[-2]
    owner = f"{cell.kind}.interval_quantiles"
    ends = ends.astype(np.float32).astype(np.float64)
    rising = np.isfinite(ends).all() and ends[0] >= 0 and (np.diff(ends) >= 0).all()
    # Otherwise the last bin would be stretched until it made up for any mean below 1.
    longest = cell.interval_quantiles(1 - (np.arange(TAIL) + 0.5) / TAIL / BINS).mean()
    mean = 1 + (longest - ends[-2:].mean()) / BINS
    must = "must be finite, must not fall or be below 0, and must be of intervals whose mean is 1"
    good = bool(rising) and abs(mean - 1) < MEAN_WITHIN
    require(good, "quantiles", must, ends, owner=owner)
    return ends


@lru_cache(maxsize=64)
def first_spikes(cell: Cell) -> Array:
    """Return the ends of bins of equal probability of the wait for the first spike, (BINS + 1,).

    The cell has always been firing, so that rates and irregularity are stationary from the start:
    the density of a wait is the probability of longer intervals (Cox 1962).
    """
    ends = intervals(cell)
    longer = 1 - (np.arange(BINS) + 0.5) / BINS
    # The density is constant up to the shortest interval.
    passed = ends[0] + np.concatenate([[0.0], np.cumsum(np.diff(ends) * longer)])
    shares = np.concatenate([[0.0], passed / passed[-1]])
    waits = np.interp(np.arange(BINS + 1) / BINS, shares, np.concatenate([[0.0], ends]))
    return np.asarray(waits, dtype=np.float32).astype(np.float64)


def wait(table: Array, words: Any) -> Array:
    """Return an interval, or a wait for the first spike, for each 32-bit word, from its table."""
    word = np.asarray(words, dtype=np.uint32)
    index = (word >> np.uint32(LOW_BITS)).astype(np.intp)
    share = (word & np.uint32((1 << LOW_BITS) - 1)) / 2.0**LOW_BITS
    low = table[index]
    return np.asarray(low + (table[index + 1] - low) * share)
