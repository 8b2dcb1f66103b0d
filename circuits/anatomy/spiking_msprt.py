"""THE TABLE of a spiking circuit that computes the MSPRT, with the source of every number."""

from __future__ import annotations

from math import exp, log, log1p

from circuits.cells import Lif, Phase, Rate
from circuits.checks import check_channels
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows

HUMPHRIES = "Humphries, Stewart & Gurney 2006"
TUNED = "tuned"
CORTEX = "CV assumed; rate range tuned"
COMMON = "assumed: slow thalamic or interneuron feedback; time tuned"
CV = f"CV assumed; {TUNED}"
FITTED = f"{TUNED}; currents by fit_current"
PIVOT = f"{FITTED}; pivot assumed"
FAST = f"{HUMPHRIES}, AMPA 2 and GABA 3 ms; "

# fmt: off
#         tau_ms  noise_mv  threshold_mv  reset_mv  refractory_ms  rest_mv  mv_per_nat
D1  = Lif(12,     3,        15,           5,        2,              8.17,   13.34)
D2  = Lif(12,     3,        15,           5,        2,              8.30,   1.256)
GPE = Lif(10,     4,        15,           3,        2,             14.07,   13.56)
SNR = Lif(10,     4,        15,           3,        2,              7.68,   17.01)
# fmt: on


def spiking_msprt(channels: int = 2) -> Circuit:
    """Return the spiking circuit that computes the MSPRT.

    The drive is kept where STN's sum Sigma is near ``s0``: there a channel's y is ``top`` less its
    OUT. Without evidence y is ``s0`` for any number of channels, so that all have the same range
    below it: a losing channel that falls silent no longer signals to STN how far behind it is. STN
    and GPe follow ``Sigma = S`` about that point, GPe by a linear ``S - ln S``; a slow, bounded
    common mode (gain 10, acting within 200 ms) subtracts from every cortical channel whatever
    raises Sigma above ``s0``, which does not change OUT. D1 fires only above ``top - 0.65``, so
    that MSN are quiet at rest and OUT can be read up to 0.65. A tenth of the evidence reaches STN
    through D2 and GPe, the rest directly: the exponent still sums to y. Tuned on
    separate seeds.

    The default gain: near a decision OUT follows the evidence with a slope ``kappa (1 - P)``, P the
    softmax of ``kappa L``. A higher gain drowns out cortical noise, but beyond some gain the noise
    of the other populations drowns out OUT. With two alternatives the slope at accuracies of 0.90
    to 0.97 stays high for longer than with four; with eight, OUT at 0.90 lies above the readable
    range unless the gain is higher. Tuned on separate seeds.
    """
    check_channels(channels)
    s0 = 2.2
    top = s0 + log(channels)
    slope = 1 - 1 / s0
    # fmt: off
    populations = rows(Population, (
        "name      cell        neurons  pooled  baseline_hz  gain_hz_per_nat  transmitter  cite",
        ("ctx",    Phase(0.5), 300,     False,  1,           25,              GLUTAMATE,   CORTEX),
        ("common", Rate(),     1,       True,   0,           1,               GABA,        COMMON),
        ("D1",     D1,         300,     False,  0,           80,              GABA,        PIVOT),
        ("D2",     D2,         300,     False,  5,           3.5,             GABA,        PIVOT),
        ("STN",    Phase(0.3), 300,     False,  0,           21.8,            GLUTAMATE,   CV),
        ("GPe",    GPE,        300,     False,  45,          80,              GABA,        FITTED),
        ("SNr",    SNR,        300,     False,  10,          95,              GABA,        FITTED),
    ), (
        "name      transfer     tau_ms  receptor  operating_point_nats  bias_nats",
        ("ctx",    "rectified", 2,      "",       0.0,        0.7),
        ("common", "linear",    2000,   "",       0.0,        0.7 - 10 * s0),
        # Gain changes about 0 would move OUT by all of y; about a pivot, by the part above it.
        ("D1",     "linear",    0.0,    "D1",     top - 1.3,  -(top - 0.65)),
        ("D2",     "linear",    0.0,    "D2",     top - 0.3,  -(top - 0.3)),
        ("STN",    "exp",       5,      "",       0.0,        log(s0) - top + 0.1 * (top - 0.3)),
        ("GPe",    "linear",    0.0,    "",       0.0,        -slope * s0),
        ("SNr",    "linear",    0.0,    "",       0.0,        top - s0 - (top - 0.65)),
    ), (
        "name      cite_more",
        ("ctx",    "cells, tau assumed"),
    ))
    projections = rows(Projection, (
        "source    target    weight     pattern    delay_ms  tau_ms  cite",
        ("ctx",    "D1",     1,         "channel", 5,        4,      FAST + "delay tuned"),
        ("ctx",    "D2",     1,         "channel", 5,        4,      FAST + "delay tuned"),
        ("ctx",    "STN",    0.9,       "channel", 2.5,      4,      FAST + "its delay"),
        ("common", "ctx",    -1,        "diffuse", 2,        0.0,    "assumed"),
        ("D1",     "SNr",    -1,        "channel", 4,        6,      HUMPHRIES + "; kernel tuned"),
        ("D2",     "GPe",    -0.1,      "channel", 5,        4,      FAST + "its delay"),
        ("STN",    "common", 10,        "diffuse", 2,        5,      "assumed"),
        ("STN",    "GPe",    slope,     "diffuse", 2,        3,      FAST + "its delay"),
        ("STN",    "SNr",    1,         "diffuse", 2,        34,     TUNED + "; kernel"),
        ("GPe",    "STN",    -1,        "channel", 2,        4,      FAST + "delay 4 there"),
    ))
    # fmt: on
    return Circuit(
        name="spiking_msprt",
        populations=populations,
        projections=projections,
        channels=channels,
        reference_nats=top,
        readout_tau_ms=28,
        range_nats=(1.0, 12.0),
        # Losing channels are silent once they are top nats behind.
        readable_nats=(log1p((channels - 1) * exp(-top)), top - (top - 0.65)),
        # Odds of e^5 exceed every threshold; larger deficits would only outrun the common mode.
        max_deficit_nats=5.0,
        most_channels=12,
        default_gain=0.7 if channels == 2 else 0.5 if channels < 8 else 0.6,
        about="spiking cells that compute the MSPRT; after circuit J of a feasibility study",
    )
