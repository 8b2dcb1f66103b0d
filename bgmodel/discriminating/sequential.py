"""How many trials a sequential test needs until its Bayes factor decides between two models."""

from __future__ import annotations

import numpy as np

from bgmodel.support.arrays import Array, Integers
from bgmodel.theory.empirical import Empirical
from bgmodel.theory.first_passage import walk
from bgmodel.theory.sprt import OVERSHOOT

FACTOR = 10.0
"""Bayes factor at which an experiment ends."""
BOUND_NATS = float(np.log(FACTOR))
SHORT = 400
"""Medians up to here are computed exactly."""
STEEP = 30.0
"""Drift, relative to noise, from which the walk goes straight to its bound."""


def exit_median(mean: float, variance: float, bound: float = BOUND_NATS) -> float:
    """Return the median number of steps in which a walk leaves (-bound, bound), by diffusion.

    The survival of a diffusion between two bounds is a series of sines (Cox & Miller 1965); it is
    solved for 1/2. The mean number of steps is Wald's (1945).
    """
    from scipy.optimize import brentq

    length = 2 * (bound + OVERSHOOT * np.sqrt(variance))
    k = np.arange(1, 400) * np.pi / length
    tilt = mean / variance
    odd = np.where(np.arange(1, 400) % 2, 1.0, -1.0)
    half = tilt * length / 2
    if half > STEEP:
        return float(length / 2 / mean)
    # The integral of exp(tilt x) sin(k x), relative to the start half-way.
    ends = k * (np.exp(-half) + odd * np.exp(half)) / (tilt**2 + k**2)
    size = 2 / length * ends * np.sin(k * length / 2)
    rate = (mean**2 / variance + k**2 * variance) / 2

    def above_half(log_time: float) -> float:
        return float(size @ np.exp(-rate * np.exp(log_time))) - 0.5

    scale = np.log(length**2 / variance)
    return float(np.exp(brentq(above_half, scale - 8, scale + 8)))


def median_trials(values: Array, weights: Array, bound: float = BOUND_NATS) -> float:
    """Return the median number of trials until a Bayes factor reaches its bound on either side.

    Small numbers are those of the exact Markov chain (``theory.first_passage``), larger ones those
    of the diffusion.
    """
    mean = float(weights @ values)
    variance = float(weights @ (values - mean) ** 2)
    about = exit_median(mean, variance, bound)
    if about > SHORT:
        return about
    steps = walk(Empirical(values, weights), -bound, bound, t_max=int(4 * about) + 20).steps_pmf
    assert steps is not None
    return float(np.searchsorted(np.cumsum(steps), 0.5))


def wald_mean(nats: float, bound: float = BOUND_NATS) -> float:
    """Return Wald's mean number of trials: bound tanh(bound / 2) / nats, without overshoot."""
    return float(bound * np.tanh(bound / 2) / nats)


def experiments(
    values: list[Array],
    bins: list[Integers],
    shares: list[float],
    rng: np.random.Generator,
    *,
    repeats: int = 200,
    most: int = 100_000,
    bound: float = BOUND_NATS,
) -> tuple[Array, Array]:
    """Simulate experiments that end when the Bayes factor decides."""
    state, ended = np.zeros(repeats), np.full(repeats, np.nan)
    right = np.zeros(repeats)
    scores = [ratio[place] for ratio, place in zip(values, bins, strict=True)]
    done, block = 0, 64
    while done < most and np.isnan(ended).any():
        kind = rng.choice(len(shares), size=(repeats, block), p=shares)
        steps = np.zeros((repeats, block))
        for k, score in enumerate(scores):
            here = kind == k
            steps[here] = rng.choice(score, int(here.sum()))
        path = state[:, None] + np.cumsum(steps, axis=1)
        over = np.abs(path) >= bound
        first = over.argmax(axis=1)
        new = over.any(axis=1) & np.isnan(ended)
        ended[new] = done + 1 + first[new]
        right[new] = path[new, first[new]] > 0
        state, done = path[:, -1], done + block
        block = min(2 * block, 4096)
    return ended, right
