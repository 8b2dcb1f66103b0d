"""Edits of a circuit as a person writes them: at the terminal or in an experiment's file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from circuits.spec import Circuit


@dataclass(frozen=True)
class Edits:
    """What differs from the table: the hypothesis."""

    without: tuple[str, ...] = ()
    """Nuclei to lesion, whole ("STN") or by a fraction ("STN=0.5")."""
    replaced: bool = False
    """Whether the lost output is given back as a constant."""
    scale: tuple[str, ...] = ()
    """Pathways to scale, as "STN->GPe=0.5", or "ctx->D1[0]=1.1" in one channel."""
    dopamine: float = 1.0
    """Dopamine level, 0..2; 1 is normal."""
    neurons: int | None = None
    """Cells a channel of every spiking nucleus."""
    connections: float | None = None
    """Connection probability between spiking nuclei, fixed in-degree."""
    spread: float | None = None
    """Spread of cell constants, as a fraction."""

    def used(self) -> dict[str, Any]:
        """Return the edits that change something, by name: for provenance."""
        changed = (f for f in fields(self) if getattr(self, f.name) != f.default)
        return {f.name: getattr(self, f.name) for f in changed}

    def check_engine(self, engine: str) -> None:
        """Raise ValueError for edits of cells where an engine has none: they would do nothing."""
        # Importing it with the package would cost time that only circuits need.
        from circuits.engines import SPIKING

        idle = [name for name in ("neurons", "connections", "spread") if getattr(self, name)]
        if idle and engine not in SPIKING:
            raise ValueError(f"{idle[0]} is of cells, it says nothing to the {engine} engine")

    def of(self, table: Circuit) -> Circuit:
        """Return the edited circuit."""
        for edit in self.without:
            name, fraction = _value(edit, 1.0)
            table = table.without(name, fraction, replaced=self.replaced)
        for edit in self.scale:
            name, factor = _value(edit, None)
            name, channel = _channel(name)
            source, arrow, target = name.partition("->")
            if not arrow:
                raise ValueError(f'scale needs a pathway like "STN->GPe=0.5", got {edit!r}')
            table = table.scaled(source, target, factor, channel)
        table = table.dopamine(self.dopamine)
        if self.neurons is not None:
            table = table.with_neurons(self.neurons)
        if self.connections is not None:
            table = table.with_connections(self.connections)
        return table if self.spread is None else table.with_spread(self.spread)


def _value(edit: str, default: float | None) -> tuple[str, float]:
    """Split "name=number"."""
    name, equals, number = edit.partition("=")
    if not equals and default is not None:
        return name, default
    try:
        return name, float(number)
    except ValueError:
        raise ValueError(f"an edit is a name, =, and a number; got {edit!r}") from None


def _channel(name: str) -> tuple[str, int | None]:
    """Split "name[channel]"; without brackets it is every channel."""
    path, bracket, rest = name.partition("[")
    if not bracket:
        return path, None
    number = rest.removesuffix("]")
    if number == rest or not number.isdecimal():
        raise ValueError(f'a channel is a number in brackets, as "ctx->D1[0]", got {name!r}')
    return path, int(number)
