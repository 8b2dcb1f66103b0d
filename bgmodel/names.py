"""Names of circuits and engines, each listed once where it is defined.

A type checker sees plain text. The command line lists the names in its help and completes them;
files and records refuse a name that is not listed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from circuits import DEFAULT
from circuits.errors import InputError


class Name(str):
    """A name from a list that can grow."""

    more = ""
    """What is allowed besides the names, for messages."""

    @classmethod
    def known(cls) -> tuple[str, ...]:
        """Return all names."""
        raise NotImplementedError

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the name; ValueError listing the known names for any other text."""
        if text not in cls.known():
            known = ", ".join(cls.known())
            raise ValueError(f"it must be one of {known}{cls.more}, got {text!r}")
        return cls(text)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Let pydantic read the name from text and nothing else."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(
            cls.parse, core_schema.str_schema(strict=True)
        )


if TYPE_CHECKING:
    CircuitName = str
    EngineName = str
else:

    class CircuitName(Name):
        """Name of a circuit, or the path of a .toml file."""

        more = ", or the path of a .toml file"

        @classmethod
        def known(cls) -> tuple[str, ...]:
            """Return the shipped circuits."""
            from circuits.anatomy import CIRCUITS

            return tuple(CIRCUITS)

        @classmethod
        def parse(cls, text: str) -> Self:
            """Return the name or the path; ValueError for an unknown name."""
            from circuits.declaration.table_writer import is_path

            return cls(text) if is_path(text) else super().parse(text)

    class EngineName(Name):
        """Name of an engine."""

        @classmethod
        def known(cls) -> tuple[str, ...]:
            """Return the engines."""
            from circuits.engines import ENGINES

            return tuple(ENGINES)


MACAQUE = CircuitName(DEFAULT)


def check(what: str, name: object, kind: Any) -> None:
    """Raise ValueError listing the known names, for anything that is not a name of a kind."""
    try:
        kind.parse(name)
    except (ValueError, TypeError):
        known = ", ".join(kind.known())
        raise InputError.of(what, f"must be one of {known}{kind.more}", name) from None
