"""A straightforward Brian2 version of the circuit: every cell and every synapse, one trial.

All-to-all synapses, Brian2's own noise, no relays: the reference for the speed of the engines. The
slow common mode stays at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.cells import Lif, Phase
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection

LAW = {"linear": "{x}", "rectified": "clip({x}, 0, inf)", "exp": "exp({x})"}


def network(b2: Any, circuit: Circuit) -> tuple[Any, int]:
    """Return a Brian2 network of a circuit at rest, one trial, and its number of cells."""
    groups, synapses = {row.name: _group(b2, circuit, row) for row in circuit.populations}, []
    for p in circuit.projections:
        if circuit.population(p.source).spiking:
            synapses.append(_pathway(b2, circuit, p, groups))
        else:
            groups[p.target].run_regularly(f"s_{p.source} = 0", name=f"{p.target}_quick")
    cells = sum(len(groups[row.name]) for row in circuit.populations if row.spiking)
    return b2.Network(*groups.values(), *synapses), cells


def _group(b2: Any, circuit: Circuit, row: Population) -> Any:
    """Return a population as a group of cells, each with its input by each pathway."""
    text, options = _equations(b2, row, _input(circuit, row))
    into = [p for p in circuit.projections if p.target == row.name]
    decays = [f"ds_{p.source}/dt = -s_{p.source}/({p.tau_ms}*ms) : 1" for p in into if p.tau_ms]
    # A pathway without a time constant passes on what the source holds.
    quick = [f"s_{p.source} : 1" for p in into if not p.tau_ms]
    count = circuit.channels_of(row.name) * (row.neurons if row.spiking else 1)
    equations = "\n".join([text, *decays, *quick])
    group = b2.NeuronGroup(count, equations, name=row.name, method="euler", **options)
    if row.spiking:
        group.v = f"{getattr(row.cell, 'reset_mv', 0)} + rand()"
    return group


def _input(circuit: Circuit, row: Population) -> str:
    """Return a population's input, nats, as text."""
    drive = circuit.reference_nats - np.log(circuit.channels)
    parts = [str(row.bias_nats + (drive if row.name == circuit.input else 0))]
    for p in circuit.projections:
        if p.target == row.name:
            source = circuit.population(p.source)
            rest = source.baseline_hz / source.gain_hz_per_nat
            parts.append(f"{p.weight}*(s_{p.source} - {rest})")
    return " + ".join(parts)


def _equations(b2: Any, row: Population, nats: str) -> tuple[str, dict[str, Any]]:
    """Return the equations of a population's cells, and the options of their group."""
    cell = row.cell
    if isinstance(cell, Lif):
        text = f"""dv/dt = ({cell.rest_mv} + {cell.mv_per_nat}*({nats}) - v)/({cell.tau_ms}*ms)
            + {cell.noise_mv}*sqrt(2/({cell.tau_ms}*ms))*xi : 1 (unless refractory)"""
        return text, {
            "threshold": f"v > {cell.threshold_mv}",
            "reset": f"v = {cell.reset_mv}",
            "refractory": cell.refractory_ms * b2.ms,
        }
    if isinstance(cell, Phase):
        rate = f"clip({row.baseline_hz} + {row.gain_hz_per_nat}*f, 0, inf)*Hz"
        text = f"""dx/dt = ({nats} - x)/({row.tau_ms}*ms) : 1
            f = {LAW[row.transfer].format(x="x")} : 1
            rate = {rate} : Hz
            dv/dt = rate + {cell.cv}*sqrt(rate/dt)*randn() : 1"""
        return text, {"threshold": "v > 1", "reset": "v -= 1"}
    return f"dx/dt = ({nats})/({row.tau_ms}*ms) : 1", {}


def _pathway(b2: Any, circuit: Circuit, p: Projection, groups: dict[str, Any]) -> Any:
    """Return a pathway as synapses, one for each pair of cells."""
    source, target = circuit.population(p.source), circuit.population(p.target)
    jump = 1000 / (source.neurons * source.gain_hz_per_nat * p.tau_ms)
    pathway = b2.Synapses(
        groups[p.source],
        groups[p.target],
        on_pre=f"s_{p.source}_post += {jump}",
        delay=p.delay_ms * b2.ms,
        name=f"{p.source}_{p.target}",
    )
    alike = p.pattern == "channel" and target.spiking
    pathway.connect(f"i//{source.neurons} == j//{target.neurons}" if alike else True)
    return pathway
