"""Pools of processes for work whose results do not depend on their number."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.synchronize import Event
from threading import Lock, Thread
from typing import Any

from circuits.errors import InputError

SharedMap = Callable[[Callable[..., Any], Iterable[tuple[Any, ...]]], list[Any]]
"""Calls ``function(shared, *arguments)`` for each tuple of arguments, and returns the results in
order. ``shared`` is the same for every call, and is sent to each process once."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def processes(
    workers: int, receive: Callable[..., object] | None = None, held: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of single-threaded processes; after an error their work is dropped.

    They end with the process that started them, even if it is killed. ``receive`` is called once in
    each with ``held``, so that large data are sent once. ValueError if a process was killed, or the
    script has no ``if __name__ == "__main__"``.
    """
    end_if_imported()
    os.environ.update(dict.fromkeys(THREADS, "1"))
    context = get_context("spawn")
    begun = context.Event()
    with ProcessPoolExecutor(workers, context, _begin, (begun, receive, held)) as pool:
        try:
            yield pool
        except BaseException as error:
            # Unfinished work is dropped: what is stored is complete, or missing.
            for child in active_children():
                child.terminate()
            if not isinstance(error, BrokenProcessPool):
                raise
            if begun.is_set():
                raise ValueError("a worker process was killed: use fewer workers") from None
            script = 'in a script without `if __name__ == "__main__":`, which every worker runs'
            raise InputError.of("workers", f"must be 1 {script}", workers) from None
        finally:
            pool.shutdown(cancel_futures=True)


def end_if_imported() -> None:
    """End a worker that still imports the script of its command: the command says why."""
    if getattr(current_process(), "_inheriting", False):
        sys.exit(1)


def local_map(shared: Any) -> SharedMap:
    """Return a map that runs in this process."""
    return lambda function, jobs: [function(shared, *arguments) for arguments in jobs]


@contextmanager
def shared_map(workers: int, shared: Any) -> Iterator[SharedMap]:
    """Yield a map over a pool of processes, or in this process if ``workers`` is 1.

    Linear algebra always uses one thread: results differ by rounding between numbers of threads.
    """
    if workers == 1:
        with _one_thread():
            yield local_map(shared)
        return
    with processes(workers, _share, (shared,)) as pool:
        yield lambda function, jobs: list(pool.map(partial(_with_shared, function), jobs))


_LOCK = Lock()
_limits: list[Any] = []
"""One entry for each block that is within ``_one_thread``; the first has the earlier limits."""


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit linear algebra to one thread until the last of overlapping blocks has ended."""
    from threadpoolctl import threadpool_limits

    with _LOCK:
        _limits.append(None if _limits else threadpool_limits(1, user_api="blas"))
    try:
        yield
    finally:
        with _LOCK:
            if len(_limits) == 1:
                _limits[0].restore_original_limits()
            _limits.pop()


_shared: list[Any] = []


def _share(shared: Any) -> None:
    _shared[:] = [shared]


def _with_shared(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return function(_shared[0], *arguments)


def _begin(begun: Event, receive: Callable[..., object] | None, held: tuple[Any, ...]) -> None:
    """Begin a process of a pool."""
    begun.set()
    Thread(target=_end_with_parent, daemon=True).start()
    if receive is not None:
        receive(*held)


def _end_with_parent() -> None:
    """Wait for the end of the process that started this one, then end this one."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


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
