"""THE TABLES: every nucleus, every pathway, every number with its source; one table a file.

Weights are in nats: what a nat of the source's activity adds to the target's input. Rates follow
from each row's baseline and gain. Where a source is "assumed" or "tuned", that is what it is.
"""

from __future__ import annotations

from collections.abc import Callable

from circuits.anatomy.exact import appendix_b, bogacz_gurney, linear_gpe
from circuits.anatomy.spiking_msprt import spiking_msprt
from circuits.spec import Circuit

__all__ = [
    "CIRCUITS",
    "appendix_b",
    "bogacz_gurney",
    "circuit",
    "linear_gpe",
    "spiking_msprt",
]

CIRCUITS: dict[str, Callable[..., Circuit]] = {
    "bogacz_gurney": bogacz_gurney,
    "appendix_b": appendix_b,
    "linear_gpe": linear_gpe,
    "spiking_msprt": spiking_msprt,
}
"""All tables by name; each takes the number of channels."""


def circuit(name: str, channels: int = 2) -> Circuit:
    """Return a circuit by name; raises ValueError with the names that there are."""
    if name not in CIRCUITS:
        raise ValueError(f"circuit must be one of {', '.join(CIRCUITS)}, got {name!r}")
    return CIRCUITS[name](channels)
