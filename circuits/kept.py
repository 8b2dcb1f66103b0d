"""Arrays kept between runs in the user's cache folder, next to the compiled code.

They are stored under a hash of all sources, so that another version makes them anew. Nothing
depends on them but the time of the first call: a file that cannot be read or written is ignored.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from circuits.arrays import Arrays, read_arrays
from circuits.compiled_code import cache_folder, locked


def kept(sources: str, key: str, make: Callable[[], Arrays]) -> Arrays:
    """Return arrays made earlier under a key, or make and keep them.

    ``sources`` is the hash of all sources that they depend on; the key is everything else.
    """
    if (path := _path(sources, "tables", key)) is None:
        return make()
    if (arrays := _read(path)) is not None:
        return arrays
    with locked(path.with_suffix(".lock")):
        if (arrays := _read(path)) is None:
            arrays = make()
            _write(path, arrays)
    return arrays


def recall(sources: str, kind: str, key: str) -> Arrays | None:
    """Return arrays stored by ``remember`` in the folder ``kind``, or None."""
    path = _path(sources, kind, key)
    return None if path is None else _read(path)


def remember(sources: str, kind: str, key: str, arrays: Arrays, *, most: int) -> None:
    """Store arrays under a key, and forget all but the latest ``most`` of their kind."""
    if (path := _path(sources, kind, key)) is None:
        return
    _write(path, arrays)
    with suppress(OSError):
        stored = sorted(path.parent.glob("*.npz"), key=lambda each: each.stat().st_mtime)
        for old in stored[:-most]:
            old.unlink()


def _path(sources: str, kind: str, key: str) -> Path | None:
    """Return the file of a key, or None without a writable cache folder."""
    root = cache_folder(os.environ.get("NUMBA_CACHE_DIR", ""))
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return None if root is None else root / sources / kind / f"{name}.npz"


def _read(path: Path) -> Arrays | None:
    """Return the arrays of a file, or None if it cannot be read."""
    with suppress(OSError, ValueError):
        return read_arrays(path)
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
