"""Plausibility checks of log-likelihoods, and of the other inputs of a circuit."""

from __future__ import annotations

import numpy as np

from circuits.arrays import Array, Integers, Reals, Truths
from circuits.errors import ConfoundWarning, DataWarning

MOST_TRIALS = 200
"""Number of trials examined: sufficient, and quick."""
FEWEST_READINGS = 100
"""Number of readings below which there is no warning."""
SHORTEST = 10
"""Least number of readings of the shortest trial for its serial correlation to count: in shorter
trials it is low even for running sums."""
MANY = 20
"""From this number of hypotheses on, having more of them than readings is doubtful."""
PADDED = 20
"""Least number of readings without information, all at the ends of trials, to suspect padding."""
SUMS = 0.4
"""Serial correlation, corrected for the length of trials, from which a session warns: of 100 single
readings it has a standard deviation of 0.1 about 0."""
CHANCE = 1e-4
"""Probability below which an input that comes with some truths only is no coincidence."""
CORRELATED = 0.5
"""Serial correlation from which a warning is given; running sums over 10 readings have 0.6, over 20
0.8, and independent readings about 0."""


def warn_of_readings(log_likelihood: Reals, lengths: Integers | None = None) -> None:
    """Warn if values look like probabilities or running sums, or if axes seem to be exchanged.

    That is, if all values, (trials, steps, hypotheses) nats, lie between 0 and 1, successive
    readings correlate, trials seem to be padded, two hypotheses have the same readings, or
    hypotheses are many, and more than readings.
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
    if read.all():
        _warn_of_padding(values)
    told = values if read.all() else values[read]
    if told.min() > 0 and told.max() < 1 and np.ptp(told) > 0:
        DataWarning.warn(
            "all log-likelihoods lie between 0 and 1, as probabilities do: give their natural "
            "logarithms"
        )
    columns = [column.tobytes() for column in np.moveaxis(told, -1, 0)]
    copied = [k for k, column in enumerate(columns) if column in columns[:k]]
    # Few different values, as of designed trials, may be equal on purpose.
    if copied and len(np.unique(told[..., copied[0]])) > told[..., 0].size / 2:
        DataWarning.warn(
            f"hypotheses {columns.index(columns[copied[0]])} and {copied[0]} have the same "
            "log-likelihoods in all readings, so that neither can win over the other: is one "
            "column a copy of the other?"
        )
    r = serial_correlation(values, read)
    if r > CORRELATED:
        DataWarning.warn(
            f"successive readings of a trial correlate (r = {r:.2f}), but they are added up as "
            "independent: if these are running sums or posteriors, give the log-likelihood of "
            "each reading alone"
        )


def _warn_of_padding(values: Reals) -> None:
    """Warn if trials, (trials, steps, hypotheses), seem to be padded to one length.

    This is the case if readings that are the same for all hypotheses occur at the ends of trials
    only, and not equally many in each. Trials without any other reading do not count.
    """
    # Hypothesis by hypothesis: NumPy is slow along axes of few elements.
    empty = np.ones(values.shape[:2], bool)
    for k in range(1, values.shape[2]):
        empty &= values[:, :, k] == values[:, :, 0]
    empty = empty[~empty.all(axis=1)]
    ends = empty[:, ::-1].cumprod(axis=1).sum(axis=1)
    if empty.sum() == ends.sum() >= PADDED and np.ptp(ends) > 0:
        DataWarning.warn(
            f"{(ends > 0).sum()} of {len(values)} trials end in readings, {ends.max()} at most, "
            "that are the same for all hypotheses, and there are none of these before: if trials "
            "are padded to one length, give the number of readings of each (lengths; in a table, "
            "leave these rows out). Otherwise undecided trials wait until the end of the longest"
        )


def warn_of_confounds(inputs: Array, truth: Integers) -> None:
    """Warn if an input, (trials, times, inputs), comes in none or all of the trials with one truth.

    The warning requires this to be less probable than ``CHANCE`` for an input independent of truth.
    """
    trials, times, columns = inputs.shape
    names, hypothesis = np.unique(truth, return_inverse=True)
    for column in range(columns):
        # Equal courses have equal sums: times count more the later they are.
        sums = (inputs[:, :, column] * np.arange(1, times + 1)).sum(axis=1)
        courses, course = np.unique(sums, return_inverse=True)
        counts = np.zeros((len(courses), len(names)), dtype=np.intp)
        np.add.at(counts, (course, hypothesis), 1)
        log_p = _log_chances(counts) + np.log(len(courses))
        with_it = counts[np.argmin(log_p)]
        truths = names[(with_it == 0) | (with_it == counts.sum(axis=0))].tolist()
        if log_p.min() < np.log(CHANCE):
            ConfoundWarning.warn(
                f"input {column} of inputs_nats depends on the truth: {with_it.sum()} of {trials} "
                f"trials have the same course of it, either all or none of those with truth "
                f"{', '.join(map(str, truths))}, so that its effect cannot be told from that of "
                "the evidence: draw the trials that receive it at random",
                input=column,
                truths=tuple(truths),
            )


def _log_chances(counts: Integers) -> Array:
    """Return the log probability that as many trials include all or none of these truths.

    ``counts`` (courses, truths) are numbers of trials. L trials are any L of n: those with some
    truths are all among them (``every`` trials), and none with others, M together, with a
    probability of ``C(n - M, L - every) / C(n, L)``. Each truth may be either, or neither.
    """
    same, each, trials = counts.sum(axis=1), counts.sum(axis=0), int(counts.sum())
    logs = np.append(0.0, np.cumsum(np.log(np.arange(1, trials + 1))))
    every, none = (counts == each) * each, (counts == 0) * each
    left, chosen = trials - (every + none).sum(axis=1), same - every.sum(axis=1)
    ways = logs[left] - logs[chosen] - logs[left - chosen]
    ways -= logs[trials] - logs[same] - logs[trials - same]
    return np.asarray(ways + counts.shape[1] * np.log(3))


def products(readings: Reals) -> Array:
    """Return the sums over one trial, (steps, hypotheses), that give a serial correlation, (3,).

    They are the products of successive deviations from the mean over the trial, corrected for that
    of independent readings, ``-1 / steps`` of the squares; the squares; and the number of readings.
    """
    between = readings - readings.mean(axis=1, keepdims=True)
    deviation = between - between.mean(axis=0)
    squares = (deviation**2).sum()
    lagged = (deviation[1:] * deviation[:-1]).sum()
    return np.array([lagged + squares / len(readings), squares, len(readings)])


def are_sums(pooled: Array) -> bool:
    """Whether readings look like running sums, from their ``products`` over some trials."""
    lagged, squares, count = pooled
    return bool(count >= FEWEST_READINGS and lagged > SUMS * squares)


def warn_of_copies(log_likelihood: Reals, lengths: Integers) -> None:
    """Warn if trials have exactly the readings of others, and so add no information.

    Trials of fewer than ``SHORTEST`` readings, and those that repeat a reading, may be equal by
    chance and do not count.
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

    The part of the values, (trials, steps, hypotheses), that is common to the hypotheses is
    ignored, and so are trials with fewer than ``SHORTEST`` readings.
    """
    long = read.sum(axis=1) >= SHORTEST
    values, read = values[long].astype(np.float64), read[long]
    common = sum(np.moveaxis(values, 2, 0)) / values.shape[2]
    counts = read.sum(axis=1)[:, None]
    variance = squares = products = 0.0
    # Hypothesis by hypothesis: NumPy is slow along axes of few elements.
    for k in range(values.shape[2]):
        between = values[:, :, k] - common
        deviation = between - (between * read).sum(axis=1, keepdims=True) / counts
        deviation *= read
        squares += (between**2).sum()
        variance += (deviation**2).sum()
        products += (deviation[:, 1:] * deviation[:, :-1]).sum()
    # Rounding error does not count as variance.
    return float(products / variance) if variance > 1e-12 * squares else 0.0
