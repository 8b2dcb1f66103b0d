"""Staircases of stop-signal delays: one up after a successful stop, one down after a failed one.

The delay then settles where half of the stop trials have a response, whatever makes the responses,
which is where the consensus guide estimates best (Verbruggen et al. 2019). The outcome of every
trial at every delay is given as a table, so a staircase walks through the trials of a race, an
observer or a circuit alike, and the same trials can be walked through from several starts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.checks import reals
from circuits.errors import DataWarning, require


def walk(responded: npt.ArrayLike, delays_ms: npt.ArrayLike, starts_ms: npt.ArrayLike) -> Integers:
    """Return the delay of each stop trial, an index (trials,), under interleaved staircases.

    ``responded`` (delays, trials) are the outcomes at each of the increasing delays. Trial k
    belongs to staircase k modulo their number. A staircase moves one delay up after a successful
    stop and one down after a failed stop, and stays where there is no further delay. Warns if one
    never reverses: its delays then depend on where it started, and it estimates nothing.
    """
    table, delays, starts = _checked(responded, delays_ms, starts_ms)
    index = np.empty(table.shape[1], dtype=np.int64)
    for which, start in enumerate(starts):
        at = int(np.flatnonzero(delays == start)[0])
        of_staircase = np.arange(which, table.shape[1], len(starts))
        for trial in of_staircase:
            index[trial] = at
            at = min(max(at + (-1 if table[at, trial] else 1), 0), len(delays) - 1)
        _warn_unless_it_reverses(float(start), table[index[of_staircase], of_staircase])
    return index


def _checked(
    responded: npt.ArrayLike, delays_ms: npt.ArrayLike, starts_ms: npt.ArrayLike
) -> tuple[Truths, Array, Array]:
    """Return the arguments of ``walk`` as arrays; ValueError unless they fit together."""
    table = np.asarray(responded)
    delays = np.asarray(reals("delays_ms", delays_ms), dtype=np.float64)
    starts = np.atleast_1d(np.asarray(reals("starts_ms", starts_ms), dtype=np.float64))
    rising = delays.ndim == 1 and delays.size > 1 and (np.diff(delays) > 0).all()
    valid = rising and delays[0] >= 0 and np.isfinite(delays).all()
    require(valid, "delays_ms", "must be two or more increasing numbers >= 0", delays)
    must = f"must be True or False for each of {len(delays)} delays and each trial"
    fits = table.dtype == np.bool_ and table.ndim == 2 and len(table) == len(delays)
    require(fits, "responded", must, table)
    known = starts.ndim == 1 and starts.size and np.isin(starts, delays).all()
    require(known, "starts_ms", f"must be among the delays, {delays[0]:g} to {delays[-1]:g} ms in "
            "the given steps", starts)  # fmt: skip
    must = f"must be at most one per stop trial, {table.shape[1]}"
    require(starts.size <= table.shape[1], "starts_ms", must, starts)
    return table, delays, starts


def _warn_unless_it_reverses(start_ms: float, failed: Truths) -> None:
    """Warn if the outcomes of a staircase's trials are all the same."""
    if failed.all() or not failed.any():
        kind = "failed" if failed.all() else "successful"
        DataWarning.warn(
            f"the staircase that starts at {start_ms:g} ms never reverses: all of its "
            f"{len(failed)} stop trials are {kind} stops; change its start, its range or the model"
        )
