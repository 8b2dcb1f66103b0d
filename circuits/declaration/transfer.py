"""Named transfer functions, each in NumPy and as Brian2 code, so that engines agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.errors import require

EXP_MOST = 60.0
"""Cap of exponents, nats: far above any rate and far below overflow."""
MOST_NATS = 5.5
"""Highest activity of a saturating population, nats; decisions among 12 channels need less."""


@dataclass(frozen=True)
class Transfer:
    """A function of an input in nats."""

    function: Callable[[Array], Array]
    slope: Callable[[Array], Array]  # first derivative
    curvature: Callable[[Array], Array]  # second derivative
    brian: str  # the function as Brian2 code, with ``{x}`` for its input
    about: str  # description and source
    # Input for a given activity: NaN if there is none, and the end of the flat part where the
    # function is flat. None if the function is not one-to-one.
    inverse: Callable[[Array], Array] | None = None

    def __call__(self, x: npt.ArrayLike) -> Array:
        """Return the function of x."""
        return self.function(np.asarray(x, dtype=np.float64))


def _capped(x: Array) -> Array:
    values: Array = np.exp(np.minimum(x, EXP_MOST))
    return values


def _cut_off(high: float, about: str) -> Transfer:
    """Return a straight line that is clipped at 0 and at a highest value."""
    return Transfer(
        lambda x: np.clip(x, 0.0, high),
        lambda x: ((x > 0) & (x < high)).astype(np.float64),
        np.zeros_like,
        f"clip({{x}}, 0, {high:g})",
        about,
        lambda a: np.where((a >= 0) & (a <= high), a, np.nan),
    )


def _above_0(law: Callable[[Array], Array], otherwise: float) -> Callable[[Array], Array]:
    """Return a law that has another value where it is not defined, from 0 down."""
    return lambda x: np.where(x > 0, law(np.where(x > 0, x, 1.0)), otherwise)


# Each compiled engine has its own version of these functions; tests check that they agree. A shared
# compiled function is not possible: the spikes engine takes one number at a time in double
# precision, inlined into its loop over ticks; the population engine takes a row of parallel trials
# in single precision, with an exponential that the compiler vectorises; here they work on NumPy
# arrays. A shared version would round differently and slow the population engine down.
TRANSFERS: dict[str, Transfer] = {
    "linear": Transfer(
        lambda x: x + 0.0, np.ones_like, np.zeros_like, "{x}", "unchanged", lambda a: a + 0.0
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
        _above_0(np.log, np.nan),
    ),
    "log": Transfer(
        lambda x: np.log(np.maximum(x, 1.0)),
        lambda x: (x > 1) / np.maximum(x, 1.0),
        lambda x: -1.0 * (x > 1) / np.maximum(x, 1.0) ** 2,
        "log(clip({x}, 1, inf))",
        "logarithm, no less than zero: undoes exp, for sources that code by exponentials",
        lambda a: np.where(a >= 0, _capped(a), np.nan),
    ),
    "s_minus_log_s": Transfer(
        _above_0(lambda s: s - np.log(s), 0.0),
        _above_0(lambda s: 1 - 1 / s, 0.0),
        _above_0(lambda s: 1 / s**2, 0.0),
        "int({x} > 0) * ({x} - log(clip({x}, 1e-300, inf)))",
        "S - ln S of what STN delivers to GPe; Bogacz & Gurney 2007. No input drives nothing",
    ),
}
"""All transfers by name.

The spikes engine has neither the ramp, nor the logarithm, nor transfers added later.
"""


def named(name: str) -> Transfer:
    """Return a transfer by name."""
    require(name in TRANSFERS, "transfer", f"must be one of {', '.join(TRANSFERS)}", name)
    return TRANSFERS[name]
