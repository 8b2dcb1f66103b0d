"""THE TABLE of a macaque's basal ganglia: raw evidence in, spikes, every number with its source."""

from __future__ import annotations

from math import exp, inf, log, log1p

from circuits.anatomy.columns import rows
from circuits.cells import Phase, Rate
from circuits.checks import check_channels
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, GLUTAMATE, Population, Projection

LIENARD = "Lienard & Girard 2014"
HUMPHRIES = "Humphries et al. 2006"
HERNANDEZ = "Hernandez et al. 2006, rat"
SHEN = "Shen & Johnson 2000, rat"
ASSUMED = "assumed"
AMPA = f"delay {LIENARD}; tau assumed, near AMPA's 2 ms, {HUMPHRIES}"
GABA_A = f"delay {LIENARD}; tau assumed, near GABA's 3 ms, {HUMPHRIES}"
KERNEL = f"delay {LIENARD}; time constant tuned"
SHARED = f"delay {LIENARD}; tau assumed, share tuned"
CORTEX = "CV assumed; range of rates tuned"
FAST = "cortical interneurons, driven by all cortex; rate, gain assumed"
MSN = "CV assumed; cells and rate tuned"
PACEMAKER = f"pacemaker, CV assumed; rate {LIENARD}"
OF_TWO = f"pacemaker, CV assumed; rate of 2 channels {LIENARD}"
OUTPUT = "pacemaker, CV assumed; rate tuned"
D2_BENT = f"{KERNEL}; D2 {HERNANDEZ}"
D2_GABA = f"{SHARED}; D2 {SHEN}"
MOST_LEAD_NATS = {
    2: 1.2, 3: 2.4, 4: 2.4, 5: 1.5, 6: 1.1, 7: 0.65, 8: 0.6, 9: 0.5, 10: 0.4, 11: 0.33, 12: 0.28,
}  # fmt: skip
"""Largest lead per 100 ms by number of alternatives, measured (benchmarks/tuning/strength.py).

Up to it at most 2.5 % of decisions come 400 ms or more after those of the fixed point, at a
posterior of 0.9. With few alternatives the delays of the loop of STN and GPe limit it, which
oscillates above Sigma = 5.1; with many, the highest rate of cortex does.
"""
SLOW = "GPe to frontal cortex, Saunders et al. 2015, mouse; rest assumed"
TO_SLOW = "input from STN, gain, time assumed"
TO_CTX = "GPe to frontal cortex, Saunders et al. 2015, mouse; delay assumed"


def macaque(channels: int = 2) -> Circuit:
    """Return the circuit that gets raw evidence and cancels inside what its channels share.

    Each channel's cortex gets its own evidence. What is common to all channels moves STN's sum
    Sigma, and three parts of the circuit keep it out of OUT. (1) With ``G = Sigma - ln Sigma`` in
    GPe, of which STN gets the share w and SNr the rest, ``ln Sigma = S - w G`` and SNr hears
    ``Sigma - (1 - w) G = S``, at every S (Bogacz & Gurney 2007, appendix B). The loop's gain is
    ``w (Sigma - 1)``: the smaller w, the wider the range of S in which it is stable. (2)
    Interneurons of cortex take at once from what is common all but ``1 / (1 + 1.25)``. (3) Cells of
    GPe that project to cortex bring Sigma back to its rest, with a gain of 10 in 500 ms.

    D1 fires .4 nats above its silence at rest, for any number of channels, so that it can follow
    when all channels fall together. STN->SNr is slow, so that a step of all channels reaches SNr
    through STN about when it does through D1. All cells are renewal processes whose rate follows
    its line: at the fixed point OUT is -ln P wherever no cortical channel is silent. Rivals that
    are silent count as if they stood at 0, and OUT lies too high by about ``(N - 2) / N exp(-2.2)``
    nats, .055 for N = 4: only more spikes of cortex at rest would mend it.

    Dopamine steepens D1's and flattens D2's line about rest, and at terminals weakens the loop of
    STN and GPe: the less of it, the nearer the loop comes to oscillation (Lindahl & Hellgren
    Kotaleski 2016).

    Rates at rest that lie outside those published for the macaque (Lienard & Girard 2014: MSN 0-1,
    STN 15-23, GPe 56-75, GPi and SNr 59-80 Hz): MSN 3 and 5 Hz, for silent ones cannot follow a
    fall; STN 44 / N and SNr 20 + 36 ln N Hz, which depend on the number of alternatives as -ln P
    does. Tuned with ``benchmarks/tuning/macaque.py`` on seeds of its own.
    """
    check_channels(channels)
    log_n = log(channels)
    rest, tone, above_floor = 2.2, 3.0, 0.4
    sigma, share, indirect, fast = 2.2, 0.35, 0.1, 1.25
    # The exponent of STN still sums to y: the rest of it comes through D2 and GPe. What D2 adds to
    # OUT through GPe's way to SNr, D1 takes away again.
    direct = 1 - indirect * share
    to_d1 = (1 + indirect * (1 - share)) * rest
    top = rest + log_n
    from_stn = sigma - log(sigma)  # what GPe hears at rest, and dopamine leaves as it is
    # fmt: off
    populations = rows(Population, (
        "name       cell        neurons pooled baseline_hz gain_hz_per_nat transmitter cite",
        ("ctx",     Phase(0.5), 600,    False, 0.8,        11,             GLUTAMATE,  CORTEX),
        ("ctx_inh", Rate(),     1,      True,  0,          5,              GABA,       FAST),
        ("D1",      Phase(0.5), 5000,   False, 0,          12,             GABA,       MSN),
        ("D2",      Phase(0.5), 600,    False, 3,          2,              GABA,       MSN),
        ("STN",     Phase(0.3), 300,    False, 0,          20,             GLUTAMATE,  OF_TWO),
        ("GPe",     Phase(0.3), 300,    False, 58,         50,             GABA,       PACEMAKER),
        ("GPe_ctx", Rate(),     1,      True,  0,          20,             GABA,       SLOW),
        ("SNr",     Phase(0.3), 600,    False, 20,         36,             GABA,       OUTPUT),
    ), (
        "name       transfer      tau_ms  receptor  operating_point_nats  bias_nats",
        ("ctx",     "saturating", 2,     "",       0.0,        tone + fast * rest),
        ("ctx_inh", "linear",     5,      "",       0.0,        0.0),
        # Dopamine turns about the input at rest: rates at rest stay what they are.
        ("D1",      "linear",     0.0,    "D1",     rest,       above_floor - to_d1),
        ("D2",      "linear",     0.0,    "D2",     rest,       -rest),
        ("STN",     "exp",        5,      "",       0.0,        log(sigma) - rest * direct - log_n),
        ("GPe",     "linear",     0.0,    "",       0.0,        -from_stn),
        ("GPe_ctx", "linear",     5000,   "",       0.0,        tone - 10 * sigma),
        ("SNr",     "linear",     0.0,    "",       0.0,        log_n + above_floor - sigma),
    ), (
        # The spread of the cells' rates is assumed; their mean is that of the line.
        "name       heterogeneity published_hz",
        ("ctx",     0.3,   ()),
        ("D1",      0.3,   (0.0, 1.0)),
        ("D2",      0.3,   (0.0, 1.0)),
        ("STN",     0.3,   (15.2, 22.8)),
        ("GPe",     0.3,   (55.7, 74.5)),
        ("SNr",     0.3,   (59.1, 79.5)),
    ))
    projections = rows(Projection, (
        "source     target     weight        pattern    delay_ms  tau_ms  transfer         cite",
        ("ctx",     "D1",      to_d1 / rest, "channel", 7,        4,      "linear",        AMPA),
        ("ctx",     "D2",      1,            "channel", 7,        4,      "linear",        AMPA),
        ("ctx",     "STN",     direct,       "channel", 3,        4,      "linear",        AMPA),
        ("ctx",     "ctx_inh", 1 / channels, "diffuse", 1,        2,      "linear",        ASSUMED),
        ("ctx_inh", "ctx",     -fast,        "diffuse", 1,        3,      "linear",        ASSUMED),
        ("D1",      "SNr",     -1,           "channel", 11,       6,      "linear",        KERNEL),
        ("D2",      "GPe",     -indirect,    "channel", 7,        4,      "linear",        GABA_A),
        ("STN",     "GPe",     1,            "diffuse", 3,        3,      "s_minus_log_s", D2_BENT),
        ("STN",     "SNr",     1,            "diffuse", 3,        19,     "linear",        KERNEL),
        ("STN",     "GPe_ctx", 10,           "diffuse", 3,        5,      "linear",        TO_SLOW),
        ("GPe",     "STN",     -share,       "channel", 10,       4,      "linear",        D2_GABA),
        ("GPe",     "SNr",     share - 1,    "channel", 3,        4,      "linear",        SHARED),
        ("GPe_ctx", "ctx",     -1,           "diffuse", 2,        0.0,    "linear",        TO_CTX),
    ), (
        # At terminals dopamine weakens the loop; GPe's activity is 0 at rest.
        "source target receptor operating_point_nats",
        ("STN", "GPe", "D2",    from_stn),
        ("GPe", "STN", "D2",    0.0),
    ))
    # fmt: on
    return Circuit(
        name="macaque",
        populations=populations,
        projections=projections,
        channels=channels,
        reference_nats=top,
        readout_tau_ms=30,
        centred=False,
        # GPe's cells that inhibit cortex have a tone of 3 nats to take away.
        range_nats=(top - tone, inf),
        # Losers are silent from top nats behind on.
        readable_nats=(log1p((channels - 1) * exp(-top)), log_n),
        max_lead_nats=MOST_LEAD_NATS.get(channels, inf),
        most_channels=12,
        default_gain=0.55 if channels == 2 else 0.5 if channels < 8 else 0.4,
        about="basal ganglia of a macaque that decide by raw evidence as the MSPRT does",
    )
