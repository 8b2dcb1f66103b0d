"""The store of what is computed once: in files named by their keys, or in memory.

A key is all that a value depends on. It names the file together with the version of the code, so
that nothing overwrites a value of another key or version, and it is compared with the copy in the
file. Files are written completely or not at all, and damaged ones count as absent.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import tempfile
import threading
import warnings
from collections.abc import Callable, Hashable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, cached_property, wraps
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from circuits.arrays import Arrays, read_arrays
from circuits.errors import InputError

Value = TypeVar("Value")
KEY = "key"
"""Name of the array that holds version and key, as JSON."""
_THREAD = threading.local()
_MOST_WAITING_S = 120.0


@dataclass(frozen=True)
class Entry(Generic[Value]):
    """A value and its place in the store, an .npz file; without a folder, it is not kept."""

    folder: Path | None  # created with the first file
    version: str  # of the code that computes the value
    key: Any  # all that the value depends on, as JSON has it
    pack: Callable[[Value], Arrays]
    unpack: Callable[[Arrays], Value]
    title: str = ""  # beginning of the file's name, for people
    most: int | None = None  # largest number of files in the folder: the oldest are removed
    spare: bool = False  # whether a file that can't be written costs only time, and raises nothing

    @cached_property
    def text(self) -> str:
        """Version and key as JSON."""
        return json.dumps([self.version, self.key], sort_keys=True)

    @property
    def path(self) -> Path:
        """The file, which may not exist."""
        name = hashlib.sha256(self.text.encode()).hexdigest()[:24]
        return Path(self.folder or "") / f"{safe(self.title)} {name}.npz".lstrip()

    def get(self) -> Value | None:
        """Return the stored value; None without a complete file of this version and key."""
        if self.folder is None:
            return None
        with suppress(OSError, ValueError, KeyError):
            arrays = read_arrays(self.path)
            if str(arrays.pop(KEY)) == self.text:
                return self.unpack(arrays)
        return None

    def put(self, value: Value) -> None:
        """Store a value, and remove the oldest of the folder if there are too many."""
        if self.folder is None:
            return
        arrays: dict[str, Any] = {KEY: np.array(self.text), **self.pack(value)}
        with self._writing():
            with replacing(self.path) as partial, partial.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            if self.most is not None:
                stored = sorted(self.folder.glob("*.npz"), key=lambda each: each.stat().st_mtime)
                for old in stored[: -self.most]:
                    old.unlink(missing_ok=True)

    def once(self, make: Callable[[], Value]) -> Value:
        """Return the stored value, or make and store it; a process that makes it is awaited."""
        if self.folder is None:
            return make()
        if (value := self.get()) is not None:
            return value
        with self._writing():  # fail before the computation
            self.path.parent.mkdir(parents=True, exist_ok=True)
        lock = self.path.with_suffix(".lock")
        with locked(lock):
            if (value := self.get()) is None:
                value = make()
                self.put(value)
            with suppress(OSError):
                lock.unlink()  # a process that still waits for it finds the value
        return value

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Say in a sentence that the folder can't be written, unless the file is spare."""
        try:
            yield
        except OSError as error:
            if not self.spare:
                why = f"{str(self.folder)!r} can't be written: {error.strerror}"
                raise InputError(f"{why}; what is finished is kept", "folder") from error


def cached(kind: str, sources: str, key: str, *, most: int | None = None) -> Entry[Arrays]:
    """Return an entry of arrays in the user's cache folder, next to the compiled code.

    ``sources`` is the hash of all sources that the arrays depend on.
    """
    root = cache_folder(os.environ.get("NUMBA_CACHE_DIR", ""))
    folder = None if root is None else root / sources / kind
    return Entry(folder, sources, key, dict, dict, most=most, spare=True)


@dataclass(frozen=True)
class Latest:
    """Values in memory, the latest ``most`` of each kind."""

    most: int
    kinds: dict[str, dict[Hashable, Any]] = field(default_factory=dict)

    def once(self, kind: str, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return a value computed earlier, or compute it; that of the key None is never kept."""
        if key is None:
            return make()
        values = self.kinds.setdefault(kind, {})
        if key not in values:
            values[key] = make()
            for old in [*values][: -self.most]:
                del values[old]
        value: Value = values[key]
        return value


def once(method: Callable[..., Value]) -> Callable[..., Value]:
    """Compute a method once for its arguments, in ``self.cache``; an error is raised each time."""

    @wraps(method)
    def cached(self: Any, *arguments: Hashable) -> Value:
        key = (method.__name__, *arguments)
        if key not in self.cache:
            try:
                self.cache[key] = method(self, *arguments)
            except Exception as reason:
                self.cache[key] = reason
        if isinstance(result := self.cache[key], Exception):
            raise result
        value: Value = result
        return value

    return cached


def safe(title: str) -> str:
    """Return a title as a file name: invalid characters become _, and a hash is added."""
    plain = re.sub(r"[^\w .+=-]", "_", title)
    return plain if plain == title else f"{plain} {hashlib.sha256(title.encode()).hexdigest()[:10]}"


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path, renamed to the final name once written, or removed on errors."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{secrets.token_hex(8)}.partial.{path.name}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def remove_partial_files(folder: str | Path) -> None:
    """Remove temporary files of killed writers in and below a folder; no writer may be active."""
    for partial in Path(folder).rglob(".*.partial.*"):
        partial.unlink()


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a file's lock, so that another process finds what this one makes and stores.

    A thread holds no second lock: two threads could wait for each other. Without the lock, because
    the folder has none or the wait is too long, both processes do the work.
    """
    from filelock import FileLock, Timeout

    if getattr(_THREAD, "locked", False):
        yield
        return
    with ExitStack() as held:
        with suppress(OSError, NotImplementedError, Timeout):
            path.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(FileLock(path, timeout=_MOST_WAITING_S))
        _THREAD.locked = True
        try:
            yield
        finally:
            _THREAD.locked = False


@cache
def cache_folder(chosen: str) -> Path | None:
    """Return the folder for compiled code; warn and return None if it cannot be written."""
    import platformdirs

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
