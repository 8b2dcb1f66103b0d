"""``circuits.dynamics.noise`` as functions of Brian2, for arrays of keys.

Scripts hold the source of these functions (``script``): the names are those of no other function
that they call.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Integers
from circuits.cells.renewal import wait
from circuits.cells.single import choose, exponential, fused, single
from circuits.dynamics.noise import (
    GOLDEN,
    GOLDEN_32,
    TICKS_A_WORD,
    byte_counts,
    lowbias32,
    mix_all,
)


def unsigned(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Return whole numbers as an array of 32 bits each."""
    return np.atleast_1d(np.asarray(values)).astype(np.uint32)


def keys_at(stream: npt.ArrayLike, tick: npt.ArrayLike) -> Integers:
    """Return the key of each stream at a tick, both halves as one int64 (``noise.tick_key``)."""
    z = np.atleast_1d(np.asarray(tick)).astype(np.uint64) + np.uint64(1)
    z = np.atleast_1d(np.asarray(stream)).astype(np.uint64) + z * np.uint64(GOLDEN)
    return mix_all(z).astype(np.int64)


def random_word(cell: Integers, key: Integers) -> Integers:
    """Return the random word of each cell under its key, int32 (``noise.words``)."""
    halves = unsigned(np.asarray(key) >> 32), unsigned(key)
    return lowbias32(unsigned(cell), *halves).astype(np.int32)


def noise_bytes(cell: Integers, key: Integers) -> Integers:
    """Return the ones in each byte of the cells' random words: the noise of four ticks."""
    return byte_counts(unsigned(random_word(cell, key))).astype(np.int32)


def ones_at(counts: Integers, tick: Integers) -> npt.NDArray[np.float64]:
    """Return the number of ones in the byte of a tick."""
    shift = (8 * (np.asarray(tick) % TICKS_A_WORD)).astype(np.uint32)
    return ((unsigned(counts) >> shift) & np.uint32(15)).astype(np.float64)


def interval_after(
    tables: Array, of_cells: npt.ArrayLike, cell: Integers, fired: Integers, key: Integers
) -> Array:
    """Return the interval after each renewal cell's spikes so far (``noise.train_words``).

    The table is that of the row ``of_cells``, the same for all cells of a group.
    """
    index = unsigned(cell) + unsigned(fired) * np.uint32(GOLDEN_32)
    word = lowbias32(index, unsigned(np.asarray(key) >> 32), unsigned(key))
    return wait(tables[int(np.max(of_cells))], word)


def load_brian() -> ModuleType:
    """Import Brian2 without letting it take over error reporting."""
    hook = sys.excepthook
    import brian2

    sys.excepthook = hook
    module: ModuleType = brian2
    return module


def functions(brian: Any, intervals: Array) -> dict[str, Any]:
    """Return the functions that the code calls, as functions of the module ``brian2`` by name.

    The rows of ``intervals`` are the tables of renewal cells.
    """
    integer, real = "integer", "float"
    table: dict[str, tuple[Any, list[str], str]] = {
        "tick_key": (keys_at, [integer, integer], integer),
        "byte_counts": (noise_bytes, [integer, integer], integer),
        "ones": (ones_at, [integer, integer], real),
        "single": (single, [real], real),
        "fused": (fused, [real, real, real], real),
        "exponential": (exponential, [real], real),
        "chosen": (choose, ["boolean", real, real], real),
        "interval": (lambda *which: interval_after(intervals, *which), [integer] * 4, real),
    }
    made = {}
    for name, (function, takes, returns) in table.items():
        types = {"arg_types": takes, "return_type": returns}
        units = {"arg_units": [1] * len(takes), "return_unit": 1}
        made[name] = brian.Function(function, **types, **units)
        made[name].implementations.add_implementation("numpy", function)
    return made
