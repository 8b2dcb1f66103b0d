"""Single-precision arithmetic that all engines round alike, for the ticks of cells.

A spike depends on the last bit of a potential, so a cell's tick uses only these functions and
``+``, ``-`` and ``*`` of single-precision numbers, each rounded once. Here they work on NumPy
arrays; the compiled engine has its own version of each, and the Brian2 code calls these.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ZERO, ONE = np.float32(0), np.float32(1)
LOWEST, HIGHEST = np.float32(-87), np.float32(60)
"""Exponents are capped here, so that results are neither denormal nor overflow."""
PER_LN2, HALF = np.float32(1.44269504), np.float32(0.5)
LN2_HIGH, LN2_LOW = np.float32(-0.693359375), np.float32(2.12194440e-4)
"""-ln 2 in two parts, so that the remainder of a division by it keeps its bits."""
TAYLOR = tuple(np.float32(1 / n) for n in (5040, 720, 120, 24, 6, 2, 1, 1))
"""Taylor coefficients of exp, highest power first: for |r| <= ln 2 / 2 the next is below 1e-7."""


def single(x: Any) -> Any:
    """Return x rounded to single precision."""
    return np.asarray(x, dtype=np.float32)


def fused(a: Any, b: Any, c: Any) -> Any:
    """Return ``a b + c`` of single-precision numbers, rounded once.

    The product is exact in double precision.
    """
    return single(np.asarray(a, dtype=np.float64) * b + c)


def choose(test: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the test is true, ``no`` elsewhere."""
    return np.where(test, yes, no)


def exponential(x: Any) -> Any:
    """Return exp of single-precision x, capped at -87 and 60, with a relative error of 1e-7."""
    x = np.minimum(np.maximum(single(x), LOWEST), HIGHEST)
    powers = np.floor(x * PER_LN2 + HALF)
    r = fused(powers, LN2_LOW, fused(powers, LN2_HIGH, x))
    p: Any = TAYLOR[0]
    for term in TAYLOR[1:]:
        p = fused(p, r, term)
    return single(np.ldexp(p, powers.astype(np.int32)))
