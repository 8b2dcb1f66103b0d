"""TOML files read into dataclasses, with checks of every key and type."""

from __future__ import annotations

import json
import tomllib
from dataclasses import fields
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from circuits.checks import parsed_toml
from circuits.errors import InputError, nearest

T = TypeVar("T")
UNKNOWN = "unexpected_keyword_argument"

STRICT = {"extra": "forbid", "strict": True}
"""The ``__pydantic_config__`` of dataclasses read from files, including nested ones."""


def read(path: str | Path, kind: type[T]) -> T:
    """Read a TOML file as a dataclass, with ``STRICT`` as its ``__pydantic_config__``."""
    path = Path(path)
    return decoded(_given(path), kind, path.name)


def read_text(text: str, kind: type[T], name: str) -> T:
    """Read the text of a TOML file as a dataclass; ``name`` is what errors call it."""
    return decoded(parsed_toml(text, name), kind, name)


def gives(path: str | Path, key: str) -> bool:
    """Whether a TOML file has a key at the top level; ValueError as for ``read``."""
    return key in _given(Path(path))


def _given(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{str(path)!r} can't be read: {why}", "path", path) from None
    return parsed_toml(text, path.name)


def decoded(contents: dict[str, Any], kind: type[T], name: str, inside: str = "") -> T:
    """Return a dataclass from the contents of a file, or of a part of it.

    Errors begin with the file's ``name``, or "" for a part, whose key in the file is ``inside``.
    """
    from pydantic import ValidationError

    before = f"{name}: " if name else ""

    def refused(value: object) -> None:
        raise InputError(f"{before}no key takes a date or a time, got {value}", "path", name)

    try:
        # JSON mode accepts lists for tuples but makes no other conversions.
        record: T = _adapter(cast(Any, kind)).validate_json(json.dumps(contents, default=refused))
        return record
    except ValidationError as error:
        wrongs = error.errors(include_url=False)
    # A misspelt key is also a missing one; the first error is more helpful.
    wrong = min(wrongs, key=lambda e: (e["type"] != UNKNOWN, e["type"] != "missing"))
    place = [inside] * bool(inside) + [str(part) for part in wrong["loc"]]
    key = ".".join(place) or "the whole"
    if wrong["type"] == UNKNOWN:
        known = _keys(kind, wrong["loc"][:-1])
        near = nearest(wrong["loc"][-1], known)
        whose = f" for {getattr(kind, 'name', '')}" if inside else ""
        reason = f"there is no key {key!r}{whose}{near}; there are {', '.join(known)}"
        raise InputError(f"{before}{reason}", key)
    if wrong["type"] == "missing":
        others = [repr(".".join(map(str, e["loc"]))) for e in wrongs if e["type"] == "missing"][1:]
        also = f", and {', '.join(others)} too" if others else ""
        raise InputError(f"{before}the key {key!r} is missing{also}", key)
    says = wrong["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if wrong["type"] == "value_error":
        field = getattr(wrong["ctx"]["error"], "field", key)
        named = key in ("the whole", inside) or says.startswith((key, "there is no key"))
        if says.startswith("it must"):
            raise InputError(f"{before}{key}{says.removeprefix('it')}", key)
        raise InputError(f"{before}{'' if named else key + ': '}{says}", field)
    raise InputError.of(key, f"{says}", wrong["input"], owner=name)


def as_toml(text: str) -> Any:
    """Return a number, a list or a truth value of a text, as in TOML, or the text itself."""
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        parts = text.split(",")
        return [as_toml(part) for part in parts] if len(parts) > 1 else text
    if not isinstance(value, bool | int | float | str | list):
        return text
    # TOML writes a large whole number, such as 1e5, as it writes any number.
    integral = isinstance(value, float) and value.is_integer()
    return int(value) if integral else value  # type: ignore[arg-type]


def value(raw: Any, kind: Any, name: str) -> Any:
    """Return a single value of a file or of the terminal as a type; ValueError naming it."""
    from pydantic import ValidationError

    several = get_origin(kind) is tuple and not isinstance(raw, list)
    try:
        return _adapter(kind).validate_json(json.dumps([raw] if several else raw), strict=True)
    except ValidationError as error:
        says = error.errors(include_url=False)[0]["msg"].removeprefix("Input ")
        raise InputError.of(name, says, raw) from None


@cache
def _adapter(kind: Any) -> Any:
    # Importing pydantic takes a tenth of a second: only when a file is read.
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def _keys(kind: Any, place: tuple[int | str, ...]) -> list[str]:
    """Return the keys of the nested dataclass at a place."""
    for part in place:
        kind = get_type_hints(kind)[part] if isinstance(part, str) else get_args(kind)[0]
        if isinstance(kind, UnionType):
            kind = next(one for one in get_args(kind) if one is not NoneType)
    ordered = sorted(fields(kind), key=lambda field: bool(field.kw_only))
    return [field.name for field in ordered]
