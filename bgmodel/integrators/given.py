"""A circuit as users give it, and as results identify it."""

from __future__ import annotations

from pathlib import Path

from circuits.anatomy import load_circuit as named
from circuits.circuit import Circuit
from circuits.errors import InputError


def checked_circuit(circuit: Circuit | str | Path, channels: int | None = None) -> Circuit:
    """Return a circuit, given as such, or by name or .toml file with a number of channels."""
    if isinstance(circuit, Circuit):
        return circuit
    if isinstance(circuit, (str, Path)):
        return named(circuit, channels)
    hint = ": give its .circuit" if isinstance(getattr(circuit, "circuit", None), Circuit) else ""
    raise InputError(
        f"circuit must be a Circuit, a name or a .toml file, got {type(circuit).__name__}{hint}",
        "circuit",
    )


def identity(circuit: Circuit) -> dict[str, str]:
    """Return the name and the hash of an edited circuit, for provenance."""
    from circuits.declaration.table_files import digest

    return {"name": circuit.name, "sha256": digest(circuit)}
