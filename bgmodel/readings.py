"""Doubts about log-likelihoods: numbers that are likely to be something else."""

from __future__ import annotations

import numpy as np

from bgmodel.support.arrays import Integers, Reals, Truths
from circuits.errors import DataWarning

MOST_TRIALS = 1000
"""Trials that are looked at: enough to tell, and quick."""
FEWEST_READINGS = 100
"""Number of readings below which there is no warning."""
SHORTEST = 10
"""Readings of the shortest trial whose serial correlation tells: in shorter ones it is low even for
running sums."""
MANY = 20
"""Hypotheses from which on more of them than readings are doubted: tasks have fewer."""
CORRELATED = 0.5
"""Serial correlation from which a warning is given; running sums over 10 readings have 0.6, over 20
0.8, and independent readings about 0."""


def warn_of_readings(log_likelihood: Reals, lengths: Integers | None = None) -> None:
    """Warn if values look like probabilities or running sums, or axes as if they were exchanged.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses)
        What each reading says, nats.
    lengths : array (trials,), int, optional
        Number of readings of each trial; all of them if left out.

    Warns
    -----
    UserWarning
        If all values lie between 0 and 1, if successive readings of a trial correlate, or if there
        are more hypotheses than readings, and many.
    """
    _, steps, hypotheses = log_likelihood.shape
    if hypotheses >= MANY and hypotheses > steps:
        DataWarning.warn(
            f"{hypotheses} hypotheses and {steps} readings: are the axes exchanged? They are "
            "(trials, readings, hypotheses)"
        )
    values = log_likelihood[:MOST_TRIALS]
    read = np.ones(values.shape[:2], bool)
    if lengths is not None:
        read = np.arange(values.shape[1]) < lengths[:MOST_TRIALS, None]
    if read.sum() < FEWEST_READINGS:
        return
    told = values[read]
    if told.min() > 0 and told.max() < 1 and np.ptp(told) > 0:
        DataWarning.warn(
            "all log-likelihoods lie between 0 and 1, as probabilities do: give their natural "
            "logarithms"
        )
    r = serial_correlation(values, read)
    if r > CORRELATED:
        DataWarning.warn(
            f"successive readings of a trial correlate (r = {r:.2f}), but they are added up as "
            "independent: if these are running sums or posteriors, give the log-likelihood of "
            "each reading alone"
        )


def warn_of_copies(log_likelihood: Reals, lengths: Integers) -> None:
    """Warn if trials hold the very readings of other ones: together they tell no more than one.

    Trials of fewer than ``SHORTEST`` readings, and those that repeat a reading, may be alike by
    chance: they do not count.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses)
        What each reading says, nats.
    lengths : array (trials,), int
        Number of readings of each trial.
    """
    seen: set[bytes] = set()
    copies = 0
    for values, length in zip(log_likelihood, lengths, strict=True):
        key = values[:length].tobytes()
        copies += key in seen and SHORTEST <= length == len(np.unique(values[:length, 0]))
        seen.add(key)
    if copies:
        DataWarning.warn(
            f"{copies} of {len(lengths)} trials hold the very readings of an earlier trial: "
            "intervals count them as new; keep one of each"
        )


def serial_correlation(values: Reals, read: Truths) -> float:
    """Return the correlation of successive readings within a trial; 0 if it is not known.

    Parameters
    ----------
    values : array (trials, steps, hypotheses)
        What each reading says, nats. What the hypotheses of a reading share does not count.
    read : bool array (trials, steps)
        Whether the trial has this reading. Trials of fewer than ``SHORTEST`` do not count.
    """
    long = read.sum(axis=1) >= SHORTEST
    values, read = values[long].astype(np.float64), read[long]
    between = values - values.mean(axis=2, keepdims=True)
    mean = (between * read[:, :, None]).sum(axis=1) / read.sum(axis=1)[:, None]
    deviation = (between - mean[:, None]) * read[:, :, None]
    variance = (deviation**2).sum()
    # Rounding alone is no variance.
    if not variance > 1e-12 * (between**2).sum():
        return 0.0
    return float((deviation[:, 1:] * deviation[:, :-1]).sum() / variance)
