"""Choices and times of a diffusion whose drift and start differ from trial to trial.

Noise has unit variance per second, bounds are at +-A and the start at z; see
``bgmodel.fitting.exact.passage``. A small share of responses, lapses, is independent of the
evidence.
"""

from __future__ import annotations

import numpy as np

from bgmodel.fitting.exact.passage import standard_at_rest
from bgmodel.support.arrays import Array, Integers

LAPSES = 0.02
"""Share of lapses; assumed, so that a single odd response moves no parameter."""
LONGEST_S = 6.0
"""Their times are uniform up to this, and both responses equally frequent."""
LAPSE_DENSITY = LAPSES / (2 * LONGEST_S)
"""Their density, 1/s."""
TERMS = 4
"""Terms of the series of the density, whose error is then below 1e-9."""
MOST_SHIFT = 500.0
"""Largest logarithm of the ratio of the densities with and without drift; beyond, both vanish."""
GRID = np.concatenate([np.geomspace(0.002, 0.1, 120)[:-1], np.geomspace(0.1, 12.0, 280)])
"""Times from which simulated ones are interpolated, in units of A^2."""


def log_density(
    rt_s: Array, response: Integers, drift: Array, bound: Array, start: Array, t0_s: Array
) -> Array:
    """Return the log density of responses (0 or 1) at times rt_s, 1/s; arguments broadcast."""
    side = 2.0 * response - 1
    since = np.maximum(rt_s - t0_s, 1e-4)
    away = (bound - side * start) / (2 * bound)
    at_rest = standard_at_rest(away, since / (2 * bound) ** 2, TERMS) / (2 * bound) ** 2
    shift = drift * (side * bound - start) - drift**2 * since / 2
    density = np.where(rt_s > t0_s, at_rest * np.exp(np.minimum(shift, MOST_SHIFT)), 0.0)
    return np.asarray(np.log((1 - LAPSES) * density + LAPSE_DENSITY))


def choice_probability(drift: Array, bound: Array, start: Array) -> Array:
    """Return the probability of response 1, lapses included; arguments broadcast.

    ``(1 - exp(-2 v (A + z))) / (1 - exp(-4 v A))`` without lapses.
    """
    v = np.where(np.abs(drift) < 1e-6, 1e-6, drift)
    p = np.expm1(-2 * v * (bound + start)) / np.expm1(-4 * v * bound)
    return np.asarray((1 - LAPSES) * p + LAPSES / 2)


def draw(
    drift: Array, bound: Array, start: Array, t0_s: Array, uniform: Array
) -> tuple[Integers, Array]:
    """Draw responses and times, s, (trials,) each.

    The rows of ``uniform``, (4, trials), draw the response, the time, whether it is a lapse, and
    the time of a lapse.
    """
    p = (choice_probability(drift, bound, start) - LAPSES / 2) / (1 - LAPSES)
    response = (uniform[0] < p).astype(int)
    side = 2.0 * response - 1
    grid = GRID[:, None] * bound**2
    away = (bound - side * start) / (2 * bound)
    density = standard_at_rest(away, grid / (2 * bound) ** 2, TERMS)
    density = density * np.exp(-(drift**2) * grid / 2)
    mass = (density[1:] + density[:-1]) / 2 * np.diff(grid, axis=0)
    share = np.concatenate([np.zeros((1, len(drift))), np.cumsum(mass, axis=0)])
    share /= share[-1]
    times = np.array([np.interp(u, share[:, k], grid[:, k]) for k, u in enumerate(uniform[1])])
    lapse = uniform[2] < LAPSES
    rt_s = np.where(lapse, LONGEST_S * uniform[3], t0_s + times)
    return np.where(lapse, uniform[0] < 0.5, response).astype(int), np.asarray(rt_s)
