"""Plausibility checks of log-likelihoods."""

from __future__ import annotations

import numpy as np

from bgmodel.support.arrays import Integers, Reals, Truths
from circuits.errors import DataWarning

MOST_TRIALS = 1000
"""Number of trials examined: sufficient, and quick."""
FEWEST_READINGS = 100
"""Number of readings below which there is no warning."""
SHORTEST = 10
"""Least number of readings of the shortest trial for its serial correlation to count: in shorter
trials it is low even for running sums."""
MANY = 20
"""From this number of hypotheses on, having more of them than readings is doubtful."""
CORRELATED = 0.5
"""Serial correlation from which a warning is given; running sums over 10 readings have 0.6, over 20
0.8, and independent readings about 0."""


def warn_of_readings(log_likelihood: Reals, lengths: Integers | None = None) -> None:
    """Warn if values look like probabilities or running sums, or if axes seem to be exchanged.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses)
        Log-likelihoods of each reading, nats.
    lengths : array (trials,), int, optional
        Number of readings of each trial; all of them by default.

    Warns
    -----
    UserWarning
        If all values lie between 0 and 1, if successive readings of a trial correlate, or if there
        are many hypotheses, and more than readings.
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
    """Warn if trials have exactly the readings of others, and so add no information.

    Trials of fewer than ``SHORTEST`` readings, and those that repeat a reading, may be equal by
    chance and do not count.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses)
        Log-likelihoods of each reading, nats.
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
            f"{copies} of {len(lengths)} trials have exactly the readings of an earlier trial: "
            "intervals count them as independent; keep one of each"
        )


def serial_correlation(values: Reals, read: Truths) -> float:
    """Return the correlation of successive readings within a trial; 0 if unknown.

    Parameters
    ----------
    values : array (trials, steps, hypotheses)
        Log-likelihoods, nats. The part common to the hypotheses of a reading is ignored.
    read : bool array (trials, steps)
        Whether the trial has this reading. Trials with fewer than ``SHORTEST`` are ignored.
    """
    long = read.sum(axis=1) >= SHORTEST
    values, read = values[long].astype(np.float64), read[long]
    between = values - values.mean(axis=2, keepdims=True)
    mean = (between * read[:, :, None]).sum(axis=1) / read.sum(axis=1)[:, None]
    deviation = (between - mean[:, None]) * read[:, :, None]
    variance = (deviation**2).sum()
    # Rounding error does not count as variance.
    if not variance > 1e-12 * (between**2).sum():
        return 0.0
    return float((deviation[:, 1:] * deviation[:, :-1]).sum() / variance)
