"""Pools of processes for work whose results do not depend on their number."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any

Each = Callable[[Callable[..., Any], Iterable[tuple[Any, ...]]], list[Any]]
"""Maps a function over tuples of arguments, to which it adds what every call shares as the first;
returns the results in their order."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def processes(
    workers: int, receive: Callable[..., object] | None = None, held: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes, one thread each; after an error their work is dropped.

    They end with the process that started them, also where that is killed.

    Parameters
    ----------
    workers : int
        Number of processes.
    receive : function, optional
        Called once in each process, with ``held``: large data is then sent once.
    held : tuple
        Arguments of ``receive``.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
    context = get_context("spawn")
    begin = partial(_begin, receive, held)
    with ProcessPoolExecutor(workers, context, initializer=begin) as pool:
        try:
            yield pool
        except BaseException:
            # Unfinished work is dropped: what is stored is complete, or missing.
            for child in active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def here(held: Any) -> Each:
    """Return the map of ``mapped`` that computes in this process."""
    return lambda function, jobs: [function(held, *job) for job in jobs]


@contextmanager
def mapped(workers: int, held: Any) -> Iterator[Each]:
    """Yield a map that computes in this process, or in a pool of several.

    Parameters
    ----------
    workers : int
        Number of processes.
    held : object
        First argument of every call. A pool receives it once.
    """
    if workers == 1:
        yield here(held)
        return
    with processes(workers, _hold, (held,)) as pool:
        yield lambda function, jobs: list(pool.map(partial(_with_held, function), jobs))


_held: list[Any] = []


def _hold(held: Any) -> None:
    _held[:] = [held]


def _with_held(function: Callable[..., Any], job: tuple[Any, ...]) -> Any:
    return function(_held[0], *job)


def _begin(receive: Callable[..., object] | None, held: tuple[Any, ...]) -> None:
    """Begin a process of a pool."""
    Thread(target=_end_with_parent, daemon=True).start()
    if receive is not None:
        receive(*held)


def _end_with_parent() -> None:
    """Wait for the end of the process that started this one, then end this one."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
