"""Resources of a run: memory, pools of processes, and progress of long loops."""

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
from pathlib import Path
from threading import Lock, Thread
from typing import Any
from zipfile import ZipFile

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


def run_snakemake(arguments: list[str]) -> int:
    """Run Snakemake in this process; return its exit status.

    Ctrl-C also ends the processes of its steps, so that Snakemake need not wait for them and
    removes its lock.
    """
    import signal

    from snakemake.cli import args_to_api, parse_args

    stopped = []

    def stop(*_: object) -> None:
        stopped.append(True)
        for process in active_children():
            process.kill()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, stop)
    try:
        parser, options = parse_args(arguments)
        drawn = args_to_api(options, parser)
    finally:
        signal.signal(signal.SIGINT, before)
    if stopped:
        raise KeyboardInterrupt("The same command resumes where it stopped.")
    return 0 if drawn else 1


SMALL_BYTES = 1e8
"""Smaller runs skip the check."""
CELL_BYTES, TEXT_TIMES = 24, 2
"""Memory for reading, per cell of a parquet file, and at least per byte of a text file, bytes;
measured."""


class NoMemoryError(InputError):
    """A run needs more memory than is free."""


def check_memory(needed_bytes: float, what: str, field: str = "trials") -> None:
    """Raise NoMemoryError if a run needs more than is free; ``field`` is the argument to reduce."""
    if needed_bytes < SMALL_BYTES:
        return
    import psutil

    free = psutil.virtual_memory().available
    if needed_bytes > free:
        reason = f"{what} need {_size(needed_bytes)} of memory, {_size(free)} are free"
        raise NoMemoryError(reason, field)


def check_evidence_memory(trials: int, steps: int, hypotheses: int) -> None:
    """Raise ValueError if evidence of this shape and derived arrays do not fit into memory."""
    # Eight bytes per number: as drawn, summed, as OUT, and one intermediate array.
    needed = 4 * 8.0 * trials * steps * hypotheses
    check_memory(needed, f"{trials} trials of up to {steps} readings")


def check_learning_memory(runs: int, episodes: int) -> None:
    """Raise ValueError if the records of learning (per run and episode) do not fit."""
    check_memory(10 * 8 * float(runs) * episodes, f"{runs} runs of {episodes} episodes", "runs")


def check_table_memory(path: Path) -> None:
    """Raise NoMemoryError, before a table is read, if it does not fit into memory."""
    if path.suffix == ".npz":
        with ZipFile(path) as file:
            size = sum(each.file_size for each in file.infolist())
        check_memory(size, f"the arrays of {path.name!r}", "path")
        return
    if path.suffix != ".parquet":
        check_memory(TEXT_TIMES * path.stat().st_size, f"the rows of {path.name!r}", "path")
        return
    import pyarrow.parquet as pq

    about = pq.read_metadata(path)
    check_memory(
        float(CELL_BYTES) * about.num_rows * about.num_columns,
        f"{about.num_rows} rows of {about.num_columns} columns in {path.name!r}",
        "path",
    )


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} PB"
