"""The compiled inner loops of the stopping rule and of the SPRT's sum."""

import numpy as np
from numba import njit


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
            while p < count and (value < level[i, p] or (t >= first and value == level[i, p])):
                k = order[i, p]
                below = level[i, p] - value
                if tick[k] < 0:
                    tick[k] = t
                    choice[k] = i
                    margin[k] = below
                    open_ -= 1
                elif tick[k] == t and below > margin[k]:
                    choice[k] = i
                    margin[k] = below
                p += 1
            pointer[i] = p
        if open_ == 0:
            break
    if open_ > 0:
        lowest = np.argmin(out[ticks - 1])
        for k in range(count):
            if tick[k] < 0:
                choice[k] = lowest


@njit(cache=True, nogil=True)
def cross_all(out, first, order, level):
    """Return tick and choice (trials, K); tick -1 where the deadline was reached."""
    trials, count = out.shape[0], order.shape[1]
    tick = np.empty((trials, count), np.int32)
    choice = np.empty((trials, count), np.int8)
    margin = np.empty(count)
    pointer = np.empty(out.shape[2], np.int64)
    for n in range(trials):
        cross_trial(out[n], first, order, level, tick[n], choice[n], margin, pointer)
    return tick, choice


@njit(cache=True, nogil=True)
def tally_common(out, truth, first, level, steps_at):
    """Return what ``tally_all`` does where all channels share thresholds, sorted from the highest.

    The lowest channel of a tick then decides for every threshold met at that tick, a run of
    neighbours, so sums are kept as differences between neighbours: a few operations a tick.
    """
    trials, ticks, channels = out.shape
    count = level.shape[0]
    correct = np.zeros(count + 1, np.int64)
    steps = np.zeros(count + 1)
    forced = 0 * correct
    for n in range(trials):
        p = 0  # thresholds before p are met
        for t in range(ticks):
            winner = np.argmin(out[n, t]) if channels > 2 else int(out[n, t, 1] < out[n, t, 0])
            lowest = out[n, t, winner]
            end = p
            while end < count and (lowest < level[end] or (t >= first and lowest == level[end])):
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
            z += log_likelihood[n, t, 1] - log_likelihood[n, t, 0]
            out[n, t + 1, 0] = z
            out[n, t + 1, 1] = -z


@njit(cache=True, nogil=True)
def tally_all(out, truth, first, order, level, steps_at):
    """Return correct, steps and forced, each summed over trials, (K,)."""
    trials, count = out.shape[0], order.shape[1]
    correct = np.zeros(count, np.int64)
    steps = np.zeros(count)
    forced = np.zeros(count, np.int64)
    tick = np.empty(count, np.int32)
    choice = np.empty(count, np.int8)
    margin = np.empty(count)
    pointer = np.empty(out.shape[2], np.int64)
    for n in range(trials):
        cross_trial(out[n], first, order, level, tick, choice, margin, pointer)
        for k in range(count):
            correct[k] += choice[k] == truth[n]
            forced[k] += tick[k] < 0
            # A tick of -1 indexes the last tick: the deadline.
            steps[k] += steps_at[tick[k]]
    return correct, steps, forced


@njit(cache=True, nogil=True)
def cross_each(out, first, levels):
    """Return tick and choice (trials,) where trial n has the threshold ``levels[n]``."""
    trials, _, channels = out.shape
    tick = np.empty((trials, 1), np.int32)
    choice = np.empty((trials, 1), np.int8)
    margin = np.empty(1)
    pointer = np.empty(channels, np.int64)
    order = np.zeros((channels, 1), np.int64)
    level = np.empty((channels, 1))
    for n in range(trials):
        level[:] = levels[n]
        cross_trial(out[n], first, order, level, tick[n], choice[n], margin, pointer)
    return tick[:, 0], choice[:, 0]
