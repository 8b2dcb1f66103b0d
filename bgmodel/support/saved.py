"""Records, printed in short, and saved whole and loaded again as the same record.

A file is an .npz without pickled objects: arrays, tables in Parquet, and the rest as JSON. Only
records of this package are made from one, so that a file from elsewhere runs no code.
"""

from __future__ import annotations

import importlib
import io
import json
from dataclasses import Field, fields, is_dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel.support import __version__
from bgmodel.support.checks import path_of
from bgmodel.support.files import check_new, check_writable, from_json, read_arrays, replacing
from circuits.arrays import Arrays
from circuits.errors import InputError, require

ENDING, TREE = ".npz", "record"
"""Ending of a file, and the array that holds its JSON."""
PACKAGES = ("bgmodel.", "circuits.")
PLAIN = (bool, int, float, str)
"""Types that JSON has."""


class Facts:
    """Base of records that hold arrays: readable when printed, and saved whole."""

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the record to an .npz file, which ``bg.load`` reads; see ``saved.save``."""
        return save(self, path, force=force)

    def facts(self) -> dict[str, str]:
        """Return the main facts of a record by name: shapes, units, a few means."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the facts in one line."""
        text = ", ".join(f"{name} {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({text})"

    def _repr_html_(self) -> str:
        """Return the facts as a table, for a notebook."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


def span(values: npt.ArrayLike, form: str = ".3g") -> str:
    """Return the lowest and the highest of some numbers as text, ignoring NaN."""
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    if not known.size:
        return "unknown"
    low, high = f"{known.min():{form}}", f"{known.max():{form}}"
    return low if low == high else f"{low} to {high}"


def save(record: Any, path: str | Path, *, force: bool = False) -> Path:
    """Write a record of this package, such as a result, to an .npz file, whole or not at all."""
    path = path_of(path)
    table = ": to_dataframe() gives a table" * hasattr(record, "to_dataframe")
    require(path.suffix == ENDING, "path", f"must end in {ENDING}{table}", str(path))
    check_new(path, force=force)
    check_writable(path.parent)
    arrays: dict[str, Any] = packed(record)
    with replacing(path) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    return path


def packed(record: Any) -> Arrays:
    """Return a record as arrays by name."""
    arrays: list[npt.NDArray[Any]] = []
    tree = {"version": __version__, "value": _plain(record, arrays)}
    text = np.frombuffer(json.dumps(tree).encode(), dtype=np.uint8)
    return {TREE: text, **{str(k): each for k, each in enumerate(arrays)}}


def load(path: str | Path) -> Any:
    """Return the record that ``.save`` wrote.

    Parameters
    ----------
    path : path
        A file that ``save`` of a result wrote, .npz.

    Raises
    ------
    ValueError
        If there is no such file, it is damaged, or a version wrote it whose records differ.
    """
    path = path_of(path)
    if not path.is_file():
        raise InputError(f"there is no file {str(path)!r}", "path", path)
    return unpacked(read_arrays(path), repr(str(path)))


def unpacked(arrays: Arrays, name: str = "the record") -> Any:
    """Return the record of ``packed``; InputError, with the name, for arrays without one."""
    if TREE not in arrays:
        raise InputError(f"{name} is not a result that .save wrote", "path", name)
    tree = from_json(arrays[TREE].tobytes())
    try:
        return _restored(tree["value"], arrays)
    except (ImportError, AttributeError, KeyError, TypeError) as error:
        reason = f"{name} was saved by version {tree.get('version')}, this is {__version__}"
        raise InputError(f"{reason}: its records differ ({error})", "path", name) from None


def _plain(value: Any, arrays: list[npt.NDArray[Any]]) -> Any:
    """Return a value as JSON; arrays and tables are put into the list."""
    import pandas as pd

    if value is None or type(value) in PLAIN:
        return value
    if isinstance(value, np.ndarray | np.generic):
        return {"array": _kept(np.asarray(value), arrays), "of": type(value).__name__}
    if isinstance(value, pd.DataFrame):
        return {"table": _kept(_bytes_of(value), arrays), "of": _name(type(value))}
    if type(value) in (list, tuple):
        return {type(value).__name__: [_plain(each, arrays) for each in value]}
    if type(value) is dict:
        return {"dict": [[_plain(each, arrays) for each in pair] for pair in value.items()]}
    if isinstance(value, Path):
        return {"path": str(value)}
    kind = type(value)
    own_kind = kind.__module__.startswith(PACKAGES) and "." not in kind.__qualname__
    base: Any = next((one for one in (float, str, tuple) if isinstance(value, one)), None)
    if own_kind and base:
        return {"kind": _name(kind), "value": _plain(base.__new__(base, value), arrays)}
    if not own_kind or not is_dataclass(value):
        reason = f"it holds a {kind.__name__}, which is no record of this package"
        raise InputError(f"this can't be saved: {reason}", "record", value)
    plain_fields = {one.name: _plain(_saved(value, one), arrays) for one in fields(value)}
    return {"record": _name(type(value)), "fields": plain_fields}


def _saved(record: Any, one: Field[Any]) -> Any:
    """Return the value of a field; that of a cache, which is not compared, is what it begins as."""
    empty = None if one.compare else one.default_factory
    return empty() if callable(empty) else getattr(record, one.name)


def _restored(value: Any, arrays: dict[str, npt.NDArray[Any]]) -> Any:
    """Invert ``_plain``: return the value of a JSON tree."""
    match value:
        case {"array": int(place), "of": str(kind)}:
            array = arrays[str(place)]
            return array if kind == "ndarray" else array[()]
        case {"table": int(place), "of": str(kind)}:
            return _table_of(arrays[str(place)], kind)
        case {"list": list(items)}:
            return [_restored(each, arrays) for each in items]
        case {"tuple": list(items)}:
            return tuple(_restored(each, arrays) for each in items)
        case {"dict": list(pairs)}:
            return {_restored(k, arrays): _restored(v, arrays) for k, v in pairs}
        case {"path": str(text)}:
            return Path(text)
        case {"kind": str(name), "value": inner}:
            inner = _restored(inner, arrays)
            return type(inner).__new__(_class(name), inner)
        case {"record": str(name), "fields": dict(own)}:
            return _record(_class(name), {k: _restored(v, arrays) for k, v in own.items()})
        case dict():
            raise TypeError(f"unknown kind of value: {', '.join(value)}")
    return value


def _record(kind: type, values: dict[str, Any]) -> Any:
    """Return a record with these fields, unchecked: they were checked when it was made."""
    if not is_dataclass(kind) or {one.name for one in fields(kind)} != set(values):
        raise TypeError(f"the fields of {kind.__name__} are others")
    made = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def _kept(array: npt.NDArray[Any], arrays: list[npt.NDArray[Any]]) -> int:
    if array.dtype.hasobject:
        array = array.astype(np.str_)
    arrays.append(array)
    return len(arrays) - 1


def _bytes_of(table: Any) -> npt.NDArray[Any]:
    stream = io.BytesIO()
    table.to_parquet(stream)
    return np.frombuffer(stream.getvalue(), dtype=np.uint8)


def _table_of(content: npt.NDArray[Any], kind: str) -> Any:
    import pandas as pd

    table = pd.read_parquet(io.BytesIO(content.tobytes()))
    return table if kind == _name(pd.DataFrame) else _class(kind)(table)


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    """Return a class of this package by name."""
    module, _, inner = name.partition(":")
    if not module.startswith(PACKAGES) or "__main__" in module or "." in inner:
        raise TypeError(f"{name} is no record")
    kind = getattr(importlib.import_module(module), inner)
    if not isinstance(kind, type) or not kind.__module__.startswith(PACKAGES):
        raise TypeError(f"{name} is no record")
    return kind
