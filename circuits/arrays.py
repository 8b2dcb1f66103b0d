"""Array type aliases, one per kind of number, and files of arrays."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.errors import InputError

Array = npt.NDArray[np.float64]
"""Numbers in double precision, used unless stated otherwise."""
Singles = npt.NDArray[np.float32]
"""Numbers in single precision, used for taps."""
Reals = npt.NDArray[np.floating]
"""Numbers in either precision."""
Image = npt.NDArray[np.uint8]
"""Grey values of pixels, row by row from the top."""
Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.intp]
"""Indices into another array."""
Integers = npt.NDArray[np.integer]
Truths = npt.NDArray[np.bool_]
Arrays = dict[str, npt.NDArray[Any]]


END = 22
"""Bytes of the record at the end of an .npz file; from the tenth on, the number of its arrays."""


def read_arrays(path: Path) -> Arrays:
    """Return the arrays of an .npz file; OSError or ValueError if it is missing or damaged."""
    try:
        # A damaged shape may end an array before the checksum, which NumPy then does not compare.
        with zipfile.ZipFile(path) as file, path.open("rb") as end:
            if damaged := file.testzip():
                raise ValueError(f"{damaged} is damaged")
            # A damaged entry of the directory may hide the next one, which zipfile does not count.
            end.seek(-END, os.SEEK_END)
            if len(file.namelist()) != int.from_bytes(end.read()[10:12], "little"):
                raise ValueError("its directory is damaged")
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except OSError:
        raise
    except Exception as error:  # of any class, such as MemoryError for a shape of 10^12
        why = str(error).partition("\n")[0] or type(error).__name__
        raise InputError(f"{str(path)!r} can't be read as .npz: {why}", "path") from None
