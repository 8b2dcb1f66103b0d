"""Memory requirements of a run, checked before it starts."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

from circuits.errors import InputError

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
