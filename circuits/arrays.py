"""Array type aliases, one per kind of number, and files of arrays."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.errors import InputError

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.intp]
"""Indices into another array."""
Integers = npt.NDArray[np.integer]
Truths = npt.NDArray[np.bool_]
Arrays = dict[str, npt.NDArray[Any]]


def read_arrays(path: Path) -> Arrays:
    """Return the arrays of an .npz file; OSError or ValueError if it is missing or damaged."""
    try:
        # A damaged shape may end an array before the checksum, which NumPy then does not compare.
        with zipfile.ZipFile(path) as file:
            if damaged := file.testzip():
                raise ValueError(f"{damaged} is damaged")
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except OSError:
        raise
    except Exception as error:  # of any class, such as MemoryError for a shape of 10^12
        why = str(error).partition("\n")[0] or type(error).__name__
        raise InputError(f"{str(path)!r} can't be read as .npz: {why}", "path") from None
