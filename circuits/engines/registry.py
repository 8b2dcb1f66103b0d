"""The registry of engines, and fields that take an engine or its name."""

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
    """Register an engine in ``ENGINES``: a class decorator, above ``@dataclass(frozen=True)``.

    Raises
    ------
    ValueError
        If it is not a frozen dataclass derived from ``Engine``, an option has no default, or the
        id is taken by another engine.
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


def engine_of(engine: Engine | str, **options: object) -> Engine:
    """Return an engine from its id or from a record, with options (its fields) changed."""
    if not isinstance(engine, Engine):
        known = isinstance(engine, str) and engine in ENGINES
        require(known, "engine", f"must be one of {', '.join(ENGINES)}", engine)
        engine = ENGINES[engine]()
    names = [f.name for f in fields(engine)]
    for name in options:
        if name not in names:
            raise InputError(f"the {engine.id} engine takes no {name!r}: {', '.join(names)}", name)
    return replace(engine, **options) if options else engine


class EngineOrName:
    """A dataclass field that accepts an engine or its id, and stores the engine."""

    def __init__(self, default: str) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        """Store the name of the field."""
        self.name = name

    @overload
    def __get__(self, of: None, owner: type) -> str: ...
    @overload
    def __get__(self, of: object, owner: type) -> Engine: ...
    def __get__(self, of: object | None, owner: type) -> Engine | str:
        """Return the engine or, on the class, the default of the field."""
        if of is None:
            return self.default
        engine: Engine = vars(of)[self.name]
        return engine

    def __set__(self, of: object, value: Engine | str) -> None:
        """Store the engine."""
        vars(of)[self.name] = engine_of(value)
