"""Compiled functions, kept between runs in the user's cache folder.

By default Numba writes next to the source. When pip removes an installed package, it leaves that
folder behind, which then hides a later editable installation. Numba also checks only the file that
contains a function, so that after an edit elsewhere the old code would run without warning. Here
compiled functions are stored under a hash of all sources at the time of import.
"""

from __future__ import annotations

import hashlib
import tempfile
import threading
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs

_LOCK = threading.Lock()
"""Numba reads the cache folder from a process-wide setting."""


def sources_hash(package: Path) -> str:
    """Return a hash of Numba's version and of all sources in a folder, 16 hexadecimal digits."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def compile_cached(function: Callable[..., Any], sources: str, **options: Any) -> Any:
    """Return a function that is compiled on its first call, or loaded from the cache folder.

    The folder is ``NUMBA_CACHE_DIR`` if that is set, otherwise the user's cache folder. If it
    is not writable, every process compiles again.

    Parameters
    ----------
    function : callable
        Python function.
    sources : str
        Hash of all sources used by the function, from ``sources_hash``.
    **options
        Options of ``numba.njit``.
    """
    with _LOCK:
        before = numba.config.CACHE_DIR
        folder = cache_folder(before)
        numba.config.CACHE_DIR = str(folder and folder / sources)
        try:
            return numba.njit(cache=folder is not None, **options)(function)
        finally:
            numba.config.CACHE_DIR = before


@cache
def cache_folder(chosen: str) -> Path | None:
    """Return the folder for compiled code; warn and return None if it cannot be written."""
    root = Path(chosen).absolute() if chosen else platformdirs.user_cache_path("bgmodel")
    folder = root / "compiled"
    try:
        # Without a home folder the path is relative and would depend on the working directory.
        if not folder.is_absolute():
            raise OSError("there is no home folder")
        folder.mkdir(parents=True, exist_ok=True)
        # The file has content because an empty one can be created even on a full disk.
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(4096))
    except OSError as error:
        # Not a UserWarning: those are stored in results, which must not depend on the machine.
        warnings.warn(
            f"compiled code is not cached, so every run compiles again: {str(root)!r} is not "
            f"writable ({error.strerror or error}); set NUMBA_CACHE_DIR to a writable folder",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    return folder
