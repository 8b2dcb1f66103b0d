"""Options of compiled code, and the records and edges that it reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import circuits
from circuits.compiled_code import compile_cached, sources_hash

OPTIONS = {
    # Not "reassoc": it would add in an order that depends on the loop around an expression. Not
    # "contract": a product would be rounded before it is added, or not, as the machine has it.
    "fastmath": {"nsz"},
    "error_model": "numpy",
    # No memory is taken inside, so no references are counted: that alone cost 600 ns a tick.
    "_nrt": False,
    "nogil": True,
    # A call hands over every array in parts: of populations of 100 cells that was 7 % of the time.
    "forceinline": True,
}
SOURCES = sources_hash(Path(circuits.__file__).parent)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function on its first call, or take it from the user's cache folder."""
    return compile_cached(function, SOURCES, **OPTIONS)


def record(**kinds: str) -> np.dtype:
    """Return a record type with the fields named under each NumPy type.

    Records keep a row of the table together; the compiler reads their fields without a detour.
    """
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
    found = records(dtype, len(rows), index=columns, weight=matrix[rows, columns])
    return starts, found
