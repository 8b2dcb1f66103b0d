"""The compiled loop over samples of a circuit's OUT between readings."""

from __future__ import annotations

import numpy as np

from bgmodel.support.arrays import Array, Integers, Reals
from bgmodel.support.compiling import compiled


@compiled
def lowest_between(out: Reals, time_s: Array, starts: Array, ends: Array, seen: Integers) -> Array:
    """Return the lowest OUT after each reading, until the next one.

    Parameters
    ----------
    out : array (trials, ticks, alternatives)
        Samples of OUT.
    time_s : array (ticks,), s
        Their times.
    starts, ends : array (trials, readings), s
        When each reading comes, and the next one.
    seen : int array (trials,)
        Number of readings of each trial.

    Returns
    -------
    array (trials, readings, alternatives)
        0 beyond the last reading.
    """
    trials, ticks, count = out.shape
    lowest = np.zeros((trials, starts.shape[1], count))
    for trial in range(trials):
        tick = 0
        for k in range(seen[trial]):
            while tick < ticks - 1 and time_s[tick] < starts[trial, k] - 1e-9:
                tick += 1
            for i in range(count):
                lowest[trial, k, i] = out[trial, tick, i]
            while tick < ticks and time_s[tick] < ends[trial, k] - 1e-9:
                for i in range(count):
                    lowest[trial, k, i] = min(lowest[trial, k, i], out[trial, tick, i])
                tick += 1
            tick = min(tick, ticks - 1)
    return lowest
