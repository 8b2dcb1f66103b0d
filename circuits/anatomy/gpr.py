"""The circuit of Gurney, Prescott & Redgrave 2001: selected channels have a low output rate."""

from __future__ import annotations

from circuits.cells import Rate
from circuits.checks import check_channels, check_range
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows

GPR = "Gurney et al. 2001"
ASSUMED = "1 is 100 Hz, assumed"


def gpr(channels: int = 2, *, dopamine: float = 0.2) -> Circuit:
    """Return the circuit of Gurney, Prescott & Redgrave 2001: rate units with ramps from 0 to 1.

    Inputs are saliences, 0..1; the output of each channel (SNr and GPi) is a rate, 0..1. A channel
    is selected when its output falls below a threshold, in the same unit. Neither input nor output
    defines a posterior. The ramps' thresholds are negative biases here. Tau is 1/k of the authors'
    code (ModelDB 83560; k = 25 per s); a SpineML port uses 10 ms. The dopamine level is lambda,
    0..1: cortical weights are ``1 + lambda`` onto D1 and ``1 - lambda`` onto D2.
    """
    check_channels(channels)
    check_range(0, 1, dopamine=dopamine)
    unit, weight, gained = Rate(), GPR, f"{GPR}, lambda {dopamine:g}"
    salience = f"{GPR}, saliences 0 to 1; {ASSUMED}"
    ramp = f"{GPR}, ramp; tau, authors' code; {ASSUMED}"
    # fmt: off
    populations = rows(Population, (
        "name   cell  gain_hz_per_nat  transmitter  receptor  transfer  tau_ms  bias_nats cite",
        ("ctx", unit, 100,             GLUTAMATE,   "",       "ramp",   0,      0,        salience),
        ("D1",  unit, 100,             GABA,        "D1",     "ramp",   40,     -0.2,     ramp),
        ("D2",  unit, 100,             GABA,        "D2",     "ramp",   40,     -0.2,     ramp),
        ("STN", unit, 100,             GLUTAMATE,   "",       "ramp",   40,     0.25,     ramp),
        ("GPe", unit, 100,             GABA,        "",       "ramp",   40,     0.2,      ramp),
        ("SNr", unit, 100,             GABA,        "",       "ramp",   40,     0.2,      ramp),
    ))
    projections = rows(Projection, (
        "source target weight        pattern    cite",
        ("ctx", "D1",  1 + dopamine, "channel", gained),
        ("ctx", "D2",  1 - dopamine, "channel", gained),
        ("ctx", "STN", 1,            "channel", weight),
        ("D1",  "SNr", -1,           "channel", weight),
        ("D2",  "GPe", -1,           "channel", weight),
        ("STN", "GPe", 0.9,          "diffuse", weight),
        ("STN", "SNr", 0.9,          "diffuse", weight),
        ("GPe", "STN", -1,           "channel", weight),
        ("GPe", "SNr", -0.3,         "channel", weight),
    ))
    # fmt: on
    return Circuit(
        name="gpr",
        populations=populations,
        projections=projections,
        channels=channels,
        unit="salience",
        reference_nats=0.0,
        range_nats=(-float("inf"), 1.0),
        about=f"rates select the channel of the largest salience; {GPR}",
    )
