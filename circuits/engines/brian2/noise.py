"""``circuits.noise`` as functions of Brian2, for arrays of keys: in NumPy and in C, bit by bit."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits import noise

Ints = npt.NDArray[Any]

_WORD = """
    unsigned int x = (unsigned int)cell * 0x9E3779B1U + (unsigned int)(key >> 32);
    x ^= x >> 16;
    x = x * 0x21F0AAADU + (unsigned int)key;
    x ^= x >> 15;
    x *= 0x735A2D97U;
    x ^= x >> 15;
"""

_C = {
    "tick_key": (
        "long long tick_key(long long stream, long long tick)",
        """
    unsigned long long z = (unsigned long long)stream
        + ((unsigned long long)tick + 1ULL) * 0x9E3779B97F4A7C15ULL;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return (long long)(z ^ (z >> 31));
""",
    ),
    "random_word": ("int random_word(int cell, long long key)", _WORD + "    return (int)x;\n"),
    "byte_counts": (
        "int byte_counts(int cell, long long key)",
        _WORD
        + """
    x = x - ((x >> 1) & 0x55555555U);
    x = (x & 0x33333333U) + ((x >> 2) & 0x33333333U);
    return (int)((x + (x >> 4)) & 0x0F0F0F0FU);
""",
    ),
    "ones": (
        "double ones(int word, long long tick)",
        "\n    return (double)(((unsigned int)word >> (8 * (int)(tick & 3))) & 15U);\n",
    ),
    "gauss": (
        "double gauss(int word, long long tick)",
        """
    int ones = (int)(((unsigned int)word >> (8 * (int)(tick & 3))) & 15U);
    return (ones - 4) / 1.4142135623730951;
""",
    ),
    "chance": (
        "double chance(int word)",
        "\n    return (double)(unsigned int)word / 4294967296.0;\n",
    ),
    "single": (
        "double single(double x)",
        "\n    return (double)(float)x;\n",
    ),
    "chosen": (
        "double chosen(int test, double a, double b)",
        "\n    return test ? a : b;\n",
    ),
}


def _u32(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    return np.atleast_1d(np.asarray(values)).astype(np.uint32)


def tick_key(stream: Ints, tick: Ints) -> Ints:
    """Return ``noise.tick_key`` as one int64, for arrays of streams (int64) and ticks."""
    z = np.atleast_1d(tick).astype(np.uint64) + np.uint64(1)
    z = np.atleast_1d(stream).astype(np.uint64) + z * np.uint64(noise.GOLDEN)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (z ^ (z >> np.uint64(31))).astype(np.int64)


def random_word(cell: Ints, key: Ints) -> Ints:
    """Return ``noise.words`` as int32, for arrays of cells and of keys."""
    x = _u32(cell) * np.uint32(noise.SPREAD) + _u32(np.asarray(key) >> 32)
    x ^= x >> np.uint32(16)
    x = x * np.uint32(noise.FIRST) + _u32(key)
    x ^= x >> np.uint32(15)
    x *= np.uint32(noise.SECOND)
    return (x ^ (x >> np.uint32(15))).astype(np.int32)


def byte_counts(cell: Ints, key: Ints) -> Ints:
    """Return ``noise.byte_counts`` of the words: noise of four ticks, for ``gauss``."""
    return noise.byte_counts(_u32(random_word(cell, key))).astype(np.int32)


def ones(counts: Ints, tick: Ints) -> npt.NDArray[np.float64]:
    """Return the number of ones in the byte of a tick."""
    shift = (8 * (np.asarray(tick) % noise.TICKS_A_WORD)).astype(np.uint32)
    return ((_u32(counts) >> shift) & np.uint32(15)).astype(np.float64)


def gauss(counts: Ints, tick: Ints) -> npt.NDArray[np.float64]:
    """Return ``noise.bits8`` at a tick."""
    return (ones(counts, tick) - 4) / np.sqrt(2)


def single(x: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Round to single precision."""
    return np.asarray(x, dtype=np.float32).astype(np.float64)


def chance(word: Ints) -> npt.NDArray[np.float64]:
    """Return the number in [0, 1) that a word stands for."""
    return _u32(word) / 2.0**32


_NUMPY = {
    "tick_key": tick_key,
    "random_word": random_word,
    "byte_counts": byte_counts,
    "ones": ones,
    "gauss": gauss,
    "chance": chance,
    "single": single,
    "chosen": np.where,
}
_KINDS = {"int": "integer", "long": "integer", "double": "float"}


def load_brian() -> ModuleType:
    """Return Brian2, without its taking over how errors are reported."""
    hook = sys.excepthook
    import brian2

    sys.excepthook = hook
    return brian2


def functions() -> dict[str, Any]:
    """Return what the texts call, as Brian2 functions by name."""
    made = {}
    for name, (declared, body) in _C.items():
        arguments = [part.split()[0] for part in declared.split("(")[1].split(", ")]
        types = [_KINDS[kind] for kind in arguments]
        f = load_brian().Function(
            _NUMPY[name],
            arg_units=[1] * len(types),
            return_unit=1,
            arg_types=["boolean", *types[1:]] if name == "chosen" else types,
            return_type=_KINDS[declared.split()[0]],
        )
        code = f"static inline {declared} {{{body}}}\n"
        cython = f'cdef extern from *:\n    """\n{code}    """\n    {declared} nogil\n'
        for target, text in (("numpy", _NUMPY[name]), ("cython", cython), ("cpp", code)):
            f.implementations.add_implementation(target, text)
        made[name] = f
    return made
