"""Compiler options, and the records and edges used by compiled code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

import circuits
from circuits.compiled_code import compile_cached, sources_hash

OPTIONS = {
    # Not "reassoc": the order of additions would depend on the surrounding loop. Not "contract":
    # whether a product is rounded before it is added would depend on the machine.
    "fastmath": {"nsz"},
    "error_model": "numpy",
    # No memory is allocated inside, so references need no counting, which cost 600 ns per tick.
    "_nrt": False,
    "nogil": True,
    # Inlined: passing arrays took 7 % of the time with populations of 100 cells.
    "forceinline": True,
}
SOURCES = sources_hash(Path(circuits.__file__).parent)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function on its first call, or load it from the user's cache folder."""
    return compile_cached(function, SOURCES, **OPTIONS)


def part(function: Callable[..., Any]) -> Any:
    """Compile a function as part of those that call it; Python must not call it."""
    return numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS)(function)


def record(**kinds: str) -> np.dtype:
    """Return a record type with the fields named under each NumPy type."""
    pairs = [(name, kind) for kind, names in kinds.items() for name in names.split()]
    return np.dtype(pairs, align=True)


def records(dtype: np.dtype, count: int, /, **columns: Any) -> Any:
    """Return a record array with one column per keyword."""
    table = np.zeros(count, dtype)
    assert set(columns) == set(dtype.names or ())
    for name, values in columns.items():
        table[name] = values
    return table


def edges(dtype: np.dtype, matrix: np.ndarray) -> tuple[Any, Any]:
    """Return the first nonzero entry of each row, by number, and the entries as records."""
    rows, columns = np.nonzero(matrix)
    starts = np.searchsorted(rows, np.arange(len(matrix) + 1))
    entries = records(dtype, len(rows), index=columns, weight=matrix[rows, columns])
    return starts, entries
