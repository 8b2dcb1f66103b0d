"""The exact circuits of Bogacz & Gurney 2007, where OUT = -ln P, and one with a linear GPe."""

from __future__ import annotations

import math
from dataclasses import replace

from circuits.cells import Rate
from circuits.checks import check_channels, check_range
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows
from circuits.errors import require

BG2007 = "Bogacz & Gurney 2007"
APPENDIX_B = "Bogacz & Gurney 2007, appendix B"


def bogacz_gurney(channels: int = 2) -> Circuit:
    """Return the exact circuit: OUT = -ln P (Bogacz & Gurney 2007, sections 3 and 4)."""
    return appendix_b(channels, w_gpe_stn=1.0, w_d2_gpe=0.0)


def appendix_b(channels: int = 2, *, w_gpe_stn: float = 0.7, w_d2_gpe: float = 0.5) -> Circuit:
    """Return a member of the exact family with all pathways (Bogacz & Gurney 2007, appendix B).

    Weights are magnitudes: those of GPe sum to 1, and that of D1 is ``1 + w_d2_gpe``.
    """
    check_channels(channels)
    check_range(0, 1, w_gpe_stn=w_gpe_stn)
    check_range(0, math.inf, w_d2_gpe=w_d2_gpe)
    w_gpe_snr, w_d1_snr = 1 - w_gpe_stn, 1 + w_d2_gpe
    simple = w_gpe_snr == 0 and w_d2_gpe == 0
    source = BG2007 if simple else APPENDIX_B
    # The source is algebraic: time constants, delays and gains in Hz are our assumptions.
    row, path = f"{source}; tau and gain in Hz assumed", f"{source}; delay assumed"
    ctx = f"y = g* Y, {BG2007}; gain in Hz assumed"
    line, unit = Rate(signed=True), Rate()
    # fmt: off
    populations = rows(Population, (
        "name  cell  baseline_hz gain_hz_per_nat transmitter receptor transfer  pooled tau_ms cite",
        ("ctx", line, 0,         10,             GLUTAMATE,  "",       "linear", False, 0.0,   ctx),
        # The direct pathway takes as long as the one through STN, or OUT would dip transiently.
        ("D1",  line, 0,         10,             GABA,       "D1",     "linear", False, 5,     row),
        ("D2",  line, 0,         10,             GABA,       "D2",     "linear", False, 10,    row),
        ("STN", unit, 0,         8,              GLUTAMATE,  "",       "exp",    False, 5,     row),
        ("GPe", line, 0,         15,             GABA,       "",       "linear", simple,10,    row),
        ("SNr", unit, 0,         30,             GABA,       "",       "linear", False, 5,     row),
    ))
    projections = rows(Projection, (
        "source target weight       pattern    delay_ms  transfer         cite",
        ("ctx", "D1",  1,          "channel", 3,        "linear",        path),
        ("ctx", "D2",  1,          "channel", 5,        "linear",        path),
        ("ctx", "STN", 1,          "channel", 3,        "linear",        path),
        ("D1",  "SNr", -w_d1_snr,  "channel", 2,        "linear",        path),
        ("D2",  "GPe", -w_d2_gpe,  "channel", 4,        "linear",        path),
        ("STN", "GPe", 1,          "diffuse", 2,        "s_minus_log_s", path),
        ("STN", "SNr", 1,          "diffuse", 2,        "linear",        path),
        ("GPe", "STN", -w_gpe_stn, "channel", 2,        "linear",        path),
        ("GPe", "SNr", -w_gpe_snr, "channel", 2,        "linear",        path),
    ))
    # fmt: on
    if simple:
        populations = tuple(p for p in populations if p.name != "D2")
        silent = {"ctx->D2", "D2->GPe", "GPe->SNr"}
        projections = tuple(p for p in projections if p.name not in silent)
    return Circuit(
        name="bogacz_gurney" if simple else "appendix_b",
        populations=populations,
        projections=projections,
        channels=channels,
        drive_gain=1 / (1 + w_gpe_stn * w_d2_gpe),
        exact=True,
        range_nats=(0.0, 5.0),
        about=f"OUT = -ln P exactly; {source}",
    )


def linear_gpe(channels: int = 2, *, slope: float = 1.0) -> Circuit:
    """Return the circuit with a linear GPe, ``GPe = slope * Sigma`` (Bogacz & Gurney 2007).

    The best values in their figure are a slope of 0.84 and evidence scaled by 0.4.
    """
    require(slope > 0, "slope", "must be > 0", slope)
    exact = bogacz_gurney(channels)
    linear = exact.with_projection("STN->GPe", transfer="linear", weight=slope, cite=BG2007)
    # Up to a loop gain slope * Sigma of 4, as in the exact circuit; oscillations begin at 4.5.
    reach = (0.0, 4 + math.log(4 / slope))
    about = f"GPe linear in its input; {BG2007}"
    return replace(linear, name="linear_gpe", about=about, range_nats=reach, unedited=None)
