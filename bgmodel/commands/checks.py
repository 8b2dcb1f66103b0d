"""What several commands check or record about their options."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any


def asked(command: Any) -> dict[str, Any]:
    """Return a command's options but for where its result goes."""
    options = {field.name: getattr(command, field.name) for field in fields(command)}
    return {name: value for name, value in options.items() if name != "output"}


def check_ending(path: Path, *allowed: str) -> None:
    """Raise ValueError unless the output's name ends in one of those allowed."""
    if path.suffix not in allowed:
        raise ValueError(f"output must end in {' or '.join(allowed)}, got {str(path)!r}")


def check_whole(**values: int) -> None:
    """Raise ValueError, with its name, for a number below 1."""
    for name, value in values.items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}")
