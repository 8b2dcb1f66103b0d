"""Pools of processes for work whose results do not depend on their number."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def processes(
    workers: int, receive: Callable[..., object] | None = None, held: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes, one thread each; after an error their work is dropped.

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
    with ProcessPoolExecutor(workers, context, initializer=receive, initargs=held) as pool:
        try:
            yield pool
        except BaseException:
            # Unfinished work is dropped: what is stored is complete, or missing.
            for child in active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
