"""What several commands check or record about their options."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

COMPILES = "the first run of a kind of circuit compiles: half a minute or less"
"""What a command says before it runs the ensemble engine."""


def asked(command: Any, **settled: Any) -> dict[str, Any]:
    """Return a command's options but for where its result goes; ``settled`` are those left open."""
    options = {field.name: getattr(command, field.name) for field in fields(command)}
    return {name: value for name, value in options.items() if name != "output"} | settled


def check_ending(path: Path, *allowed: str) -> None:
    """Raise ValueError unless the output's name ends in one of those allowed."""
    if path.suffix not in allowed:
        raise ValueError(f"output must end in {' or '.join(allowed)}, got {str(path)!r}")


def check_apart(command: Any) -> None:
    """Raise ValueError if two of a command's options name one file: one would be written over."""
    seen: dict[Path, str] = {}
    for name, path in _paths(command):
        other = seen.setdefault(path.resolve(), name)
        if other != name:
            raise ValueError(f"{other} and {name} are one file, {str(path)!r}: nothing was written")


def _paths(options: Any) -> Iterator[tuple[str, Path]]:
    for field in fields(options):
        value = getattr(options, field.name)
        if isinstance(value, Path):
            yield field.name, value
        elif is_dataclass(value):
            yield from _paths(value)


def check_whole(**values: int) -> None:
    """Raise ValueError, with its name, for a number below 1."""
    for name, value in values.items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}")
