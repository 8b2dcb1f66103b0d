"""Files: written atomically, with the parameters, seed and versions behind them."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from bgmodel.support import __version__
from bgmodel.support.checks import path_of
from bgmodel.support.processes import NoMemoryError, check_table_memory
from circuits import arrays
from circuits.errors import InputError
from circuits.store import Entry
from circuits.store import remove_partial_files as remove_partial_files
from circuits.store import replacing as replacing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PACKAGES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "torch")
KEY, CHECK = b"bgmodel", b"bgmodel checksum"
MOST_NAME_BYTES = 200
"""Longest name of a result, bytes: temporary files have longer names."""
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
"""Endings of images of taps."""
PLACES = ("*", "*/*", "../frames_bw/*")
"""Where a folder of recordings has its tables and images."""
FIELDS = {"parameters", "seed", "versions"}
"""Keys of the provenance."""


def provenance(seed: int | None = None, **parameters: Any) -> dict[str, Any]:
    """Return parameters, seed and versions; no time or machine, so that bytes are repeatable."""
    return {
        "parameters": {name: _plain(value) for name, value in parameters.items()},
        "seed": seed,
        "versions": {
            "python": platform.python_version(),
            "bgmodel": __version__,
            **{name: version for name in PACKAGES if (version := _version(name))},
        },
    }


def write_table(
    table: pd.DataFrame, path: str | Path, *, seed: int | None = None, **parameters: Any
) -> Path:
    """Write a table atomically, with its provenance: inside ``.parquet``, beside ``.csv``.

    ValueError if the ending is neither, the folder can't be written, or a file ``<name>.csv.json``
    exists that is not a provenance.
    """
    path = path_of(path)
    if path.suffix not in (".parquet", ".csv"):
        raise InputError(f"a table is written as .parquet or .csv, got {str(path)!r}", "path", path)
    text = json.dumps(provenance(seed, **parameters), indent=1, sort_keys=True)
    check_writable(path.parent)
    check_provenance_place(path)
    if path.suffix == ".parquet":
        with replacing(path) as partial:
            _write_parquet(table, partial, text)
        return path
    # Both are renamed once both are written.
    with replacing(path) as partial, replacing(provenance_path(path)) as beside:
        table.to_csv(partial, index=False)
        beside.write_text(text + "\n")
    return path


def json_text(
    parts: Mapping[str, Any],
    path: str | Path | None = None,
    *,
    indent: int | None = 1,
    digits: int = 10,
) -> str:
    """Return a result as JSON, its tables as lists of rows; it is also written to a path.

    Numbers that are not finite are null, and paths are text.
    """
    plain = {}
    for name, part in parts.items():
        if hasattr(part, "to_json"):
            part = json.loads(part.to_json(orient="records", double_precision=digits))
        unknown = isinstance(part, float) and not np.isfinite(part)
        plain[name] = None if unknown else str(part) if isinstance(part, Path) else part
    text = json.dumps(plain, indent=indent)
    if path is not None:
        with replacing(path) as partial:
            partial.write_text(text + "\n", encoding="utf-8")
    return text


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a .pdf, .svg or .png file, atomically, without times or versions."""
    from circuits.plots import saved

    left_out = {".png": {"Software": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
    with replacing(path) as partial:
        saved(figure, partial, format=path.suffix[1:], metadata=left_out)


def provenance_path(path: str | Path) -> Path:
    """Return the path of the provenance of a ``.csv``: the whole name and ``.json``."""
    path = Path(path)
    return path.with_name(path.name + ".json")


def check_provenance_place(path: str | Path) -> None:
    """Raise ValueError if the provenance of a table would overwrite another kind of file."""
    place = provenance_path(path)
    if Path(path).suffix != ".csv" or not place.exists():
        return
    if not is_result(path):
        raise InputError(f"{str(place)!r} is not a file of parameters: move it", "path")


def check_new(path: str | Path, *, force: bool = False) -> None:
    """Raise ValueError unless a result may be written to a path; ``force`` allows a file there.

    A folder is never replaced, nor a file next to a ``.csv`` that is not a provenance.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{str(path)!r} is a folder: a result needs a file's name", "path", path)
    if len(path.name.encode()) > MOST_NAME_BYTES:
        raise InputError(f"a file's name has at most {MOST_NAME_BYTES} bytes", "path", path.name)
    if not force and (path.exists() or path.is_symlink()):
        way = "give another name, or force=True, at the terminal --force"
        raise InputError(f"{str(path)!r} already exists: {way}", "path")
    check_provenance_place(path)


def is_result(path: str | Path) -> bool:
    """Whether a file is a table with provenance, which a result may replace."""
    try:
        return bool(read_provenance(path))
    except (OSError, ValueError):
        return False


def checksum(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def checksum_entry(path: Path, key: Any) -> Entry[str]:
    """Return the place of the checksum of a file, by all that the file depends on."""
    return Entry(path.parent / "steps", __version__, json.loads(json.dumps(key)),
                 lambda text: {"sha256": np.array(text)}, lambda arrays: str(arrays["sha256"]),
                 path.name)  # fmt: skip


def made_by(path: Path, key: Any) -> bool:
    """Whether a file is there that was made with this key, and has not changed since."""
    return path.is_file() and checksum_entry(path, key).get() == checksum(path)


def made_once(path: Path, key: Any, make: Callable[[], object]) -> bool:
    """Make a file unless the same key made the one that is there; return whether it was made."""
    if made_by(path, key):
        return False
    make()
    checksum_entry(path, key).put(checksum(path))
    return True


def read_table(path: str | Path) -> pd.DataFrame:
    """Read a ``.parquet`` or ``.csv`` table; ValueError with a clear reason if it can't be read."""
    import pandas as pd

    path = path_of(path)
    if not path.is_file():
        raise InputError(f"there is no table {str(path)!r}", "path", path)
    try:
        check_table_memory(path)
        if path.suffix == ".parquet":
            _metadata(path)
            return pd.read_parquet(path, page_checksum_verification=True)
        if path.suffix == ".csv":
            return pd.read_csv(path)
    except NoMemoryError:
        raise
    except Exception as error:  # a damaged file may raise an error of any class
        raise unreadable(path, error) from error
    raise InputError(f"a table is read from .parquet or .csv, got {str(path)!r}", "path", path)


def unreadable(path: Path, error: Exception) -> InputError:
    """Return the error for an unreadable table, with the first line of the reason."""
    reason = str(error).strip().partition("\n")[0] or type(error).__name__
    if isinstance(error, UnicodeDecodeError):
        reason = 'it is not text in UTF-8: save it so, in Excel as "CSV UTF-8"'
    return InputError(f"{str(path)!r} can't be read as {path.suffix}: {reason}", "path", path)


def read_arrays(path: str | Path) -> arrays.Arrays:
    """Return the arrays of an .npz file; OSError or ValueError if it can't be read."""
    with suppress(BadZipFile):  # said below
        check_table_memory(Path(path))
    return arrays.read_arrays(Path(path))


def read_provenance(path: str | Path) -> dict[str, Any]:
    """Return the provenance stored by ``write_table``; OSError or ValueError without one."""
    path = Path(path)
    if path.suffix == ".csv":
        provenance_read = from_json(provenance_path(path).read_text())
    else:
        try:
            provenance_read = from_json(_metadata(path)[KEY])
        except OSError:
            raise
        except Exception as error:  # a damaged file may raise an error of any class
            raise unreadable(path, error) from None
    if not isinstance(provenance_read, dict) or set(provenance_read) != FIELDS:
        raise InputError(f"{str(path)!r} has no provenance", "path", path)
    return provenance_read


def from_json(text: str | bytes) -> Any:
    """Return the value of a JSON text; ValueError for invalid JSON, or one nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def recorded(value: Any) -> Any:
    """Return an option as recorded: only what had an effect, and files by name and checksum.

    The checksum of a folder is that of its targets and images, also of those in ``PLACES`` that
    parts of a recording share.
    """
    if hasattr(value, "used"):
        return {name: recorded(inner) for name, inner in value.used().items()}
    if is_dataclass(value):
        named = {field.name: recorded(getattr(value, field.name)) for field in fields(value)}
        return {"kind": type(value).__name__, **named}
    path = circuit_file(value) if isinstance(value, str) else value
    if isinstance(path, Path) and path.is_file():
        return {"file": path.name, "sha256": checksum(path)}
    if not isinstance(value, Path):
        return value
    digest = hashlib.sha256()
    for part in sorted(each for place in PLACES for each in value.glob(place) if each.is_file()):
        if part.suffix.lower() in IMAGES or part.match("targets*.csv"):
            digest.update(f"{part.relative_to(value).as_posix()} {checksum(part)}\n".encode())
    return {"folder": value.name, "sha256": digest.hexdigest()}


def circuit_file(name: str) -> Path | None:
    """Return the path of a circuit that is a file; None for the name of a table."""
    return Path(name) if name.endswith(".toml") else None


def check_writable(folder: str | Path) -> Path:
    """Return a folder, which may not exist yet, as an absolute path; ValueError if not writable."""
    folder = Path(os.path.abspath(folder))
    there = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        # Permissions do not show a read-only or full disk: try to write.
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"the output folder {str(folder)!r} can't be written: {error.strerror}", "folder"
        ) from error
    return folder


@cache
def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _write_parquet(table: pd.DataFrame, path: Path, text: str) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = pa.Table.from_pandas(table, preserve_index=False)
    about = {**data.schema.metadata, KEY: text.encode()}
    data = data.replace_schema_metadata({**about, CHECK: _digest(data.schema, about)})
    pq.write_table(data, path, compression="zstd", compression_level=9, write_page_checksum=True)


def _metadata(path: Path) -> dict[bytes, bytes]:
    """Return the metadata of a .parquet; ValueError if they or the columns were changed."""
    import pyarrow.parquet as pq

    schema = pq.read_schema(path)
    about = dict(schema.metadata or {})
    digest = about.pop(CHECK, None)
    if digest is not None and digest != _digest(schema, about):
        raise ValueError("it is damaged")
    return about


def _digest(schema: Any, about: Mapping[bytes, bytes]) -> bytes:
    """Return a checksum of columns and metadata, which those of Parquet leave out."""
    # Parquet changes the types within lists and categories, of which only the kind is compared.
    columns = [(each.name, str(each.type).partition("<")[0]) for each in schema]
    text = repr((columns, sorted(about.items())))
    return hashlib.sha256(text.encode()).hexdigest().encode()


def _plain(value: Any) -> Any:
    """Convert a parameter to a JSON value."""
    if is_dataclass(value) and not isinstance(value, type):
        return {"kind": type(value).__name__, **{k: _plain(v) for k, v in asdict(value).items()}}
    if isinstance(value, Path):
        return value.name  # the location of a file says nothing about its contents
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (int, float, bool, type(None))) else str(value)
