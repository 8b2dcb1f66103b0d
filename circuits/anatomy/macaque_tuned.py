"""The macaque's circuit with the animal's resting rates and beta, which leave OUT = -ln P."""

from __future__ import annotations

from dataclasses import replace

from circuits.anatomy.macaque import LIENARD, OF_TWO, SHEN, macaque
from circuits.circuit import Circuit
from circuits.declaration.motifs import FEEDFORWARD, striatal_fsi
from circuits.declaration.rows import Projection
from circuits.laws.members import DIGITS, moved

RATES = {
    "ctx.gain_hz_per_nat": 16.0,  # 36 Hz before the evidence
    "D1.gain_hz_per_nat": 2.56,
    "D2.baseline_hz": 0.5,
    "D2.gain_hz_per_nat": 0.3,  # not silent while OUT is read
    "STN.gain_hz_per_nat": 12.44,  # 16 Hz with two alternatives
    # With STN's input, 2.6 nats at rest, blocked, SNr still fires, and without any input at 54 Hz.
    "SNr.baseline_hz": 54.0,
    "SNr.gain_hz_per_nat": 20.0,
    "GPe.gain_hz_per_nat": 20.0,
}
"""Baselines and gains that are tuned to resting rates, also under block of receptors."""
LOOP = {"STN.tau_ms": 14.0, "GPe->STN.tau_ms": 12.0, "GPe->STN.weight": -0.45, "Sigma0": 2.6}
"""A stronger and slower loop, tuned to a peak of 8 to 15 Hz at half the dopamine."""
LEGS = {
    "ctx->D1.tau_ms": 2.0,
    "ctx->D2.tau_ms": 2.0,
    "ctx->STN.tau_ms": 2.0,
    "D1->SNr.tau_ms": 4.0,
    "STN->SNr.tau_ms": 18.0,
}
"""Synapses on the way from cortex to SNr, so that D1 and STN reach it at the same time."""
CELLS = {"ctx": 3000, "D1": 9000, "D2": 3500, "STN": 2000, "GPe": 2000, "SNr": 4500}
"""Cells of a channel: where a nat is fewer Hz, more cells carry it with the same noise."""
FROM_FSI, MORE_D1_NATS = 0.15, 0.1
"""What a channel's FSI take from D1, nats per nat, and how much higher D1 rests, nats."""
TUNED_LOOP = f"delay {LIENARD}; tau, share tuned; D2 {SHEN}"
TUNED_STN, ALIKE = f"{OF_TWO}; tau, cells tuned", "heterogeneity assumed"
MOST_LEAD_NATS = {
    2: 3.4, 3: 3.1, 4: 2.5, 5: 1.5, 6: 0.8, 7: 0.75, 8: 0.6, 9: 0.4, 10: 0.3, 11: 0.25, 12: 0.23,
}  # fmt: skip
"""As in ``macaque``; with two and three alternatives, the largest that was tried."""


def macaque_tuned(channels: int = 2) -> Circuit:
    """Return the circuit ``macaque`` moved along the free directions of OUT = -ln P.

    Rates in Hz, the time constants of the loop of STN and GPe, its share and Sigma at rest do not
    enter OUT at the fixed point (``circuits.laws.family``). Here they are tuned to numbers of the
    exam: resting rates of two alternatives, also with receptors blocked, beta after dopamine loss,
    and the cortical rate of alternatives that are not chosen.

    The striatal fast-spiking interneurons (FSI) of a channel take from D1 a part of the cortical
    input, which a larger weight ctx->D1 restores.
    """
    circuit = macaque(channels, name="macaque_tuned")
    for name, neurons in CELLS.items():
        circuit = circuit.with_population(name, neurons=neurons)
    circuit = moved(circuit, RATES | LOOP | LEGS)
    weight = next(p.weight for p in circuit.projections if p.pair == "ctx->D1")
    circuit = circuit.with_projection("ctx", "D1", weight=round(weight + FROM_FSI, DIGITS))
    circuit = circuit.with_projection("GPe", "STN", cite=TUNED_LOOP)
    circuit = circuit.with_population("STN", cite=TUNED_STN, cite_more=ALIKE)
    less = FROM_FSI * circuit.rest_drive
    for name, more in (("D1", MORE_D1_NATS - less), ("SNr", MORE_D1_NATS)):
        bias = round(float(circuit.population(name).bias_nats + more), DIGITS)
        circuit = circuit.with_population(name, bias_nats=bias)
    cells, onto_cells, *_ = striatal_fsi(circuit)
    to_d1 = Projection("FSI", "D1", -FROM_FSI, delay_ms=1, tau_ms=4, cite=FEEDFORWARD)
    return replace(
        circuit.add(cells, onto_cells, to_d1),
        about="basal ganglia of a macaque with its rates at rest and its beta without dopamine",
        unedited=None,
        max_lead_nats=MOST_LEAD_NATS[channels],
    )
