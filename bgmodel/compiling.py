"""Numba's compiler with the types of what it compiles, which Numba itself does not state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function on its first call and keep it on disk; threads run it side by side."""
    made: Function = numba.njit(cache=True, nogil=True)(function)
    return made


def inlined(function: Function) -> Function:
    """Compile a function into each that calls it."""
    made: Function = numba.njit(cache=True, nogil=True, inline="always")(function)
    return made
