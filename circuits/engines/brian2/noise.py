"""``circuits.dynamics.noise`` as functions of Brian2, for arrays of keys."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Integers
from circuits.cells import single as arithmetic
from circuits.dynamics import noise


def _u32(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    return np.atleast_1d(np.asarray(values)).astype(np.uint32)


def tick_key(stream: Integers, tick: Integers) -> Integers:
    """Return ``noise.tick_key`` as one int64, for arrays of streams (int64) and ticks."""
    z = np.atleast_1d(tick).astype(np.uint64) + np.uint64(1)
    z = np.atleast_1d(stream).astype(np.uint64) + z * np.uint64(noise.GOLDEN)
    return noise.mix_all(z).astype(np.int64)


def random_word(cell: Integers, key: Integers) -> Integers:
    """Return ``noise.words`` as int32, for arrays of cells and of keys."""
    return noise.lowbias32(_u32(cell), _u32(np.asarray(key) >> 32), _u32(key)).astype(np.int32)


def byte_counts(cell: Integers, key: Integers) -> Integers:
    """Return ``noise.byte_counts`` of the words: noise of four ticks, for ``gauss``."""
    return noise.byte_counts(_u32(random_word(cell, key))).astype(np.int32)


def ones(counts: Integers, tick: Integers) -> npt.NDArray[np.float64]:
    """Return the number of ones in the byte of a tick."""
    shift = (8 * (np.asarray(tick) % noise.TICKS_A_WORD)).astype(np.uint32)
    return ((_u32(counts) >> shift) & np.uint32(15)).astype(np.float64)


def single(x: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Round to single precision; Brian2 stores the result in double."""
    return np.asarray(arithmetic.single(x), dtype=np.float64)


def fused(a: npt.ArrayLike, b: npt.ArrayLike, c: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return ``a b + c`` of single-precision numbers, rounded once."""
    return np.asarray(arithmetic.fused(a, b, c), dtype=np.float64)


def exponential(x: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the single-precision exponential."""
    return np.asarray(arithmetic.exponential(x), dtype=np.float64)


_INT, _FLOAT = "integer", "float"
FUNCTIONS: dict[str, tuple[Any, tuple[str, ...], str]] = {
    "tick_key": (tick_key, (_INT, _INT), _INT),
    "byte_counts": (byte_counts, (_INT, _INT), _INT),
    "ones": (ones, (_INT, _INT), _FLOAT),
    "single": (single, (_FLOAT,), _FLOAT),
    "fused": (fused, (_FLOAT, _FLOAT, _FLOAT), _FLOAT),
    "exponential": (exponential, (_FLOAT,), _FLOAT),
    "chosen": (np.where, ("boolean", _FLOAT, _FLOAT), _FLOAT),
}
"""Functions available to the Brian2 code, with the types of their arguments and results."""


def load_brian() -> ModuleType:
    """Import Brian2 without letting it take over error reporting."""
    hook = sys.excepthook
    import brian2

    sys.excepthook = hook
    module: ModuleType = brian2
    return module


def functions() -> dict[str, Any]:
    """Return the functions that the code calls, as Brian2 functions by name."""
    return {name: _function(*given) for name, given in FUNCTIONS.items()}


def looked_up(table: Array) -> Any:
    """Return a table (rows, ticks) as a Brian2 function of row and tick; the last tick persists."""

    def at(row: Integers, tick: Integers) -> Array:
        return np.asarray(table[row, np.minimum(tick, table.shape[1] - 1)])

    return _function(at, (_INT, _INT), _FLOAT)


def _function(function: Any, arguments: tuple[str, ...], result: str) -> Any:
    made = load_brian().Function(
        function,
        arg_units=[1] * len(arguments),
        return_unit=1,
        arg_types=list(arguments),
        return_type=result,
    )
    made.implementations.add_implementation("numpy", function)
    return made
