"""Responses of cells as filters: how rates follow an input, and the spectrum of their noise.

Theory gives both as functions of frequency (``Cell.response``). Here each is approximated by a
filter with few coefficients, fitted by least squares up to 250 Hz for each state (mean input). The
rate's filter is ``(1 + n1 s + n2 s^2) / (1 + d1 s + d2 s^2)``, which is 1 at frequency 0 (the
cascade "LNdos" of Augustin, Ladenbauer, Baumann & Obermayer 2017, PLoS Comput Biol 13, e1005545,
with separate zeros). The noise's filter has two second-order sections, fitted to the power
spectrum. No parameters are fitted to spikes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex

FREQUENCIES_HZ = np.concatenate([[1e-3, 1.0, 2.0, 4.0], np.geomspace(6, 250, 36)])
"""Frequencies at which responses are fitted; the first represents 0."""
KEPT = 0.03
"""Weight of the regularisation towards the previous state's coefficients and the first guess."""
MIDDLING_HZ = 25.0
"""Rate, Hz, at which the two units of frequency tried by ``colour`` are equal."""
SECTIONS = 2
"""Sections of the noise's filter: with one, the peak of a pacemaker is wrong by up to 30 %."""
SIGNS = np.tile([1.0, -1.0], SECTIONS)
"""Signs of the numerators and denominators of the sections."""
PER_RAD_S = 2j * np.pi * FREQUENCIES_HZ / 100
"""i omega in units of 100 /s, in which coefficients are near 1."""


class FittedFilter(NamedTuple):
    """Coefficients of a filter, one row per state, and its largest misfits up to 100 Hz."""

    coefficients: Array
    misfit: Array


def following(gain: Complex) -> FittedFilter:
    """Fit the rate's filter, n1, n2, d1, d2 in powers of 10 ms, to gains (S, F).

    Misfits are relative to the gain at frequency 0.
    """
    s, weight = PER_RAD_S, 1 / (1 + FREQUENCIES_HZ / 100)
    wanted = gain / gain[:, :1].real

    def parts(p: Array) -> tuple[Complex, Complex, Array]:
        d1, d2 = np.exp(p[2:])
        return 1 + p[0] * s + p[1] * s * s, 1 + d1 * s + d2 * s * s, np.array([d1, d2])

    def missing(p: Array, state: int) -> Array:
        top, low, _ = parts(p)
        off = (top / low - wanted[state]) * weight
        return np.concatenate([off.real, off.imag])

    def slopes(p: Array, state: int) -> Array:
        top, low, (d1, d2) = parts(p)
        down = -top / low**2
        derivatives = np.array([s / low, s * s / low, down * d1 * s, down * d2 * s * s]) * weight
        return np.concatenate([derivatives.real, derivatives.imag], axis=1).T

    start = np.array([0.3, 0.03, np.log(0.6), np.log(0.05)])
    coefficients = _along(len(gain), missing, slopes, start)
    off = np.abs(np.array([np.divide(*parts(p)[:2]) for p in coefficients]) - wanted)
    coefficients[:, 2:] = np.exp(coefficients[:, 2:])
    return FittedFilter(coefficients, off[:, FREQUENCIES_HZ <= 100].max(axis=1))


def colour(power: Array, rate_hz: Array) -> FittedFilter:
    """Fit the noise's filter: b1, b0, a1, a0 of ``(s^2 + b1 s + b0) / (s^2 + a1 s + a0)``.

    The frequencies scale with the rate (S,) in pacemakers, and with the membrane in noise-driven
    cells; both are tried, and the better fit is used. The power (S, F) is divided by that at the
    highest frequencies. Coefficients (S, 4 SECTIONS) are in powers of 100 /s; misfits are relative.
    """
    tried = [_colour(power, unit) for unit in (np.ones(len(power)), rate_hz / MIDDLING_HZ)]
    return min(tried, key=lambda fit: float(fit.misfit.sum()))


def _colour(power: Array, unit: Array) -> FittedFilter:
    """Fit the spectrum of noise with frequencies in a separate unit for each state."""
    wanted = np.log(power)

    def polynomials(p: Array, state: int) -> Complex:
        """Return numerators and denominators of the sections in turn, (2 SECTIONS, F)."""
        s, c = PER_RAD_S / unit[state], np.exp(p).reshape(-1, 2, 1)
        return np.asarray(s * s + c[:, 0] * s + c[:, 1])

    def missing(p: Array, state: int) -> Array:
        logs = 2 * np.log(np.abs(polynomials(p, state)))
        return np.asarray(SIGNS @ logs - wanted[state])

    def slopes(p: Array, state: int) -> Array:
        of = 1 / polynomials(p, state)
        c, s = np.exp(p).reshape(-1, 2, 1), PER_RAD_S / unit[state]
        each = np.stack([c[:, 0] * s * of, c[:, 1] * of], axis=1).real
        return np.asarray(2 * (SIGNS[:, None, None] * each).reshape(len(p), -1).T)

    start = np.log([1.0, 1.0, 1.0, 4.0, 3.0, 9.0, 3.0, 9.0])
    logs_of_states = _along(len(power), missing, slopes, start)
    off = np.array([missing(p, state) for state, p in enumerate(logs_of_states)])
    misfit = np.abs(np.expm1(off))[:, FREQUENCIES_HZ <= 100].max(axis=1)
    return FittedFilter(
        np.exp(logs_of_states) * unit[:, None] ** np.tile([1, 2, 1, 2], SECTIONS), misfit
    )


Of = Callable[[Array, int], Array]


def _along(count: int, missing: Of, slopes: Of, start: Array) -> Array:
    """Solve one least-squares problem per state in order, each starting from the previous one."""
    from scipy.optimize import least_squares

    solutions, first = np.empty((count, len(start))), start
    held = KEPT * np.eye(len(start))
    for state in range(count):
        before = start

        def all_missing(p: Array, state: int = state, before: Array = before) -> Array:
            return np.concatenate([missing(p, state), KEPT * (p - before), KEPT * (p - first)])

        def all_slopes(p: Array, state: int = state) -> Array:
            return np.concatenate([slopes(p, state), held, held])

        start = least_squares(all_missing, before, jac=all_slopes, method="lm", max_nfev=400).x
        solutions[state] = start
    return solutions


def sampled(sections: Array, dt_ms: float) -> npt.NDArray[np.float64]:
    """Convert sections (S, 4) to filters of ticks by Tustin's rule: g, c0, c1, a1, a2, (5, S).

    A filter is ``g + (1 - 1/z) (c0 + c1/z) / (1 + a1/z + a2/z^2)``; g is its gain at frequency 0.
    """
    b1, b0, a1, a0 = sections.T
    k = 20 / dt_ms  # 2 / tick, in 100 /s
    first = k * k + a1 * k + a0
    low1, low2 = 2 * (a0 - k * k) / first, (k * k - a1 * k + a0) / first
    # Numerator's coefficients of 1 and 1/z^2; that of 1/z follows from the gain at frequency 0.
    top0, top2 = (k * k + b1 * k + b0) / first, (k * k - b1 * k + b0) / first
    held = b0 / a0
    return np.array([held, top0 - held, held * low2 - top2, low1, low2])


def propagated(coefficients: Array, dt_ms: float) -> npt.NDArray[np.float64]:
    """Convert n1, n2, d1, d2 (S, 4) to the update of a tick, p11, p12, p21, p22, c1, c2 (6, S).

    Let e be the low-passed input minus the input u, and v its slope. A tick sets
    ``e, v = p11 e + p12 v, p21 e + p22 v``, and cells respond to ``u + c1 e + c2 v``. At rest e and
    v are 0 for any coefficients, so the coefficients may change with the state.
    """
    n1, n2, d1, d2 = coefficients.T
    dt = dt_ms / 10
    # The exponential of dt [[0, 1], [-1/d2, -d1/d2]] in closed form, from the mean of the
    # eigenvalues and half their difference.
    mean = -d1 / d2 / 2
    half = np.sqrt(mean**2 - 1 / d2 + 0j)
    half = np.where(np.abs(half) < 1e-9, 1e-9, half)
    fade = np.exp(mean * dt)
    even, odd = (fade * np.cosh(half * dt)).real, (fade * np.sinh(half * dt) / half).real
    tick = (even - mean * odd, odd, -odd / d2, even + (-d1 / d2 - mean) * odd)
    return np.array([*tick, 1 - n2 / d2, n1 - n2 * d1 / d2])
