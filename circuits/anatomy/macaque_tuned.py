"""The macaque's circuit moved to the animal's rates at rest and to beta, without a change of OUT."""

from __future__ import annotations

from dataclasses import replace

from circuits.anatomy.macaque import macaque
from circuits.cells import Phase
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, Population, Projection
from circuits.laws.members import moved

CELLS = {"ctx": 1500, "D1": 12_000, "D2": 2000, "STN": 800, "GPe": 600, "SNr": 1200}
RESTING = {
    "ctx.gain_hz_per_nat": 16.0,
    "D1.gain_hz_per_nat": 2.56,
    "D2.baseline_hz": 0.5, "D2.gain_hz_per_nat": 0.25,
    "STN.gain_hz_per_nat": 12.44,
    "SNr.baseline_hz": 40.0, "SNr.gain_hz_per_nat": 40.0,
}  # fmt: skip
LOOP = {"STN.tau_ms": 14.0, "GPe->STN.tau_ms": 12.0, "GPe->STN.weight": -0.45, "Sigma0": 2.6}
LEGS = {
    "ctx->D1.tau_ms": 2.0, "ctx->D2.tau_ms": 2.0, "ctx->STN.tau_ms": 2.0,
    "D1->SNr.tau_ms": 4.0, "STN->SNr.tau_ms": 18.0,
}  # fmt: skip
FSI, D1_ABOVE_NATS = 0.15, 0.1
import os
def macaque_tuned(channels: int = 2) -> Circuit:
    circuit = macaque(channels)
    for name, neurons in CELLS.items():
        circuit = circuit.with_population(name, neurons=neurons)
    circuit = moved(circuit, {**RESTING, **LOOP, **LEGS})
    for name in ("D1", "SNr"):
        bias = circuit.population(name).bias_nats + D1_ABOVE_NATS
        circuit = circuit.with_population(name, bias_nats=bias)
    # Each channel's FSI subtract from D1 what its cortex adds beyond the weight that OUT needs.
    more = circuit.pathway("ctx", "D1").weight + FSI if hasattr(circuit, "pathway") else None
    weight = next(p.weight for p in circuit.projections if p.pair == "ctx->D1")
    rest = 2.2
    circuit = circuit.with_projection("ctx", "D1", "", weight=weight + FSI)
    circuit = circuit.with_population("D1", bias_nats=circuit.population("D1").bias_nats - FSI * rest)
    circuit = circuit.add(
        Population("FSI", Phase(0.5), baseline_hz=11.0, gain_hz_per_nat=5.0, transmitter=GABA, neurons=300,
            bias_nats=-rest, heterogeneity=0.3, cite="assumed", published_hz=(7.8, 14.0)),
        Projection("ctx", "FSI", 1.0, delay_ms=7, tau_ms=4, cite="assumed"),
        Projection("FSI", "D1", -FSI, delay_ms=1, tau_ms=4, cite="assumed"),
    )
    return replace(circuit, name="macaque_tuned", unedited=None, exact=True, readout_tau_ms=16, default_gain=.65 , max_lead_nats=macaque(channels).max_lead_nats)
