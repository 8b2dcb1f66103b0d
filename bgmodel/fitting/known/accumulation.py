"""What a model makes of the readings so far: sums that leak, and runs of equal cues."""

from __future__ import annotations

import numpy as np

from bgmodel.support.arrays import Array


def leaky_sums(log_likelihood: Array, time_s: Array, leak_hz: float = 0.0) -> Array:
    """Return sums of readings after each reading, (trials, readings, alternatives) nats.

    The sum falls by ``exp(-leak_hz dt)`` in the time dt since the reading before; without a leak
    it is the running sum.

    Parameters
    ----------
    log_likelihood : array (trials, readings, alternatives), nats
        The readings.
    time_s : array (trials, readings), s
        Their times; infinite after the last one.
    leak_hz : float, 1/s
        Rate of the leak.
    """
    if leak_hz == 0:
        return np.cumsum(log_likelihood, axis=1)
    known = np.where(np.isfinite(time_s), time_s, 0.0)
    kept = np.exp(-leak_hz * np.maximum(np.diff(known, axis=1, prepend=0.0), 0.0))
    sums = np.empty_like(log_likelihood)
    total = np.zeros(log_likelihood[:, 0].shape)
    for k in range(log_likelihood.shape[1]):
        total = total * kept[:, k, None] + log_likelihood[:, k]
        sums[:, k] = total
    return sums


def runs_of_cues(log_likelihood: Array) -> Array:
    """Return the number of readings in a row, up to each, that favour each alternative.

    A reading favours the alternative under which it is most likely; a tie ends every run.

    Parameters
    ----------
    log_likelihood : array (trials, readings, alternatives), nats
        The readings.

    Returns
    -------
    array (trials, readings, alternatives)
    """
    ordered = np.sort(log_likelihood, axis=2)
    clear = ordered[:, :, -1] > ordered[:, :, -2]
    favoured = (log_likelihood == ordered[:, :, -1:]) & clear[:, :, None]
    runs = np.zeros(log_likelihood.shape)
    length = np.zeros(log_likelihood[:, 0].shape)
    for k in range(log_likelihood.shape[1]):
        length = np.where(favoured[:, k], length + 1, 0.0)
        runs[:, k] = length
    return runs
