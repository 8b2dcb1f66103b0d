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

import numpy as np

from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.compiling import compiled

NOTHING = 1e-14
"""A trial ends once the probability of no decision is below this."""


@compiled
def decisions(
    out: Array, threshold: Array, bias: Array, scale: float, seen: Integers, ends: Truths
) -> tuple[Array, Array]:
    """Return the probability of a decision at each reading, and of none.

    Parameters
    ----------
    out : array (runs, trials, readings, alternatives)
        OUT after each reading. Hazards are means over runs: their noise is independent from one
        reading to the next.
    threshold : array (trials, readings)
        Threshold on OUT at each reading.
    bias : array (alternatives,)
        Added to the threshold of each alternative.
    scale : float
        Scale of the noise, in the unit of OUT.
    seen : int array (trials,)
        Number of readings.
    ends : bool array (trials,)
        Whether the last reading forces a decision.

    Returns
    -------
    decided : array (trials, readings, alternatives)
        Probability of a decision for each alternative at each reading; 0 beyond the last.
    left : array (trials,)
        Probability of no decision.
    """
    runs, trials, readings, count = out.shape
    decided = np.zeros((trials, readings, count))
    left = np.ones(trials)
    hazard, past = np.zeros(count), np.zeros(count)
    for trial in range(trials):
        for k in range(seen[trial]):
            wait = not (ends[trial] and k == seen[trial] - 1)
            hazard[:] = 0.0
            for run in range(runs):
                top = 0.0 if wait else -np.inf
                for i in range(count):
                    past[i] = (threshold[trial, k] + bias[i] - out[run, trial, k, i]) / scale
                    top = max(top, past[i])
                total = np.exp(-top) if wait else 0.0
                for i in range(count):
                    past[i] = np.exp(past[i] - top)
                    total += past[i]
                for i in range(count):
                    hazard[i] += past[i] / total / runs
            stays = 1.0
            for i in range(count):
                decided[trial, k, i] = left[trial] * hazard[i]
                stays -= hazard[i]
            left[trial] *= max(stays, 0.0)
            if left[trial] < NOTHING:
                break
    return decided, left
