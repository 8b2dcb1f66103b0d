"""Progress of long loops, reported to a listener."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LISTENER: ContextVar[Callable[[int], object] | None] = ContextVar("listener", default=None)


@contextmanager
def shown_by(listener: Callable[[int], object]) -> Iterator[None]:
    """Call a listener with the number of trials of each batch decided within the block."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def advance(trials: int) -> None:
    """Report a number of decided trials to the listener, if there is one."""
    if (listener := _LISTENER.get()) is not None:
        listener(trials)
