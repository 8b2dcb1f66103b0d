"""The noise of a decision at each reading: a multinomial logit of waiting and the alternatives.

At reading k channel i is ``(threshold_k - OUT_i) / scale`` past its threshold. It and waiting, at
0, get independent Gumbel noise, drawn anew at each reading; the highest wins. The probability that
channel i decides at reading k, given no earlier decision, is therefore

    h_i = exp(v_i) / (1 + sum_j exp(v_j)),    v_i = (threshold_k + bias_i - OUT_i) / scale

for any number of alternatives: the discrete-time hazard of competing risks (Allison 1982). For a
scale of 0 the channel that is furthest past its threshold decides. Noise that accumulates from one
reading to the next is no part of it.
"""

from __future__ import annotations

import math

import numpy as np

from bgmodel.support.compiling import compiled
from circuits.arrays import Array, Integers, Reals, Truths

NOTHING, FARTHEST = 1e-14, 9.0
"""Probability of no decision at which a trial ends, and distance of non-decision times from their
mean, in standard deviations, from which their density is 0."""
SQRT_2PI = float(np.sqrt(2 * np.pi))


@compiled
def decisions(
    out: Array, level: Array, scale: Array, offsets: Integers, ends: Truths
) -> tuple[Array, Array]:
    """Return the probability of a decision at each reading (readings, alternatives), and of none.

    Trials' readings follow one another from ``offsets`` on; hazards are means over the runs of
    ``out``; ``level`` (readings, alternatives) is the threshold with its bias, ``scale`` (trials,)
    the noise; ``ends`` (trials,) whether the last reading forces a response.
    """
    runs, readings, count = out.shape
    decided, left = np.zeros((readings, count)), np.ones(len(ends))
    hazard, past = np.zeros(count), np.zeros(count)
    for trial in range(len(ends)):
        for k in range(offsets[trial], offsets[trial + 1]):
            wait = not (ends[trial] and k == offsets[trial + 1] - 1)
            hazard[:] = 0.0
            for run in range(runs):
                top = 0.0 if wait else -np.inf
                for i in range(count):
                    past[i] = (level[k, i] - out[run, k, i]) / scale[trial]
                    top = max(top, past[i])
                total = np.exp(-top) if wait else 0.0
                for i in range(count):
                    past[i] = np.exp(past[i] - top)
                    total += past[i]
                for i in range(count):
                    hazard[i] += past[i] / total / runs
            stays = 1.0
            for i in range(count):
                decided[k, i] = left[trial] * hazard[i]
                stays -= hazard[i]
            left[trial] *= max(stays, 0.0)
            if left[trial] < NOTHING:
                break
    return decided, left


@compiled
def delayed(
    decided: Array, at_s: Array, rt_s: Array, offsets: Integers, t0_s: Array, sd_s: Array
) -> Array:
    """Return the density of each alternative at each response time, (trials, alternatives), 1/s."""
    trials, count = len(rt_s), decided.shape[1]
    density = np.zeros((trials, count))
    for trial in range(trials):
        for k in range(offsets[trial], offsets[trial + 1]):
            z = (rt_s[trial] - at_s[k] - t0_s[trial]) / sd_s[trial]
            if abs(z) < FARTHEST:
                late = np.exp(-0.5 * z * z) / (sd_s[trial] * SQRT_2PI)
                for i in range(count):
                    density[trial, i] += decided[k, i] * late
    return density


@compiled
def answered(
    decided: Array, at_s: Array, by_s: Array, offsets: Integers, t0_s: Array, sd_s: Array
) -> Array:
    """Return the probability of each response by ``by_s``, (trials, times, alternatives)."""
    (trials, times), count = by_s.shape, decided.shape[1]
    probability = np.zeros((trials, times, count))
    for trial in range(trials):
        for j in range(times):
            for k in range(offsets[trial], offsets[trial + 1]):
                z = (by_s[trial, j] - at_s[k] - t0_s[trial]) / sd_s[trial]
                if z < -FARTHEST:
                    break
                share = math.erfc(-z / np.sqrt(2.0)) / 2 if z < FARTHEST else 1.0
                for i in range(count):
                    probability[trial, j, i] += decided[k, i] * share
    return probability


@compiled
def lowest_between(out: Reals, time_s: Array, starts: Array, ends: Array, seen: Integers) -> Array:
    """Return the lowest OUT after each reading, until the next one; 0 beyond the last reading."""
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
