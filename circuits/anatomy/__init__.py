"""THE TABLES: every nucleus, every pathway, every number with its source; one table a file.

Weights are in nats: what a nat of the source's activity adds to the target's input. Rates follow
from each row's baseline and gain. Where a source is "assumed" or "tuned", that is what it is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from circuits import DEFAULT, table_reader
from circuits.anatomy.exact import appendix_b, bogacz_gurney, linear_gpe
from circuits.anatomy.gpr import gpr
from circuits.anatomy.humphries import humphries
from circuits.anatomy.macaque import macaque
from circuits.anatomy.spiking_msprt import spiking_msprt
from circuits.anatomy.stewart import stewart
from circuits.circuit import Circuit
from circuits.declaration import table_files
from circuits.errors import require

__all__ = [
    "CIRCUITS",
    "DEFAULT",
    "appendix_b",
    "bogacz_gurney",
    "gpr",
    "humphries",
    "linear_gpe",
    "load_circuit",
    "macaque",
    "spiking_msprt",
    "stewart",
]

_TABLES = (bogacz_gurney, appendix_b, linear_gpe, macaque, spiking_msprt, gpr, humphries, stewart)
CIRCUITS: dict[str, Callable[..., Circuit]] = {table.__name__: table for table in _TABLES}
"""All tables by name; each takes the number of channels."""


def load_circuit(name: str | Path, channels: int | None = None) -> Circuit:
    """Return a circuit by name, or from a table's file.

    Parameters
    ----------
    name : str or path
        The path of a file that ends in .toml, or the name of a table:

        - "macaque": a macaque's basal ganglia in spikes, driven by raw evidence;
        - "spiking_msprt": spiking cells that compute the MSPRT;
        - "bogacz_gurney": the exact circuit of Bogacz & Gurney (2007), where OUT = -ln P;
        - "appendix_b": the exact circuit with all pathways (their appendix B);
        - "linear_gpe": the same circuit with a linear GPe, which is not exact;
        - "gpr": action selection by rates (Gurney, Prescott & Redgrave 2001);
        - "humphries": action selection in spikes (Humphries, Stewart & Gurney 2006);
        - "stewart": the weights of "gpr" in spikes (Stewart, Choo & Eliasmith 2010).
    channels : int, optional
        Number of alternatives; unless given, 2, or that of the file.

    Raises
    ------
    ValueError
        If there is none of that name, with the names that there are; or as ``table_reader.read``.
    """
    named = isinstance(name, (str, Path))
    require(named, "circuit", "must be a name or the path of a .toml file", name)
    if table_files.is_path(name):
        return table_reader.read(name, channels)
    must = f"must be one of {', '.join(CIRCUITS)}, or the path of a .toml file"
    require(name in CIRCUITS, "circuit", must, str(name))
    return CIRCUITS[str(name)](2 if channels is None else channels)
