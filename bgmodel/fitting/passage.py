"""First-passage times of a diffusion between two bounds, constant or falling with time.

The difference of the evidence is X(t) = z + v t + W(t), with z its start and W a Brownian motion of
unit variance per second; it is decided at X = a(t) (response 1) or X = -a(t) (response 0). Drift
enters by Girsanov's theorem: at the bound X is known, so the density at drift v is that at drift 0
times ``exp(v (+-a(t) - z) - v^2 t / 2)``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bgmodel.support.arrays import Array

TERMS = 12
"""Terms of the series of a constant bound: modes for late times, images for early ones."""


def accuracy(drift: npt.ArrayLike, bound: npt.ArrayLike) -> Array:
    """Return the probability of the response that the drift favours.

    Parameters
    ----------
    drift : array, 1/sqrt(s)
        v.
    bound : array, sqrt(s)
        A, constant.

    Notes
    -----
    ``1 / (1 + exp(-2 A |v|))`` (Palmer, Huk & Shadlen 2005).
    """
    odds = 2 * np.asarray(bound) * np.abs(drift)
    return np.asarray(1 / (1 + np.exp(-odds)))


def mean_time_s(drift: npt.ArrayLike, bound: npt.ArrayLike) -> Array:
    """Return the mean decision time, s.

    Arguments as for ``accuracy``. ``(A / v) tanh(A v)``, ``A^2`` without drift (Palmer, Huk &
    Shadlen 2005).
    """
    v, a = np.broadcast_arrays(np.abs(np.asarray(drift, float)), np.asarray(bound, float))
    still = v * a < 1e-6
    safe = np.where(still, 1.0, v)
    return np.asarray(np.where(still, a**2, a / safe * np.tanh(a * safe)))


def sd_time_s(drift: npt.ArrayLike, bound: npt.ArrayLike) -> Array:
    """Return the standard deviation of decision times, s, equal for both responses.

    Arguments as for ``accuracy``. From the cumulant ``ln(cosh(A v) / cosh(A sqrt(v^2 + 2 s)))`` of
    the time: ``sqrt(2/3) A^2`` without drift.
    """
    v, a = np.broadcast_arrays(np.abs(np.asarray(drift, float)), np.asarray(bound, float))
    x = np.maximum(a * v, 0.02)  # below it the following difference would be rounding error
    variance = a**4 * (np.tanh(x) / x**3 - 1 / (x * np.cosh(x)) ** 2)
    near = a**4 * (2 / 3 - 8 / 15 * (a * v) ** 2)
    return np.asarray(np.sqrt(np.where(a * v < 0.02, near, variance)))


def constant_at_rest(bound: float, time_s: Array, start: float = 0.0) -> Array:
    """Return the densities of both responses for a constant bound and no drift, (2, times), 1/s.

    By the two series of Navarro & Fuss (2009): modes for late times, images for early ones.

    Parameters
    ----------
    bound : float, sqrt(s)
        A.
    time_s : array (times,), s
        Above 0.
    start : float, sqrt(s)
        z, between -A and A.
    """
    scaled = np.asarray(time_s, float) / (2 * bound) ** 2
    # Distance from the start to the bound of response 0 and of 1, in units of that between them.
    away = np.array([bound + start, bound - start])[:, None] / (2 * bound)
    return standard_at_rest(away, scaled) / (2 * bound) ** 2


def standard_at_rest(away: Array, scaled: Array, terms: int = TERMS) -> Array:
    """Return the density at a bound for bounds 1 apart and no drift, of any shape.

    Parameters
    ----------
    away : array
        Distance from the start to this bound, 0..1.
    scaled : array
        Time divided by the squared distance between the bounds, above 0; broadcasts with ``away``.
    terms : int
        Terms of either series; with 4 the error is below 1e-9.
    """
    # sin(n theta) and the powers of exp(-pi^2 s / 2) by recurrence: one sine and one exponential.
    theta, first = np.pi * away, np.exp(-(np.pi**2) * scaled / 2)
    sine, before, double = np.sin(theta), 0.0, 2 * np.cos(theta)
    power, odd = first, first
    modes = np.zeros(np.broadcast_shapes(np.shape(away), np.shape(scaled)))
    for n in range(1, 2 * terms):
        modes += n * sine * power
        sine, before = double * sine - before, sine
        odd = odd * first * first
        power = power * odd
    images = np.zeros(modes.shape)
    for k in range(-terms // 2, terms // 2):
        there = away + 2 * k
        images += there * np.exp(-(there**2) / (2 * scaled))
    early = images / np.sqrt(2 * np.pi * scaled**3)
    return np.asarray(np.maximum(np.where(scaled > 0.15, np.pi * modes, early), 0.0))


def falling_at_rest(
    bound: Callable[[Array], Array],
    slope: Callable[[Array], Array],
    time_s: Array,
    width_s: Array | None = None,
    start: float = 0.0,
) -> Array:
    """Return the densities of both responses for bounds +-a(t) and no drift, (2, times), 1/s.

    Parameters
    ----------
    bound, slope : function
        a(t), sqrt(s), above 0, and its derivative.
    time_s : array (times,), s
        Increasing, above 0.
    width_s : array (times,), s, optional
        Weight of each time in an integral; by default times are equally spaced and begin one
        interval after 0.
    start : float, sqrt(s)
        z, between -a(0) and a(0).

    Notes
    -----
    The integral equation of Buonocore, Nobile & Ricciardi (1987), whose kernel is made to vanish
    where two times coincide. For two mirror-symmetric bounds the equations of the sum and of the
    difference of both responses are separate; on a grid of times each is a triangular system.
    """
    from scipy.linalg import solve_triangular

    times = np.asarray(time_s, float)
    width = np.full(len(times), times[1] - times[0]) if width_s is None else width_s
    a, fall = bound(times), slope(times)

    def flux(apart: Array, since: Array, falls: Array) -> Array:
        return np.asarray(
            0.5 * (falls - apart / since) * np.exp(-(apart**2) / (2 * since))
            / np.sqrt(2 * np.pi * since)
        )  # fmt: skip

    from_0, from_1 = flux(a + start, times, fall), flux(a - start, times, fall)
    since = times[:, None] - times
    before = since > 1e-12
    since = np.where(before, since, 1.0)
    same = flux(a[:, None] - a, since, fall[:, None])
    other = flux(a[:, None] + a, since, fall[:, None])

    def solved(kernel: Array, first: Array) -> Array:
        system = np.eye(len(times)) - np.where(before, 2 * width * kernel, 0.0)
        return np.asarray(solve_triangular(system, -2 * first, lower=True))

    total = solved(same + other, from_0 + from_1)
    apart = solved(same - other, from_1 - from_0) if start else np.zeros(len(times))
    return np.maximum(np.stack([total - apart, total + apart]) / 2, 0.0)


def exponential(bound: float, fall_s: float) -> tuple[Callable[[Array], Array], ...]:
    """Return the bound that falls by a factor e in ``fall_s`` seconds, and its slope."""

    def at(time_s: Array) -> Array:
        return np.asarray(bound * np.exp(-time_s / fall_s))

    return at, lambda time_s: -at(time_s) / fall_s


def with_drift(
    at_rest: Array, bound: Array, time_s: Array, drift: npt.ArrayLike, start: float = 0.0
) -> Array:
    """Return the densities of both responses at drifts.

    Parameters
    ----------
    at_rest, bound, time_s : array (2, times), (times,), (times,)
        Densities without drift, 1/s; a(t); times, s.
    drift : array (cells,), 1/sqrt(s)
        v.
    start : float, sqrt(s)
        z, as for the densities without drift.

    Returns
    -------
    array (cells, 2, times), 1/s
        Responses 0 and 1.
    """
    v = np.asarray(drift, float)[:, None]
    common = -(v**2) * time_s / 2 - v * start
    weights = np.stack([np.exp(common - v * bound), np.exp(common + v * bound)], axis=1)
    return np.asarray(weights * at_rest)
