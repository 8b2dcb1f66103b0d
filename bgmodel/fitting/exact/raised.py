"""A diffusion whose bounds are raised while it is under way, as by a weak stop signal.

The difference of the evidence is X(t) = v t + W(t), as in ``passage``. The bounds are at +-a until
a time u; paths that have not reached them continue to bounds at +-b, b > a. A stop signal of A nats
lowers the threshold of OUT from theta to theta - A, so that the posterior at a decision rises from
exp(-theta) to exp(A - theta).
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, ndtr

from bgmodel.support.arrays import Array

MODES = 40
"""Modes of the density between the bounds; enough from ``EARLIEST_S`` on."""
PLACES = 60
"""Number of places between the bounds at which the density is computed."""
EARLIEST_S = 0.002
"""Shortest time between the start and the change of the bounds, s: the same is used before it."""


def threshold_nats(bound: Array, noise_nats: Array) -> Array:
    """Return the threshold of OUT that corresponds to bounds a of a diffusion, sqrt(s), in nats.

    ``theta = -ln P = ln(1 + exp(-n a))``, as the log odds at a are n a; n, ``noise_nats``, is their
    standard deviation after one second, 2 v in the test with drift v.
    """
    with np.errstate(invalid="ignore"):  # NaN where the go process is unknown
        return np.asarray(np.logaddexp(0, -np.asarray(noise_nats) * bound))


def raised_bound(bound: Array, noise_nats: Array, stop_nats: float) -> Array:
    """Return the bound while a stop signal of some nats is on, sqrt(s); infinite if it blocks."""
    left = threshold_nats(bound, noise_nats) - stop_nats
    with np.errstate(divide="ignore", invalid="ignore"):
        raised = -np.log(np.expm1(left)) / noise_nats
    return np.asarray(np.where(left > 0, raised, np.inf))


def crossed_later(
    drift: float, bound: float, raised: float, since_s: Array, left_s: Array
) -> Array:
    """Return the probability of reaching raised bounds b after missing a until u, ``since_s``.

    The density at u is a sum over modes; from each place the bounds are reached in ``left_s`` with
    the probabilities of one bound alone (inverse Gaussian). Paths that would reach both are counted
    twice; they are rare where the drift makes one response much more likely than the other.
    """
    if not np.isfinite(raised):
        return np.zeros(len(since_s))
    places = bound * (2 * np.arange(PLACES) + 1 - PLACES) / PLACES
    wave = (2 * np.arange(MODES) + 1) * np.pi / (2 * bound)
    u = np.maximum(since_s, EARLIEST_S)[:, None]
    decay = np.exp(-(wave**2 - wave[0] ** 2) * u / 2)
    density = np.maximum(decay @ np.cos(wave[:, None] * places), 0) * np.exp(drift * places)
    w = np.maximum(left_s, 1e-9)[:, None]
    reached = _one_bound(raised - places, drift, w) + _one_bound(raised + places, -drift, w)
    mean = (density * np.minimum(reached, 1)).sum(axis=1) / density.sum(axis=1)
    return np.where(left_s > 0, mean, 0.0)


def _one_bound(distance: Array, drift: float, time_s: Array) -> Array:
    """Return the probability that a single bound is reached within some times."""
    root = np.sqrt(time_s)
    back = np.exp(2 * drift * distance + log_ndtr(-(distance + drift * time_s) / root))
    return np.asarray(ndtr((drift * time_s - distance) / root) + back)
