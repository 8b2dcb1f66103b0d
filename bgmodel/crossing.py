"""The compiled inner loop of the stopping rule; ``decision`` is its only caller."""

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
