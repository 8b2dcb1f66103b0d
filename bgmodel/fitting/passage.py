"""First-passage times of a diffusion between two bounds, constant or falling with time.

The difference of the evidence is X(t) = z + v t + W(t), with z its start and W a Brownian motion of
unit variance per second; it is decided at X = a(t) (response 1) or X = -a(t) (response 0). Drift
enters by Girsanov's theorem: at the bound X is known, so the density at drift v is that at drift 0
times ``exp(v (+-a(t) - z) - v^2 t / 2)``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bgmodel.support.compiling import compiled, exponential
from circuits.arrays import Array, Integers

TERMS = 12
"""Terms of the series of a constant bound: modes for late times, images for early ones."""
LARGEST = 700.0
"""Largest exponent; where it is larger, the density without drift is 0 in floating point."""
NEGLIGIBLE = 1e-20
"""Share of a sum below which further terms are left out."""


def constant_at_rest(bound: float, time_s: Array, start: npt.ArrayLike = 0.0) -> Array:
    """Return densities for a constant bound and no drift, (2, times) or (starts, 2, times), 1/s.

    By the two series of Navarro & Fuss (2009): modes for late times, images for early ones.
    """
    scaled, z = np.asarray(time_s, float) / (2 * bound) ** 2, np.atleast_1d(start)
    # Distance from the start to the bound of response 0 and of 1, in units of that between them.
    away = np.stack([bound + z, bound - z], axis=1)[:, :, None] / (2 * bound)
    # From a start in the middle both densities are the same.
    sides = away if z.any() else away[:, :1]
    density = standard_at_rest(sides, scaled, terms=6) / (2 * bound) ** 2
    density = np.broadcast_to(density, (len(z), 2, len(scaled)))
    return np.asarray(density if np.ndim(start) else density[0])


def standard_at_rest(away: Array, scaled: Array, terms: int = TERMS) -> Array:
    """Return the density at a bound for bounds 1 apart and no drift.

    ``away`` is the distance from the start to this bound, ``scaled`` the time divided by the
    squared distance between the bounds, of any shape.
    """
    shape = np.broadcast_shapes(np.shape(away), np.shape(scaled))
    far, late = (np.array(np.broadcast_to(x, shape), float).ravel() for x in (away, scaled))
    return _series(far, late, terms).reshape(shape)


@compiled
def _series(away: Array, scaled: Array, terms: int) -> Array:
    """Return the density at a bound by the series that converges faster; all arrays (times,)."""
    density = np.empty(len(away))
    last, lowest, double = 0.0, 0.0, 2.0
    for i in range(len(away)):
        if away[i] != last:
            last = away[i]
            lowest, double = np.sin(np.pi * last), 2 * np.cos(np.pi * last)
        total = 0.0
        if scaled[i] > 0.15:
            # sin(n theta) and the powers of exp(-pi^2 s / 2) by recurrence.
            first = np.exp(-(np.pi**2) * scaled[i] / 2)
            sine, before, power, odd = lowest, 0.0, first, first
            for n in range(1, 2 * terms):
                total += n * sine * power
                sine, before = double * sine - before, sine
                odd *= first * first
                power *= odd
                if (n + 1) ** 2 * power < NEGLIGIBLE * first:
                    break  # no later mode can change the last digit
            density[i] = max(np.pi * total, 0.0)
        else:
            for k in range(-(terms + 1) // 2, terms // 2):
                there = away[i] + 2 * k
                if there**2 - away[i] ** 2 < -2 * np.log(NEGLIGIBLE) * scaled[i]:
                    total += there * np.exp(-(there**2) / (2 * scaled[i]))
            density[i] = max(total / np.sqrt(2 * np.pi * scaled[i] ** 3), 0.0)
    return density


def falling_at_rest(
    bound: Array,
    slope: Array,
    time_s: Array,
    width_s: Array | None = None,
    start: npt.ArrayLike = 0.0,
) -> Array:
    """Return densities for bounds +-a(t) and no drift, (2, times) or (starts, 2, times), 1/s.

    By the integral equation of Buonocore, Nobile & Ricciardi (1987), whose kernel vanishes where
    two times coincide; ``slope`` is the derivative of a(t), ``width_s`` the weights of an integral.
    """
    times, z = np.asarray(time_s, float), np.atleast_1d(np.asarray(start, float))
    width = np.full(len(times), times[1] - times[0]) if width_s is None else width_s
    away = np.stack([bound + z[:, None], bound - z[:, None]], axis=1)
    first = (slope - away / times) * np.exp(-(away**2) / (2 * times)) / np.sqrt(2 * np.pi * times)
    density = np.maximum(_solved(first, bound, slope, times, width), 0.0)
    return np.asarray(density if np.ndim(start) else density[0])


def _solved_of(first: Array, bound: Array, slope: Array, times: Array, width: Array) -> Array:
    """Solve the integral equations by forward substitution, (starts, 2, times), 1/s."""
    density = -first
    weight = width / np.sqrt(2 * np.pi)
    from_same, from_other = np.empty(len(times)), np.empty(len(times))
    for i in range(len(times)):
        # Two plain loops, which the compiler vectorises: the kernels, then the sums.
        for j in range(i):
            rate = 1 / (times[i] - times[j])
            scale = weight[j] * np.sqrt(rate)
            same, other = bound[i] - bound[j], bound[i] + bound[j]
            from_same[j] = scale * (slope[i] - same * rate) * exponential(-(same**2) * rate / 2)
            from_other[j] = scale * (slope[i] - other * rate) * exponential(-(other**2) * rate / 2)
        for k in range(len(first)):
            zero, one = 0.0, 0.0
            for j in range(i):
                zero += from_same[j] * density[k, 0, j] + from_other[j] * density[k, 1, j]
                one += from_same[j] * density[k, 1, j] + from_other[j] * density[k, 0, j]
            density[k, 0, i] += zero
            density[k, 1, i] += one
    return density


_solved = compiled(_solved_of, fastmath={"reassoc", "contract"}, error_model="numpy")


def binned(
    at_rest: Array,
    bound: Array,
    time_s: Array,
    drift: npt.ArrayLike,
    start: float = 0.0,
    drift_sd: npt.ArrayLike = 0.0,
    *,
    width_s: Array,
    bins: Integers,
) -> Array:
    """Return the probabilities of both responses in bins of time, at drifts, (cells, 2, bins).

    With c the signed distance from the start to the bound, the mean of ``exp(u c - u^2 t / 2)``
    over Gaussian drifts u of mean v and variance s^2 is ``exp((2 v c + s^2 c^2 - v^2 t) / (2 q)) /
    sqrt(q)`` with ``q = 1 + s^2 t`` (Tuerlinckx 2004).
    """
    v = np.asarray(drift, float)
    variance = np.zeros(v.shape) + np.asarray(drift_sd, float) ** 2
    return _binned(at_rest * width_s, bound, time_s, bins, v, float(start), variance)


@compiled
def _binned(
    mass: Array, bound: Array, time_s: Array, bins: Integers, drift: Array, start: float,
    variance: Array,
) -> Array:  # fmt: skip
    """Sum the masses at times without drift (2, times), weighted as in ``binned``, by bin."""
    probability = np.zeros((len(drift), 2, bins[-1] + 1))
    for i in range(len(drift)):
        v, s2, last, up, down = drift[i], variance[i], -1.0, 1.0, 1.0
        plain = s2 == 0 and abs(v) * (bound.max() + abs(start)) < LARGEST / 2
        for k in range(len(time_s)):
            t, a = time_s[k], bound[k]
            if plain:
                # The weight is one factor of the bound, which rarely changes, and one of time.
                if a != last:
                    last, up, down = a, np.exp(v * (a - start)), np.exp(-v * (a + start))
                spent = np.exp(-v * v * t / 2)
                probability[i, 0, bins[k]] += down * spent * mass[0, k]
                probability[i, 1, bins[k]] += up * spent * mass[1, k]
                continue
            spread = 1 + s2 * t
            for side in range(2):
                c = a - start if side == 1 else -a - start
                weight = (2 * v * c + s2 * c * c - v * v * t) / (2 * spread)
                weight = np.exp(min(weight, LARGEST)) / np.sqrt(spread)
                probability[i, side, bins[k]] += weight * mass[side, k]
    return probability
