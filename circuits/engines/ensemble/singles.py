"""``circuits.cells.single`` compiled for one cell at a time, with the same rounding.

Only single precision is accepted: other numbers would be rounded here but not by NumPy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from circuits.cells import single
from circuits.engines.ensemble import lanes


@overload(single.single, strict=False)
def _single(x):
    return lambda x: np.float32(x)


@overload(single.fused, strict=False)
def _fused(a, b, c):
    return (lambda a, b, c: lanes.fused(a, b, c)) if _singles(a, b, c) else None


@overload(single.choose, strict=False)
def _choose(test, yes, no):
    return (lambda test, yes, no: lanes.choose(test, yes, no)) if _singles(yes, no) else None


@overload(single.exponential, strict=False)
def _exponential(x):
    return (lambda x: lanes.exp32(x)) if _singles(x) else None


def _singles(*kinds):
    """Whether all are single precision; others would be rounded here but not by NumPy."""
    return all(kind == types.float32 for kind in kinds)


def kept(x: Any) -> Any:
    """Return a variable of a cell, which must be single precision to avoid implicit rounding."""
    return x


@overload(kept)
def _kept_single(x):
    return (lambda x: x) if _singles(x) else None


def truth(x: Any) -> Any:
    """Return whether a cell fires, which must be a boolean: other numbers have more bits."""
    return x


@overload(truth)
def _truth(x):
    return (lambda x: x) if x == types.boolean else None
