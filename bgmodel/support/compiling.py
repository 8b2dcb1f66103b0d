"""Numba's compiler, typed so that compiled functions keep their signatures, and exp for it.

Compilers vectorise this exponential function; a call of a library they do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numba.core import event

from circuits.compiled_code import compile_cached, sources_hash

Function = TypeVar("Function", bound=Callable[..., Any])
SOURCES = sources_hash(Path(__file__).parents[1])

DEGREE = 13
"""Of the Taylor series between +-log(2) / 2, where its remainder is 1e-17."""
COEFFICIENTS = tuple(1 / math.factorial(n) for n in range(DEGREE, -1, -1))
LOWEST = -700.0
"""Below it the result is that of this exponent, 1e-304."""
LOG2_HIGH, LOG2_LOW = 0.693145751953125, 1.4286068203094173e-06
"""log(2) as a sum, so that multiples of the first are exact (Cody & Waite 1980)."""
PER_LOG2 = 1 / math.log(2)
BIAS, MANTISSA = 1023, 52
"""Of a number in double precision: what is added to its exponent, and the bits after it."""


def compiled(function: Function, **options: Any) -> Function:
    """Compile with ``numba.njit(**options)`` on first call, cached on disk; the GIL is released."""
    made: Function = compile_cached(function, SOURCES, nogil=True, **options)
    return made


def inlined(function: Function) -> Function:
    """Compile a function into each function that calls it."""
    return compiled(function, inline="always")


def _exponential(x: float) -> float:
    """Return exp(x) for x between ``LOWEST`` and 700, with a relative error below 4e-16."""
    x = max(x, LOWEST)
    twos = np.floor(x * PER_LOG2 + 0.5)
    rest = x - twos * LOG2_HIGH - twos * LOG2_LOW
    polynomial = 0.0
    for coefficient in COEFFICIENTS:
        polynomial = polynomial * rest + coefficient
    power: float = np.int64((np.int64(twos) + BIAS) << MANTISSA).view(np.float64)
    return polynomial * power


exponential = inlined(_exponential)


class _Listener(event.Listener):
    """Calls a function when the first function of the circuits' engines is compiled."""

    def __init__(self, call: Callable[[], None]) -> None:
        self.call: Callable[[], None] | None = call

    def on_start(self, event: Any) -> None:
        """Call once; functions cached on disk do not start such an event."""
        module = str(getattr(event.data.get("dispatcher"), "__module__", ""))
        if self.call is not None and module.startswith("circuits."):
            call, self.call = self.call, None
            call()

    def on_end(self, event: Any) -> None:
        """Do nothing."""


def on_compiling(call: Callable[[], None]) -> None:
    """Call a function once, just before an engine is compiled; replaces that of an earlier call."""
    if _LISTENERS:
        event.unregister("numba:compile", _LISTENERS.pop())
    _LISTENERS.append(_Listener(call))
    event.register("numba:compile", _LISTENERS[-1])


_LISTENERS: list[_Listener] = []
