"""What the page's script solves: a circuit as plain numbers, by the number of alternatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bgmodel.integrators.basal_ganglia import gain_of, identity
from circuits.anatomy import load_circuit
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, RECEPTORS
from circuits.declaration.table_files import is_path
from circuits.dynamics.fixed_point import parts, wired
from circuits.dynamics.wiring import Wiring
from circuits.errors import InputError

ALTERNATIVES = (2, 3, 4)
LESIONED = ("STN", "GPe", "D1", "D2")
"""Nuclei with a slider."""


def tables(name: str | Path) -> dict[str, Any]:
    """Return a circuit as plain numbers, by the number of alternatives.

    Parameters
    ----------
    name : str or path
        A shipped table, which exists for every number in ``ALTERNATIVES``, or a table's file, which
        holds one number of alternatives.

    Raises
    ------
    ValueError
        As ``circuits.anatomy.circuit`` and ``check_shown``.
    """
    if is_path(name):
        table = load_circuit(name)
        return {str(table.channels): plain(table)}
    return {str(n): plain(load_circuit(name, n)) for n in ALTERNATIVES}


def check_shown(table: Circuit) -> None:
    """Refuse a circuit that the page cannot show.

    Raises
    ------
    ValueError
        If it does not work in nats, has courses, no default gain or another number of alternatives
        than the page draws, or cannot be edited as the sliders do: it lacks a nucleus, say.
    """
    table.check_nats("the page's -ln P")
    table.check_steady("the page")
    if table.channels not in ALTERNATIVES:
        raise InputError(
            f"the page shows {ALTERNATIVES[0]} to {ALTERNATIVES[-1]} alternatives, "
            f"{table.name} has {table.channels}",
            "channels",
        )
    for name in LESIONED:
        table.lesion(name, 0.5)
    table.dopamine(0.5)
    if table.default_gain is None:
        raise InputError(
            f"{table.name} has no default gain, which the page needs: save the table with "
            "--save and set default_gain in that file",
            "default_gain",
        )


def plain(table: Circuit) -> dict[str, Any]:
    """Return the numbers behind the fixed point of one circuit, as plain JSON values.

    Raises
    ------
    ValueError
        As ``check_shown``.
    """
    check_shown(table)
    wiring = wired(table)
    return {
        "name": table.name,
        "sha256": identity(table)["sha256"],
        "channels": table.channels,
        "kappa": gain_of(table),
        "centred": table.centred,
        "reach": table.max_deficit_nats,
        "driveGain": table.drive_gain,
        "readable": list(table.readable_nats),
        "populations": [row.name for row in table.populations],
        "pathways": [
            {
                "from": p.source,
                "to": p.target,
                "inhibits": table.population(p.source).transmitter == GABA,
            }
            for p in table.projections
        ],
        "owner": wiring.owner.tolist(),
        "baseline": wiring.baseline_hz.tolist(),
        "gain": wiring.gain_hz_per_nat.tolist(),
        "floor": wiring.floor_hz.tolist(),
        "transfer": [wiring.row(b).transfer for b in range(wiring.blocks)],
        "unitTransfer": [wiring.projection(u).transfer for u in range(wiring.units)],
        "deliver": wiring.deliver.tolist(),
        "constant": wiring.constant.tolist(),
        "weight": wiring.weight.tolist(),
        "bias": wiring.bias.tolist(),
        "input": wiring.blocks_of(table.input).tolist(),
        "readout": wiring.blocks_of(table.readout).tolist(),
        "parts": [{"blocks": b.tolist(), "loop": bool(loop)} for b, loop in parts(wiring)],
        "dopamine": _dopamine(wiring),
    }


def _dopamine(wiring: Wiring) -> list[dict[str, Any]]:
    """Return the pathways that dopamine scales, as ``Circuit.dopamine`` does."""
    table = wiring.circuit
    return [
        {
            "sign": RECEPTORS[row.receptor],
            "weight": path.weight,
            "pivot": row.operating_point_nats,
            "blocks": wiring.blocks_of(path.target).tolist(),
            "units": [u for u in range(wiring.units) if wiring.projection(u) is path],
        }
        for path, row in table.receptors()
    ]
