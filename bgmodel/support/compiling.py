"""Numba's compiler, typed so that compiled functions keep their signatures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba.core import event

from circuits.compiled_code import compile_cached, sources_hash

Function = TypeVar("Function", bound=Callable[..., Any])
SOURCES = sources_hash(Path(__file__).parents[1])


def compiled(function: Function, **options: Any) -> Function:
    """Compile with ``numba.njit(**options)`` on first call, cached on disk; the GIL is released."""
    made: Function = compile_cached(function, SOURCES, nogil=True, **options)
    return made


def inlined(function: Function) -> Function:
    """Compile a function into each function that calls it."""
    return compiled(function, inline="always")


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
