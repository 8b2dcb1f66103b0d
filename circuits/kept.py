"""Arrays kept between runs in the user's cache folder, next to the compiled code.

They are stored under a hash of all sources, so that another version makes them anew. Nothing
depends on them but the time of the first call: a file that cannot be read or written is ignored.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt

from circuits.compiled_code import cache_folder, locked

Arrays = dict[str, npt.NDArray[np.float64]]


def kept(sources: str, key: str, make: Callable[[], Arrays]) -> Arrays:
    """Return arrays made earlier under a key, or make and keep them.

    Parameters
    ----------
    sources : str
        Hash of all sources that the arrays depend on.
    key : str
        Everything else that they depend on.
    make : callable
        Function that makes them, called if they are not found.
    """
    root = cache_folder(os.environ.get("NUMBA_CACHE_DIR", ""))
    if root is None:
        return make()
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    path = root / sources / "tables" / f"{name}.npz"
    if (found := _read(path)) is not None:
        return found
    with locked(path.with_suffix(".lock")):
        if (found := _read(path)) is None:
            found = make()
            _write(path, found)
    return found


def _read(path: Path) -> Arrays | None:
    """Return the arrays of a file, or None if it cannot be read."""
    with suppress(OSError, EOFError, ValueError, zipfile.BadZipFile), np.load(path) as file:
        return dict(file)
    return None


def _write(path: Path, arrays: Arrays) -> None:
    """Write a file whole, or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            part = Path(folder) / path.name
            np.savez(part, allow_pickle=False, **arrays)
            part.replace(path)
    except OSError:
        return
