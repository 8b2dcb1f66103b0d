"""Compiled functions, kept between runs in the user's cache folder.

By default Numba writes next to the source. When pip removes an installed package, it leaves that
folder behind, which then hides a later editable installation. Numba also checks only the file that
contains a function, so that after an edit elsewhere the old code would run without warning. Here
compiled functions are stored under a hash of all sources at the time of import.
"""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections.abc import Callable
from contextlib import nullcontext, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.errors import WarningsFixer  # type: ignore[attr-defined]  # not in its stub
from numba.core.serialize import dumps

from circuits.store import cache_folder, locked

_LOCK = threading.Lock()
"""Numba reads the cache folder from a process-wide setting."""
_COMPILING = ContextVar("compiling", default=False)
_CATCH = WarningsFixer.catch_warnings


def _catch(fixer: WarningsFixer, *place: Any, **named: Any) -> Any:
    """Replace Numba's filters of warnings, which are those of all threads, while we compile."""
    return nullcontext() if _COMPILING.get() else _CATCH(fixer, *place, **named)


WarningsFixer.catch_warnings = _catch


class CheckedFiles(IndexDataCacheFile):
    """Numba's files of a function, with a checksum: damaged code is not executed, but replaced."""

    def load(self, key: Any) -> Any:
        """Return what was saved under a key, or None if it is absent or damaged."""
        with suppress(Exception):  # of any class, since damaged pickles are read
            digest, content = super().load(key)
            if digest == hashlib.sha256(content).digest():
                known, data = pickle.loads(content)
                return data if known == key else None
        return None

    def save(self, key: Any, data: Any) -> None:
        """Save data under a key."""
        content = dumps((key, data))
        checked = hashlib.sha256(content).digest(), content
        try:
            super().save(key, checked)
        except Exception:
            self.flush()  # the index is damaged
            super().save(key, checked)


def sources_hash(package: Path) -> str:
    """Return a hash of Numba's version and of all sources in a folder, 16 hexadecimal digits."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def compile_cached(function: Callable[..., Any], sources: str, **options: Any) -> Any:
    """Return a function that is compiled on its first call, or loaded from the cache folder.

    The folder is ``NUMBA_CACHE_DIR`` if that is set, otherwise the user's cache folder. If it is
    not writable, every process compiles again. ``sources`` is the hash of all sources used by the
    function, from ``sources_hash``; the options are those of ``numba.njit``.
    """
    with _LOCK:
        before = numba.config.CACHE_DIR
        folder = cache_folder(before)
        numba.config.CACHE_DIR = str(folder and folder / sources)
        try:
            made = numba.njit(cache=folder is not None, **options)(function)
        finally:
            numba.config.CACHE_DIR = before
    name = f"{function.__module__}.{function.__qualname__}.lock"
    if folder:
        made._cache._cache_file.__class__ = CheckedFiles  # no argument of Numba sets it
    made.compile = partial(_compile_once, made.compile, folder and folder / sources / name)
    return made


def _compile_once(compile_now: Callable[[Any], Any], lock: Path | None, signature: Any) -> Any:
    """Compile while no other process compiles the same function, under a lock if it is kept."""
    token = _COMPILING.set(True)
    try:
        with nullcontext() if lock is None else locked(lock):
            return compile_now(signature)
    finally:
        _COMPILING.reset(token)
