"""THE TABLES: every nucleus, every pathway and the source of every number; one circuit per file.

Weights are in nats of input to the target per nat of activity of the source. Rates follow from
each row's baseline and gain. "assumed" and "tuned" mark values without a published source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from circuits import DEFAULT, table_reader
from circuits.anatomy.exact import appendix_b, bogacz_gurney, linear_gpe
from circuits.anatomy.gpr import gpr
from circuits.anatomy.humphries import humphries
from circuits.anatomy.macaque import macaque
from circuits.anatomy.macaque_small import macaque_small
from circuits.anatomy.spiking_msprt import spiking_msprt
from circuits.anatomy.stewart import stewart
from circuits.circuit import Circuit
from circuits.declaration import table_writer
from circuits.errors import EditWarning, InputError, require
from circuits.laws.family import failures

__all__ = [
    "CIRCUITS", "DEFAULT", "appendix_b", "bogacz_gurney", "checked_circuit", "gpr", "humphries",
    "is_included", "linear_gpe", "load_circuit", "macaque", "macaque_small", "spiking_msprt",
    "stewart",
]  # fmt: skip

_TABLES = (
    *(bogacz_gurney, appendix_b, linear_gpe, macaque, macaque_small),
    *(spiking_msprt, gpr, humphries, stewart),
)
CIRCUITS: dict[str, Callable[..., Circuit]] = {table.__name__: table for table in _TABLES}
"""All tables by name; each takes the number of channels."""
MOST_COMPARED = 12
"""Largest number of channels for which the rows of a file are recognised."""


def load_circuit(name: str | Path = DEFAULT, channels: int | None = None) -> Circuit:
    """Load a circuit by name or from a file.

    Parameters
    ----------
    name : str or path
        The path of a .toml file, or the name of a circuit:

        - "macaque": spiking basal ganglia of the macaque, driven by raw evidence;
        - "macaque_small": the same in an eighth of the cells, without its resting rates;
        - "spiking_msprt": spiking cells that compute the MSPRT;
        - "bogacz_gurney": the exact circuit of Bogacz & Gurney (2007), where OUT = -ln P;
        - "appendix_b": the exact circuit with all pathways (their appendix B);
        - "linear_gpe": the same circuit with a linear GPe, which is not exact;
        - "gpr": action selection, rate-based (Gurney, Prescott & Redgrave 2001);
        - "humphries": action selection, spiking (Humphries, Stewart & Gurney 2006);
        - "stewart": the weights of "gpr" in spiking cells (Stewart, Choo & Eliasmith 2010).
    channels : int, optional
        Number of alternatives; by default 2, or the number in the file.

    Returns
    -------
    Circuit
        A file that still has the name of an included circuit, but another content, is named after
        the file. If its rows are those of the included circuit with another number of channels, a
        warning says so: biases depend on that number.

    Raises
    ------
    ValueError
        If the name is unknown (the message lists the known names), or as ``table_reader.read``.
    """
    named = isinstance(name, (str, Path))
    require(named, "circuit", "must be a name or the path of a .toml file", name)
    if table_writer.is_path(name):
        return _own(table_reader.read(name, channels), Path(name))
    must = f"must be one of {', '.join(CIRCUITS)}, or the path of a .toml file"
    require(name in CIRCUITS, "circuit", must, str(name))
    table, count = CIRCUITS[str(name)], 2 if channels is None else channels
    # The table itself refuses what is no whole number.
    return _built(table, count) if type(count) is int else table(count)


@lru_cache(maxsize=32)
def _built(table: Callable[..., Circuit], channels: int) -> Circuit:
    """Return an included circuit; circuits never change, so one that was built serves again."""
    return table(channels)


def checked_circuit(circuit: Circuit | str | Path, channels: int | None = None) -> Circuit:
    """Return a circuit, given as such, or by name or .toml file with a number of channels."""
    if isinstance(circuit, Circuit):
        return circuit
    if isinstance(circuit, (str, Path)):
        return load_circuit(circuit, channels)
    hint = ": give its .circuit" if isinstance(getattr(circuit, "circuit", None), Circuit) else ""
    raise InputError(
        f"circuit must be a Circuit, a name or a .toml file, got {type(circuit).__name__}{hint}",
        "circuit",
    )


def is_included(circuit: Circuit) -> bool:
    """Whether a circuit is the included one of its name, without any edit."""
    make = CIRCUITS.get(circuit.name)
    if make is None:
        return False
    try:
        return table_writer.digest(circuit) == table_writer.digest(make(circuit.channels))
    except ValueError:  # more channels than it can have
        return False


def _own(circuit: Circuit, path: Path) -> Circuit:
    """Return the circuit of a file under a name that no included circuit has."""
    if circuit.exact and (fails := failures(circuit)):
        EditWarning.warn(f"{path.name} states exact = true, but its OUT is not -ln P: {fails[0]}")
        circuit = replace(circuit, exact=False)
    if circuit.name not in CIRCUITS or is_included(circuit):
        return circuit
    make = CIRCUITS[circuit.name]
    counts = range(2, MOST_COMPARED + 1)
    fits = [count for count in counts if make(count).populations == circuit.populations]
    if len(fits) == 1 and fits != [circuit.channels]:  # the rows of some tables fit any number
        EditWarning.warn(
            f"{path.name} is for {circuit.channels} channels, but its rows, whose biases "
            f"depend on that number, are those of {circuit.name} for {fits[0]}: write the "
            f"file again with `bgmodel circuit show {circuit.name} --channels "
            f"{circuit.channels} --save`"
        )
    return replace(circuit, name=path.stem)
