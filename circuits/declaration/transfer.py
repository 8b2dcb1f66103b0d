"""Named transfer functions: the NumPy form beside the Brian2 text, so that engines agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.errors import require

EXP_MOST = 60.0
"""Exponents are capped here, nats: far above any rate, far below overflow."""
MOST_NATS = 5.5
"""Highest activity of a saturating population, nats: above what decides between 12."""


@dataclass(frozen=True)
class Transfer:
    """One function of one input in nats.

    Parameters
    ----------
    function, slope, curvature : callable
        The function and its derivatives, on arrays.
    brian : str
        The same as Brian2 text, with ``{x}`` for its input.
    about : str
        What it stands for, with its source.
    inverse : callable, optional
        The input of an activity, on arrays: NaN where there is none, and where the function is flat
        the end of the flat part. None where two inputs have one activity.
    """

    function: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]
    brian: str
    about: str
    inverse: Callable[[Array], Array] | None = None

    def __call__(self, x: npt.ArrayLike) -> Array:
        """Return the function of x."""
        return self.function(np.asarray(x, dtype=np.float64))


def _capped(x: Array) -> Array:
    values: Array = np.exp(np.minimum(x, EXP_MOST))
    return values


def _cut_off(high: float, about: str) -> Transfer:
    """Return a straight line that is cut off at 0 and at a highest value."""
    return Transfer(
        lambda x: np.clip(x, 0.0, high),
        lambda x: ((x > 0) & (x < high)).astype(np.float64),
        np.zeros_like,
        f"clip({{x}}, 0, {high:g})",
        about,
        lambda a: np.where((a >= 0) & (a <= high), a, np.nan),
    )


def _log(a: Array) -> Array:
    some = a > 0
    return np.where(some, np.log(np.where(some, a, 1.0)), np.nan)


def _s_minus_log_s(s: Array) -> Array:
    some = s > 0
    safe = np.where(some, s, 1.0)
    return np.where(some, safe - np.log(safe), 0.0)


def _s_minus_log_s_slope(s: Array) -> Array:
    some = s > 0
    return np.where(some, 1 - 1 / np.where(some, s, 1.0), 0.0)


def _s_minus_log_s_curvature(s: Array) -> Array:
    some = s > 0
    return np.where(some, 1 / np.where(some, s, 1.0) ** 2, 0.0)


# Each compiled engine has these functions once more, and tests hold them equal to these. One
# compiled function cannot serve all three: the ensemble engine takes one number at a time in double
# precision, inlined into its loop over ticks; the population engine takes a row of lanes in single
# precision, with an exponential that the compiler vectorises; here they are NumPy's, on arrays. To
# share one would round the others' numbers otherwise, and cost the lanes their speed.
TRANSFERS: dict[str, Transfer] = {
    "linear": Transfer(
        lambda x: x + 0.0, np.ones_like, np.zeros_like, "{x}", "as it is", lambda a: a + 0.0
    ),
    "rectified": _cut_off(np.inf, "no less than zero"),
    "saturating": _cut_off(MOST_NATS, "no less than zero, no more than 5.5 nats; assumed"),
    "ramp": _cut_off(1.0, "no less than zero, no more than one; Gurney, Prescott & Redgrave 2001"),
    "exp": Transfer(
        _capped,
        _capped,
        _capped,
        f"exp(clip({{x}}, -inf, {EXP_MOST:g}))",
        "exponential f-I of STN; Bogacz & Gurney 2007 after Hallworth 2003, Wilson 2004",
        _log,
    ),
    "s_minus_log_s": Transfer(
        _s_minus_log_s,
        _s_minus_log_s_slope,
        _s_minus_log_s_curvature,
        "int({x} > 0) * ({x} - log(clip({x}, 1e-300, inf)))",
        "S - ln S of what STN delivers to GPe; Bogacz & Gurney 2007. No input drives nothing",
    ),
}
"""All transfers by name. The compiled engine has no ramp, and none that is added here."""


def named(name: str) -> Transfer:
    """Return a transfer by name.

    Raises
    ------
    ValueError
        If there is none, with the names that there are.
    """
    require(name in TRANSFERS, "transfer", f"must be one of {', '.join(TRANSFERS)}", name)
    return TRANSFERS[name]
