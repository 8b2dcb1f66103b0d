"""The compiled inner loops of the stopping rule and of the SPRT's sum."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bgmodel.support.compiling import compiled, inlined
from circuits.arrays import Array, Integers, Reals

# Sums of readings that differ by less count as equal, as in ``first_passage``: 0.1 + 0.2 is 0.3.
ROUNDING = 1e-10
CELLS = 4096
"""Number of cells of |Z| up to the highest bar, the lookup table of ``tally_odds``."""


@inlined
def _replaces(number: int, equal: int) -> bool:
    """Whether, in trial ``number``, the last of ``equal`` tied channels replaces the current one.

    True with probability 1 / equal, so that each tied channel is equally likely to be chosen
    (reservoir sampling); the draw is a hash (SplitMix64, Steele, Lea & Flood 2014).
    """
    z = np.uint64(number) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(equal)
    for _ in range(2):  # after one round, hashes of neighbouring numbers are similar
        z += np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return bool(((z >> np.uint64(32)) * np.uint64(equal)) >> np.uint64(32) == 0)


@compiled
def lowest(row: Reals, number: int) -> int:
    """Return the index of the lowest output; ties are broken by the trial's ``number``."""
    best, equal = 0, 1
    for i in range(1, row.shape[0]):
        if row[i] < row[best] - ROUNDING:
            best, equal = i, 1
        elif row[i] <= row[best] + ROUNDING:
            equal += 1
            if _replaces(number, equal):
                best = i
    return best


@inlined
def _compete(
    i: int, below: float, number: int, k: int, choice: Integers, margin: Array, equal: Integers
) -> None:
    """Make channel i, ``below`` threshold k, its choice unless another is further below."""
    if below > margin[k] + ROUNDING:
        choice[k], margin[k], equal[k] = i, below, 1
    elif below >= margin[k] - ROUNDING:
        equal[k] += 1
        if _replaces(number, equal[k]):
            choice[k], margin[k] = i, below


@inlined
def _first_below(out: Reals, level: Array) -> int:
    """Return the first tick at which a channel may meet its highest threshold."""
    ticks, channels = out.shape
    for t in range(ticks):
        for i in range(channels):
            if out[t, i] <= level[i, 0] + ROUNDING:
                return t
    return int(ticks)


@inlined
def cross_trial(
    out: Reals, first: int, order: Integers, level: Array, number: int, tick: Integers,
    choice: Integers, margin: Array, equal: Integers, pointer: Integers,
) -> None:  # fmt: skip
    """Fill ``tick`` and ``choice`` (K,) for one trial; a tick of -1 means never crossed.

    A channel meets its thresholds from the highest down, so one pointer per channel, which moves at
    each new record low, serves all of them.
    """
    ticks, channels = out.shape
    count = tick.shape[0]
    tick[:] = -1
    pointer[:] = 0
    open_ = count
    for t in range(_first_below(out, level), ticks):
        for i in range(channels):
            value = out[t, i]
            p = pointer[i]
            slack = ROUNDING if t >= first else -ROUNDING
            while p < count and value <= level[i, p] + slack:
                k = order[i, p]
                if tick[k] < 0:
                    tick[k], choice[k], margin[k], equal[k] = t, i, level[i, p] - value, 1
                    open_ -= 1
                elif tick[k] == t:
                    _compete(i, level[i, p] - value, number, k, choice, margin, equal)
                p += 1
            pointer[i] = p
        if open_ == 0:
            break
    if open_ > 0:
        last = lowest(out[ticks - 1], number)
        for k in range(count):
            if tick[k] < 0:
                choice[k] = last


@compiled
def cross_all(
    out: Reals, first: int, order: Integers, level: Array, ends: Integers, numbers: Integers
) -> tuple[Integers, Integers]:
    """Return tick and choice (trials, K); tick -1 if no threshold was met by the trial's end."""
    trials, count = out.shape[0], order.shape[1]
    tick = np.empty((trials, count), np.int32)
    choice = np.empty((trials, count), np.int16)
    margin = np.empty(count)
    equal = np.empty(count, np.int64)
    pointer = np.empty(out.shape[2], np.int64)
    for n in range(trials):
        cross_trial(
            out[n, : ends[n]], first, order, level, numbers[n], tick[n], choice[n], margin, equal,
            pointer,
        )  # fmt: skip
    return tick, choice


@inlined
def _first_bars(bars: Array, cells: int) -> tuple[float, Integers]:
    """Return the cells per nat, and for each cell of |Z| the number of bars certainly reached."""
    count = bars.shape[0] - 1
    scale = cells / bars[count - 1] if count > 0 and bars[count - 1] > ROUNDING else 0.0
    first = np.zeros(cells + 1, np.int64)
    for cell in range(2, cells + 1):
        k = first[cell - 1]
        while k < count and bars[k] * scale <= cell - 1:
            k += 1
        first[cell] = k
    return scale, first


@compiled
def tally_odds(
    log_likelihood: Reals, start: float, truth: Integers, bars: Array, readings: Integers,
    numbers: Integers,
) -> tuple[npt.NDArray[np.int64], Array, npt.NDArray[np.int64]]:  # fmt: skip
    """Return correct, steps and forced (K,) of the SPRT, each summed over trials.

    Bars on |Z| rise, the last is inf. A reading counts for the bars not reached before it. For
    these, a choice is correct if the changes of "the truth leads" sum to 1. Both are stored at the
    first such bar and summed at the end, so the cost does not depend on how many bars a reading
    reaches.
    """
    count = bars.shape[0] - 1
    correct = np.zeros(count + 1, np.int64)
    steps, forced = 0 * correct, 0 * correct
    row = np.empty(2)
    scale, first = _first_bars(bars, CELLS)
    for n in range(log_likelihood.shape[0]):
        z, p, last, led = start, 0, readings[n], 0
        for t in range(last + 1):
            if t > 0:
                reading = log_likelihood[n, t - 1]
                z += np.float64(reading[1]) - np.float64(reading[0])
                steps[p] += 1
            leads = int(z > 0)
            if abs(z) <= ROUNDING:
                row[0], row[1] = z, -z
                leads = lowest(row, numbers[n])
            right = int(leads == truth[n])
            correct[p] += right - led
            led = right
            # Before any reading a bar must be exceeded; later, equality is enough.
            above = abs(z) + (ROUNDING if t > 0 else -ROUNDING)
            p = max(p, first[int(min(max(above, 0.0) * scale, CELLS))])
            while above >= bars[p]:
                p += 1
            if p == count:
                break
        if p < count:  # deadline: trials still undecided are forced
            forced[p] += 1
    taken = np.cumsum(steps)[:count].astype(np.float64)
    return np.cumsum(correct)[:count], taken, np.cumsum(forced)[:count]


@compiled
def log_odds(log_likelihood: Reals, start: float, out: Array) -> None:
    """Fill ``out`` (trials, 1 + steps, 2) with Z and -Z: Z_0 = start, then summed log ratios."""
    for n in range(log_likelihood.shape[0]):
        z = start
        out[n, 0, 0] = z
        out[n, 0, 1] = -z
        for t in range(log_likelihood.shape[1]):
            z += np.float64(log_likelihood[n, t, 1]) - np.float64(log_likelihood[n, t, 0])
            out[n, t + 1, 0] = z
            out[n, t + 1, 1] = -z


@compiled
def cross_each(
    out: Reals, first: int, levels: Array, ends: Integers, numbers: Integers
) -> tuple[Integers, Integers]:
    """Return tick and choice (trials,); trial n has the threshold ``levels[n]``."""
    trials, _, channels = out.shape
    tick = np.empty((trials, 1), np.int32)
    choice = np.empty((trials, 1), np.int16)
    margin = np.empty(1)
    equal = np.empty(1, np.int64)
    pointer = np.empty(channels, np.int64)
    order = np.zeros((channels, 1), np.int64)
    level = np.empty((channels, 1))
    for n in range(trials):
        level[:] = levels[n]
        cross_trial(
            out[n, : ends[n]], first, order, level, numbers[n], tick[n], choice[n], margin, equal,
            pointer,
        )  # fmt: skip
    return tick[:, 0], choice[:, 0]
