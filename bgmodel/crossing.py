"""The compiled inner loops of the stopping rule and of the SPRT's sum."""

import numpy as np
from numba import njit

# Sums of readings that differ by less are equal, as in ``theory``: 0.1 + 0.2 reaches 0.3.
ROUNDING = 1e-10


@njit(cache=True, nogil=True, inline="always")
def _lowest(row):
    """Return the index of the lowest output, the first of those that are equal."""
    best = 0
    for i in range(1, row.shape[0]):
        if row[i] < row[best] - ROUNDING:
            best = i
    return best


@njit(cache=True, nogil=True, inline="always")
def cross_trial(out, first, order, level, tick, choice, margin, pointer):
    """Fill ``tick`` and ``choice`` (K,) for one trial; a tick of -1 means never crossed.

    A channel's thresholds are met from the highest down, so one pointer a channel that moves at
    new record lows serves all of them.
    """
    ticks, channels = out.shape
    count = tick.shape[0]
    tick[:] = -1
    pointer[:] = 0
    open_ = count
    for t in range(ticks):
        for i in range(channels):
            value = out[t, i]
            p = pointer[i]
            slack = ROUNDING if t >= first else -ROUNDING
            while p < count and value <= level[i, p] + slack:
                k = order[i, p]
                below = level[i, p] - value
                if tick[k] < 0:
                    tick[k] = t
                    choice[k] = i
                    margin[k] = below
                    open_ -= 1
                elif tick[k] == t and below > margin[k] + ROUNDING:
                    choice[k] = i
                    margin[k] = below
                p += 1
            pointer[i] = p
        if open_ == 0:
            break
    if open_ > 0:
        lowest = _lowest(out[ticks - 1])
        for k in range(count):
            if tick[k] < 0:
                choice[k] = lowest


@njit(cache=True, nogil=True)
def cross_all(out, first, order, level):
    """Return tick and choice (trials, K); tick -1 where the deadline was reached."""
    trials, count = out.shape[0], order.shape[1]
    tick = np.empty((trials, count), np.int32)
    choice = np.empty((trials, count), np.int16)
    margin = np.empty(count)
    pointer = np.empty(out.shape[2], np.int64)
    for n in range(trials):
        cross_trial(out[n], first, order, level, tick[n], choice[n], margin, pointer)
    return tick, choice


@njit(cache=True, nogil=True)
def tally_all(out, truth, first, level, steps_at):
    """Return correct, steps and forced (K,), each summed over trials; thresholds from the highest.

    The lowest channel of a tick then decides for every threshold met at that tick, a run of
    neighbours, so sums are kept as differences between neighbours: a few operations a tick.
    """
    trials, ticks = out.shape[:2]
    count = level.shape[0]
    correct = np.zeros(count + 1, np.int64)
    steps = np.zeros(count + 1)
    forced = 0 * correct
    for n in range(trials):
        p = 0  # thresholds before p are met
        for t in range(ticks):
            winner = _lowest(out[n, t])
            slack = ROUNDING if t >= first else -ROUNDING
            lowest = out[n, t, winner] - slack
            end = p
            while end < count and lowest <= level[end]:
                end += 1
            if t == ticks - 1:  # the deadline: what is still open is forced
                forced[end] += 1
                end = count
            if end > p:
                correct[p] += winner == truth[n]
                correct[end] -= winner == truth[n]
                steps[p] += steps_at[t]
                steps[end] -= steps_at[t]
                p = end
                if p == count:
                    break
    return np.cumsum(correct)[:count], np.cumsum(steps)[:count], np.cumsum(forced)[:count]


@njit(cache=True, nogil=True)
def log_odds(log_likelihood, start, out):
    """Fill ``out`` (trials, 1 + steps, 2) with Z and -Z: Z_0 = start, then summed log ratios."""
    for n in range(log_likelihood.shape[0]):
        z = start
        out[n, 0, 0] = z
        out[n, 0, 1] = -z
        for t in range(log_likelihood.shape[1]):
            z += np.float64(log_likelihood[n, t, 1]) - np.float64(log_likelihood[n, t, 0])
            out[n, t + 1, 0] = z
            out[n, t + 1, 1] = -z


@njit(cache=True, nogil=True)
def cross_each(out, first, levels):
    """Return tick and choice (trials,) where trial n has the threshold ``levels[n]``."""
    trials, _, channels = out.shape
    tick = np.empty((trials, 1), np.int32)
    choice = np.empty((trials, 1), np.int16)
    margin = np.empty(1)
    pointer = np.empty(channels, np.int64)
    order = np.zeros((channels, 1), np.int64)
    level = np.empty((channels, 1))
    for n in range(trials):
        level[:] = levels[n]
        cross_trial(out[n], first, order, level, tick[n], choice[n], margin, pointer)
    return tick[:, 0], choice[:, 0]
