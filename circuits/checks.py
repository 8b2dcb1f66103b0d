"""Checks of user input: types and ranges of the values in a table."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from numbers import Integral, Real
from typing import Any

from circuits.errors import InputError, require

MOST_NESTED = 50
"""Largest depth of the tables and lists of a file."""
DEEP_KEY = re.compile(rf"(?<![^\s.=,\[\]{{}}])(?:[^\s.=,\[\]{{}}]+[ \t]*\.[ \t]*){{{MOST_NESTED}}}")
"""A key such as a.a.a that is too deep, for which the parser takes hours."""


def parsed_toml(text: str, file: str) -> dict[str, Any]:
    """Return the contents of a TOML file, ``file`` in errors; ValueError if it is not valid."""
    contents: dict[str, Any] = {}
    try:
        if not (deep := bool(DEEP_KEY.search(text))):
            contents = tomllib.loads(text)
    except ValueError as error:
        raise InputError(f"{file} is not valid TOML: {error}", "path", file) from None
    except RecursionError:
        deep = True
    level: list[Any] = [contents]
    for _ in range(MOST_NESTED):
        inner = [each.values() if isinstance(each, dict) else each for each in level]
        level = [one for each in inner for one in each if isinstance(one, (dict, list))]
    if deep or level:
        raise InputError(f"{file} is nested too deeply", "path", file)
    return contents


def check_types(row: Any, owner: str) -> None:
    """Raise InputError for a field of a dataclass whose value is not of the declared type."""
    for field in fields(row):
        kind = _KINDS.get(str(field.type)) if field.init else None
        if kind is not None and not kind[1](value := getattr(row, field.name)):
            raise InputError.of(field.name, f"must be {kind[0]}", value, owner=owner)


def is_number(value: Any) -> bool:
    """Whether a value is a real number; booleans are not."""
    return isinstance(value, Real) and not is_bool(value)


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number, of any type."""
    return is_number(value) and (isinstance(value, Integral) or float(value).is_integer())


def check_range(low: float, high: float, *, owner: str = "", **values: Any) -> None:
    """Raise InputError for a value that is not a finite number from low to high, inclusive."""
    must = f"must be within {low:g}..{high:g}"
    if math.isinf(high):
        must = "must be finite" if math.isinf(low) else f"must be >= {low:g} and finite"
    for name, value in values.items():
        require(is_number(value), name, "must be a number", value, owner=owner)
        require(low <= value <= high and math.isfinite(value), name, must, value, owner=owner)


def check_finite(*, owner: str = "", **values: Any) -> None:
    """Raise ValueError for a value (by field name) that is not a finite number."""
    check_range(-math.inf, math.inf, owner=owner, **values)


def check_positive(*, owner: str = "", **values: Any) -> None:
    """Raise ValueError for a value (by field name) that is not a finite number above 0."""
    for name, value in values.items():
        require(is_number(value), name, "must be a number", value, owner=owner)
        require(0 < value < math.inf, name, "must be > 0 and finite", value, owner=owner)


def whole_ticks(name: str, time_ms: float, dt_ms: float) -> int:
    """Return a time as a number of ticks; raises ValueError if it is not a multiple of dt."""
    require(dt_ms > 0, "dt_ms", "must be > 0", dt_ms)
    count = round(time_ms / dt_ms)
    if not math.isclose(count * dt_ms, time_ms, rel_tol=1e-9, abs_tol=1e-9):
        field = name if name.endswith("_ms") else "delay_ms"
        raise InputError(f"{name} of {time_ms:g} ms is not a multiple of dt_ms = {dt_ms:g}", field)
    return count


def check_channel(owner: str, channel: Any, count: int) -> None:
    """Raise ValueError unless ``channel`` is the index of one of a row's channels."""
    if not is_whole(channel) or not 0 <= channel < count:
        raise InputError.of("channel", f"must be within 0..{count - 1}", channel, owner=owner)


def place_of(text: str) -> tuple[str, int | None]:
    """Split "STN[0]" into a name and a channel; without brackets it is None, all channels."""
    match = re.fullmatch(r"(.+?)(?:\[(\d+)\])?", text)
    return (match[1], None if match[2] is None else int(match[2])) if match else (text, None)


def is_bool(value: Any) -> bool:
    """Whether a value is True or False, including NumPy booleans."""
    return type(value).__name__ in ("bool", "bool_")


def _are_numbers(values: Any) -> bool:
    return isinstance(values, (tuple, list)) and all(map(is_number, values))


def check_kind(kind: Any, base: type, what: str) -> str:
    """Check that a class to be registered is a frozen dataclass of a base; return its name.

    ``what`` is the kind of class for messages, as "an engine"; its last word is the field of
    errors.
    """
    name, field = getattr(kind, "__name__", repr(kind)), what.split()[1]
    if not (isinstance(kind, type) and issubclass(kind, base)):
        raise InputError(f"{what} must be a subclass of {base.__name__}, got {name}", field)
    settings = vars(kind).get("__dataclass_params__")
    if settings is None or not settings.frozen:
        raise InputError(f"{what} must be a dataclass with frozen=True, got {name}", field, kind)
    return name


def check_free(name: str, kind: type, known: Mapping[str, type], what: str) -> None:
    """Raise ValueError if a class of another module is registered under this name."""
    if name in known and known[name].__module__ != kind.__module__:
        reason = f"there is {what} {name} already, in {known[name].__module__}"
        raise InputError(reason, what.split()[1])


_KINDS = {
    "float": ("a number", is_number),
    "int": ("a whole number", is_whole),
    "bool": ("true or false", is_bool),
    "str": ("text", lambda value: isinstance(value, str)),
    "tuple[float, ...]": ("numbers", _are_numbers),
    "tuple[float, float]": (
        "two numbers",
        lambda value: _are_numbers(value) and len(value) == 2,
    ),
    "float | None": ("a number", lambda value: value is None or is_number(value)),
}


def check_channels(channels: int) -> None:
    """Raise ValueError unless ``channels`` is a whole number of at least 2."""
    if not is_whole(channels) or channels < 2:
        raise InputError.of("channels", "must be a whole number >= 2", channels)
