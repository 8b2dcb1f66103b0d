"""THE TABLE of the macaque basal ganglia, spiking and driven by raw evidence, with all sources."""

from __future__ import annotations

from math import exp, inf, log, log1p

from circuits.cells import Phase, Rate
from circuits.checks import check_channels
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection, rows

LIENARD = "Lienard & Girard 2014"
HUMPHRIES = "Humphries et al. 2006"
HERNANDEZ = "Hernandez et al. 2006, rat"
SHEN = "Shen & Johnson 2000, rat"
ASSUMED = "assumed"
AMPA = f"delay {LIENARD}; tau assumed, near AMPA's 2 ms, {HUMPHRIES}"
GABA_A = f"delay {LIENARD}; tau assumed, near GABA's 3 ms, {HUMPHRIES}"
KERNEL = f"delay {LIENARD}; time constant tuned"
SHARED = f"delay {LIENARD}; tau assumed, share tuned"
FSI = f"rate {LIENARD}, macaque; CV, gain, cells, heterogeneity assumed"
DRIVEN = f"cortex drives them, Mallet et al. 2005, rat; delay as ctx->D1, {LIENARD}; rest assumed"
FEEDFORWARD = (
    "inhibit D1 and D2, Koos & Tepper 1999, Planert et al. 2010, rats; D1 more than D2, "
    "Gittis et al. 2010, mouse; strength, reach, delay, tau assumed"
)
CORTEX = "CV assumed; range of rates tuned"
FAST = "cortical interneurons, driven by all cortex; rate, gain assumed"
MSN = "CV assumed; cells and rate tuned"
PACEMAKER = f"pacemaker, CV assumed; rate {LIENARD}"
OF_TWO = f"pacemaker, CV assumed; rate of 2 channels {LIENARD}"
OUTPUT = "pacemaker, CV assumed; rate tuned"
EXACT = "weight derived"
"""From OUT = -ln P, given the weights that are tuned or assumed."""
BENT = f"{EXACT}; pivot assumed"
GUESSED = "weight assumed"
TIMED = "weight, tau assumed"
WIRE = "weight, delay assumed"
D2_BENT = f"{KERNEL}; D2 {HERNANDEZ}"
D2_GABA = f"delay {LIENARD}; tau, share tuned; D2 {SHEN}"
MOST_LEAD_NATS = {
    2: 3.4, 3: 3.1, 4: 3.0, 5: 1.5, 6: 0.9, 7: 0.6, 8: 0.45, 9: 0.4, 10: 0.32, 11: 0.27, 12: 0.23,
}  # fmt: skip
"""Largest lead per 100 ms by number of alternatives, measured (benchmarks/tuning/strength.py).

Up to this lead, at most 2.5 % of decisions come 400 ms or more after those of the fixed point, at
a posterior of 0.9; with two and three alternatives it is the largest that was tried. With many the
limit is set by the highest cortical rate.
"""
SLOW = "GPe to frontal cortex, Saunders et al. 2015, mouse; rest assumed"
TO_SLOW = "input from STN, gain, time assumed"
TO_CTX = "GPe to frontal cortex, Saunders et al. 2015, mouse; delay assumed"


def macaque(channels: int = 2, *, name: str = "macaque") -> Circuit:
    """Return the circuit driven by raw evidence, which cancels input common to all channels.

    The cortex of each channel receives that channel's evidence. Input common to all channels moves
    STN's sum Sigma, and three parts of the circuit keep it out of OUT. (1) With
    ``G = Sigma - ln Sigma`` in GPe, of which STN receives the share w and SNr the rest,
    ``ln Sigma = S - w G`` and SNr receives ``Sigma - (1 - w) G = S``, at every S (Bogacz & Gurney
    2007, appendix B). The loop's gain is ``w (Sigma - 1)``: the smaller w, the wider the range of
    S in which it is stable. (2) Fast cortical interneurons reduce the common input to
    ``1 / (1 + 1.25)`` of its size. (3) GPe cells that project to cortex return Sigma to its resting
    value, with a gain of 10 and within 500 ms.

    At rest D1 is half a nat above the point where it falls silent, for any number of channels, so
    that it can follow when all channels fall together. The striatal fast-spiking interneurons (FSI)
    of a channel take from D1 a part of the cortical input, which the weight ctx->D1 restores.
    STN->SNr is slow, so that a step in all channels reaches SNr through STN at about the same time
    as through D1. All cells are renewal processes whose rate follows their line, so at the fixed
    point OUT is -ln P wherever no cortical channel is silent. Silent competitors count as if they
    were at 0, which makes OUT too high by about ``(N - 2) / N exp(-2.2)`` nats, 0.055 for N = 4;
    only higher resting rates of cortex would correct this.

    Dopamine makes D1's line steeper and D2's flatter about rest, and weakens the STN-GPe loop at
    its terminals: the less dopamine, the closer the loop is to oscillation (Lindahl & Hellgren
    Kotaleski 2016).

    OUT at the fixed point depends on no rate in Hz, no time constant, and not on the loop's share
    and Sigma at rest (``circuits.laws.family``). These are tuned, on separate seeds, to resting
    rates of two alternatives (Lienard & Girard 2014: MSN 0-1, STN 15-23, GPe 56-75, GPi and SNr
    59-80 Hz), to the beta rhythm after dopamine loss, and to the cortical rate of alternatives that
    are not chosen. SNr of the chosen channel pauses to about 44 Hz. Rates at rest of STN, 32 / N
    Hz, and of SNr depend on the number of alternatives as -ln P does.
    """
    check_channels(channels)
    log_n = log(channels)
    rest, tone, above_floor = 2.2, 3.0, 0.5
    sigma, share, indirect, fast = 2.6, 0.45, 0.1, 1.25
    from_fsi = 0.15
    # The exponent of STN still sums to y: the remainder arrives through D2 and GPe. D1 subtracts
    # what D2 adds to OUT through GPe->SNr; at rest FSI's activity is 0.
    direct = 1 - indirect * share
    to_d1 = 1 + from_fsi + indirect - indirect * share
    top = rest + log_n
    from_stn = sigma - log(sigma)  # GPe's resting input, unchanged by dopamine
    # fmt: off
    populations = rows(Population, (
        "name       cell        neurons pooled baseline_hz gain_hz_per_nat transmitter cite",
        ("ctx",     Phase(0.5), 2500,   False, 0.8,        16,             GLUTAMATE,  CORTEX),
        ("ctx_inh", Rate(),     1,      True,  0,          5,              GABA,       FAST),
        ("D1",      Phase(0.5), 30000,  False, 0,          2.56,           GABA,       MSN),
        ("D2",      Phase(0.5), 20000,  False, 0.5,        0.3,            GABA,       MSN),
        ("STN",     Phase(0.3), 2000,   False, 0,          12.44,          GLUTAMATE,  OF_TWO),
        ("GPe",     Phase(0.3), 1500,   False, 58,         20,             GABA,       PACEMAKER),
        ("GPe_ctx", Rate(),     1,      True,  0,          20,             GABA,       SLOW),
        ("SNr",     Phase(0.3), 1200,   False, 40,         40,             GABA,       OUTPUT),
        ("FSI",     Phase(0.5), 3000,   False, 11,         4,              GABA,       FSI),
    ), (
        "name       transfer      tau_ms  receptor  operating_point_nats  bias_nats",
        ("ctx",     "saturating", 2,     "",       0.0,        tone + fast * rest),
        ("ctx_inh", "linear",     5,      "",       0.0,        0.0),
        # Dopamine rotates the lines about the resting input, so resting rates do not change.
        ("D1",      "linear",     0.0,    "D1",     rest,       above_floor - rest * to_d1),
        ("D2",      "linear",     0.0,    "D2",     rest,       -rest),
        ("STN",     "exp",        14,     "",       0.0,        log(sigma) - rest * direct - log_n),
        ("GPe",     "linear",     0.0,    "",       0.0,        -from_stn),
        ("GPe_ctx", "linear",     5000,   "",       0.0,        tone - 10 * sigma),
        ("SNr",     "linear",     0.0,    "",       0.0,        log_n + above_floor - sigma),
        ("FSI",     "linear",     0.0,    "",       0.0,        -rest),
    ), (
        # The mean of the cells' rates is that of the line.
        "name       heterogeneity published_hz  cite_more",
        ("ctx",     0.3,   (),           "heterogeneity, tau assumed; cells tuned"),
        ("ctx_inh", 0.0,   (),           "tau assumed"),
        ("D1",      0.3,   (0.0, 1.0),   "heterogeneity, pivot assumed"),
        ("D2",      0.3,   (0.0, 1.0),   "heterogeneity, pivot assumed"),
        ("STN",     0.3,   (15.2, 22.8), "heterogeneity assumed; tau, cells tuned"),
        ("GPe",     0.3,   (55.7, 74.5), "heterogeneity, cells assumed"),
        ("GPe_ctx", 0.0,   (),           "tau tuned"),
        ("SNr",     0.3,   (59.1, 79.5), "heterogeneity assumed; cells tuned"),
        ("FSI",     0.3,   (7.8, 14.0),  ""),
    ))
    projections = rows(Projection, (
        "source     target     weight        pattern    delay_ms  tau_ms  cite     cite_more",
        ("ctx",     "D1",      to_d1,        "channel", 7,        2,      AMPA,    EXACT),
        ("ctx",     "D2",      1,            "channel", 7,        2,      AMPA,    GUESSED),
        ("ctx",     "STN",     direct,       "channel", 3,        2,      AMPA,    EXACT),
        ("ctx",     "ctx_inh", 1 / channels, "diffuse", 1,        2,      ASSUMED, ""),
        ("ctx_inh", "ctx",     -fast,        "diffuse", 1,        3,      ASSUMED, ""),
        ("D1",      "SNr",     -1,           "channel", 11,       4,      KERNEL,  EXACT),
        ("D2",      "GPe",     -indirect,    "channel", 7,        4,      GABA_A,  GUESSED),
        ("STN",     "GPe",     1,            "diffuse", 3,        3,      D2_BENT, BENT),
        ("STN",     "SNr",     1,            "diffuse", 3,        18,     KERNEL,  EXACT),
        ("STN",     "GPe_ctx", 10,           "diffuse", 3,        5,      TO_SLOW, WIRE),
        ("GPe",     "STN",     -share,       "channel", 10,       12,     D2_GABA, ""),
        ("GPe",     "SNr",     share - 1,    "channel", 3,        4,      SHARED,  ""),
        ("GPe_ctx", "ctx",     -1,           "diffuse", 2,        0.0,    TO_CTX,  GUESSED),
        ("ctx",     "FSI",     1,            "channel", 7,        4,      DRIVEN,  TIMED),
        ("FSI",     "D1",      -from_fsi,    "channel", 1,        4,      FEEDFORWARD, GUESSED),
    ), (
        # Dopamine weakens the loop at its terminals; GPe's activity is 0 at rest.
        "source target receptor operating_point_nats transfer",
        ("STN", "GPe", "D2",    from_stn,            "s_minus_log_s"),
        ("GPe", "STN", "D2",    0.0,                 "linear"),
    ))
    # fmt: on
    return Circuit(
        name=name,
        populations=populations,
        projections=projections,
        channels=channels,
        reference_nats=top,
        readout_tau_ms=30,
        centred=False,
        # The GPe cells that inhibit cortex can remove a tone of at most 3 nats.
        range_nats=(top - tone, inf),
        # Losing channels are silent once they are top nats behind.
        readable_nats=(log1p((channels - 1) * exp(-top)), log_n),
        max_lead_nats=MOST_LEAD_NATS.get(channels, inf),
        most_channels=12,
        default_gain=0.55 if channels == 2 else 0.5 if channels < 8 else 0.4,
        about="basal ganglia of a macaque that decide by raw evidence as the MSPRT does",
    )
