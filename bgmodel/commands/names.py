"""Names that options take, each listed once where it is defined."""

from __future__ import annotations


class Name(str):
    """A name out of a list that grows; help shows the list, and what is unknown is refused."""

    @classmethod
    def known(cls) -> tuple[str, ...]:
        """Return all names."""
        raise NotImplementedError

    @classmethod
    def parse(cls, given: str) -> Name:
        """Return a name; ValueError with those that there are if it is none."""
        if given not in cls.known():
            raise ValueError(f"it must be one of {', '.join(cls.known())}, got {given!r}")
        return cls(given)


class CircuitName(Name):
    """Name of a table, or the path of a .toml file."""

    @classmethod
    def known(cls) -> tuple[str, ...]:
        """Return the tables that there are."""
        from circuits.anatomy import CIRCUITS

        return tuple(CIRCUITS)

    @classmethod
    def parse(cls, given: str) -> Name:
        """Return a name, or a path as it is; ValueError for a name that there is not."""
        from circuits.declaration.table_files import is_path

        return cls(given) if is_path(given) else super().parse(given)


class EngineName(Name):
    """Name of an engine."""

    @classmethod
    def known(cls) -> tuple[str, ...]:
        """Return the engines that there are."""
        from circuits.engines import ENGINES

        return tuple(ENGINES)


class TimedEngineName(EngineName):
    """Name of an engine whose decisions take time: a fixed point has none."""

    @classmethod
    def known(cls) -> tuple[str, ...]:
        """Return the engines in which time passes."""
        from circuits.engines import ENGINES

        return tuple(name for name, kind in ENGINES.items() if kind.timed)


MACAQUE = CircuitName("macaque")
ENSEMBLE = EngineName("ensemble")
RATE = TimedEngineName("rate")
"""What commands take unless another one is named."""
