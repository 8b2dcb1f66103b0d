"""The registry of engines: by name, with options, and as the field of a record."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TypeVar, overload

from circuits.checks import check_free, check_kind
from circuits.engines.engine import Engine
from circuits.errors import InputError, require

ENGINES: dict[str, type[Engine]] = {}
"""All engines by id, in the order in which they were registered."""
E = TypeVar("E", bound=type[Engine])


def register(kind: E) -> E:
    """Enter an engine into ``ENGINES``: a class decorator, above ``@dataclass(frozen=True)``.

    Raises
    ------
    ValueError
        If it is no frozen dataclass of type ``Engine``, an option has no default, or another engine
        has its id.
    """
    name = check_kind(kind, Engine, "an engine")
    for word in ("id", "description"):
        text = getattr(kind, word, None)
        require(isinstance(text, str), word, "must be text", text, owner=name)
    check_free(kind.id, kind, ENGINES, "an engine")
    try:
        kind()
    except TypeError as error:
        raise InputError(f"every option needs a default: {error}", "engine", kind) from error
    ENGINES[kind.id] = kind
    return kind


def engine_of(given: Engine | str, **options: object) -> Engine:
    """Return an engine from its id or from a record, with options changed.

    Parameters
    ----------
    given : Engine or str
        A record, or the id of one with its defaults.
    **options
        Fields of the record to change.

    Raises
    ------
    ValueError
        For an unknown id, with those that there are; for an option that the engine does not take,
        with those that it takes; for a value out of range.
    """
    if not isinstance(given, Engine):
        known = isinstance(given, str) and given in ENGINES
        require(known, "engine", f"must be one of {', '.join(ENGINES)}", given)
        given = ENGINES[given]()
    names = [f.name for f in fields(given)]
    for name in options:
        if name not in names:
            raise InputError(f"the {given.id} engine takes no {name!r}: {', '.join(names)}", name)
    return replace(given, **options) if options else given


class EngineOrName:
    """A dataclass field that takes an engine or its id, and holds the engine."""

    def __init__(self, default: str) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        """Keep the name of the field."""
        self.name = name

    @overload
    def __get__(self, of: None, owner: type) -> str: ...
    @overload
    def __get__(self, of: object, owner: type) -> Engine: ...
    def __get__(self, of: object | None, owner: type) -> Engine | str:
        """Return the engine; of the class, the default of its field."""
        if of is None:
            return self.default
        engine: Engine = vars(of)[self.name]
        return engine

    def __set__(self, of: object, value: Engine | str) -> None:
        """Hold the engine."""
        vars(of)[self.name] = engine_of(value)
