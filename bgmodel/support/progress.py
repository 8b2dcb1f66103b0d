"""How far a long loop is: whoever wants to know listens around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LISTENER: ContextVar[Callable[[int], object] | None] = ContextVar("listener", default=None)


@contextmanager
def shown_by(listener: Callable[[int], object]) -> Iterator[None]:
    """Let a function hear of every part of the trials that circuits decide inside.

    Parameters
    ----------
    listener : function
        It is given the number of trials of each part, as ``tqdm.update``.
    """
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def advance(trials: int) -> None:
    """Tell the listener, if there is one, that so many trials are decided."""
    if (listener := _LISTENER.get()) is not None:
        listener(trials)
