"""The same circuit as one would first write it in Brian2: every cell and every synapse, one trial.

All-to-all synapses, Brian2's own noise, no relays: what the engines are compared with. The slow
common mode stays at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.cells import Lif, Phase
from circuits.spec import Circuit

LAW = {"linear": "{x}", "rectified": "clip({x}, 0, inf)", "exp": "exp({x})"}


def network(b2: Any, circuit: Circuit) -> tuple[Any, int]:
    """Return a Brian2 network of a circuit at rest, one trial, and its number of cells."""
    groups, synapses, cells = {}, [], 0
    for row in circuit.populations:
        into = [p for p in circuit.projections if p.target == row.name]
        count = circuit.channels_of(row.name) * (row.neurons if row.spiking else 1)
        drive = circuit.reference_nats - np.log(circuit.channels)
        bias = row.bias_nats + (drive if row.name == circuit.input else 0)
        sources = [circuit.population(p.source) for p in into]
        parts = [
            f"{p.weight}*(s_{p.source} - {s.baseline_hz / s.gain_hz_per_nat})"
            for p, s in zip(into, sources, strict=True)
        ]
        nats = " + ".join([str(bias), *parts])
        decays = "\n".join(f"ds_{p.source}/dt = -s_{p.source}/({p.tau_ms}*ms) : 1" for p in into)
        cell = row.cell
        options: dict[str, Any] = {"method": "euler"}
        if isinstance(cell, Lif):
            text = f"""dv/dt = ({cell.rest_mv} + {cell.mv_per_nat}*({nats}) - v)/({cell.tau_ms}*ms)
                + {cell.noise_mv}*sqrt(2/({cell.tau_ms}*ms))*xi : 1 (unless refractory)"""
            options |= {
                "threshold": f"v > {cell.threshold_mv}",
                "reset": f"v = {cell.reset_mv}",
                "refractory": cell.refractory_ms * b2.ms,
            }
        elif isinstance(cell, Phase):
            rate = f"clip({row.baseline_hz} + {row.gain_hz_per_nat}*f, 0, inf)*Hz"
            text = f"""dx/dt = ({nats} - x)/({row.tau_ms}*ms) : 1
                f = {LAW[row.transfer].format(x="x")} : 1
                rate = {rate} : Hz
                dv/dt = rate + {cell.cv}*sqrt(rate/dt)*randn() : 1"""
            options |= {"threshold": "v > 1", "reset": "v -= 1"}
        else:
            text = f"dx/dt = ({nats})/({row.tau_ms}*ms) : 1"
        # A pathway without a time constant passes on what the source holds.
        quick = [p for p in into if p.tau_ms == 0]
        decays = "\n".join(line for line in decays.splitlines() if "/(0.0*ms)" not in line)
        quick_text = "\n".join(f"s_{p.source} : 1" for p in quick)
        groups[row.name] = b2.NeuronGroup(
            count, "\n".join([text, decays, quick_text]), name=row.name, **options
        )
        if row.spiking:
            groups[row.name].v = f"{getattr(cell, 'reset_mv', 0)} + rand()"
            cells += count
    for p in circuit.projections:
        source = circuit.population(p.source)
        if not source.spiking:
            groups[p.target].run_regularly(f"s_{p.source} = 0", name=f"{p.target}_quick")
            continue
        jump = 1000 / (source.neurons * source.gain_hz_per_nat * p.tau_ms)
        pathway = b2.Synapses(
            groups[p.source],
            groups[p.target],
            on_pre=f"s_{p.source}_post += {jump}",
            delay=p.delay_ms * b2.ms,
            name=f"{p.source}_{p.target}",
        )
        target = circuit.population(p.target)
        alike = p.pattern == "channel" and target.spiking
        pathway.connect(f"i//{source.neurons} == j//{target.neurons}" if alike else True)
        synapses.append(pathway)
    return b2.Network(*groups.values(), *synapses), cells
