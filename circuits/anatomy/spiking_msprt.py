"""THE TABLE of spiking cells that computes the MSPRT: every number with its source."""

from __future__ import annotations

import math

from circuits.cells import Lif, Phase, Rate
from circuits.checks import check_channels
from circuits.spec import GABA, Circuit, Population, Projection

HUMPHRIES = "Humphries, Stewart & Gurney 2006"
TUNED = "tuned"


def spiking_msprt(channels: int = 2) -> Circuit:
    """Return the circuit of spiking cells that computes the MSPRT.

    The drive is held where STN's sum Sigma is near ``s0``: there a channel's y is ``top`` less its
    OUT. Without evidence that is ``rest`` for any number of channels, so that all have the same
    room below it: a loser that falls silent no longer tells STN how far behind it is. STN and GPe
    follow ``Sigma = S`` about that point, GPe by a linear ``S - ln S``; a slow, bounded common mode
    takes from every cortical channel what lifts Sigma above ``s0``, which leaves OUT as it is. D1
    speaks above ``d1_from`` only, so that MSN are quiet at rest: OUT up to ``top - d1_from`` is
    read. ``share`` of the evidence reaches STN through D2 and GPe, the rest directly: the exponent
    still sums to y. Tuned by ``benchmarks/tuning/neighbours.py`` on its own seeds.
    """
    check_channels(channels)
    rest, s0 = 2.2, 2.2
    top = rest + math.log(channels)
    d1_from, d2_mid, share = top - 0.65, top - 0.3, 0.1
    slope = 1 - 1 / s0
    # A nat of gain about 0 would move OUT by all of y, about a pivot by what is above it.
    d1_pivot = top - 1.3
    # The common mode: its gain, the time in which it acts, and its tone.
    gain, acts_ms, tone = 10, 200, 0.7
    d1 = Lif(12, 3, 15, 5, 2, rest_mv=8.17, mv_per_nat=13.34)
    d2 = Lif(12, 3, 15, 5, 2, rest_mv=8.30, mv_per_nat=1.256)
    pallidal = Lif(10, 4, 15, 3, 2, rest_mv=14.07, mv_per_nat=13.56)
    nigral = Lif(10, 4, 15, 3, 2, rest_mv=7.68, mv_per_nat=17.01)
    cells = 300
    fitted = f"{TUNED}; currents by fit_current"
    nuclei = (
        Population(
            "ctx",
            Phase(0.5),
            1,
            25,
            transfer="rectified",
            tau_ms=2,
            bias_nats=tone,
            neurons=cells,
            cite="CV assumed; rate range tuned",
        ),
        Population(
            "common",
            Rate(),
            0,
            1,
            GABA,
            pooled=True,
            tau_ms=gain * acts_ms,
            bias_nats=tone - gain * s0,
            cite="assumed: slow thalamic or interneuron feedback; time tuned",
        ),
        Population(
            "D1",
            d1,
            0,
            80,
            GABA,
            bias_nats=-d1_from,
            receptor="D1",
            pivot_nats=d1_pivot,
            neurons=cells,
            cite=fitted + "; pivot assumed",
        ),
        Population(
            "D2",
            d2,
            5,
            3.5,
            GABA,
            bias_nats=-d2_mid,
            receptor="D2",
            pivot_nats=d2_mid,
            neurons=cells,
            cite=fitted + "; pivot assumed",
        ),
        Population(
            "STN",
            Phase(0.3),
            0,
            21.8,
            transfer="exp",
            tau_ms=5,
            neurons=cells,
            bias_nats=math.log(s0) - top + share * d2_mid,
            cite="CV assumed; " + TUNED,
        ),
        Population(
            "GPe", pallidal, 45, 80, GABA, bias_nats=-slope * s0, neurons=cells, cite=fitted
        ),
        Population(
            "SNr", nigral, 10, 95, GABA, bias_nats=top - s0 - d1_from, neurons=cells, cite=fitted
        ),
    )
    fast = HUMPHRIES + ", AMPA 2 and GABA 3 ms; "
    paths = (
        Projection("ctx", "D1", 1, delay_ms=5, tau_ms=4, cite=fast + "delay tuned"),
        Projection("ctx", "D2", 1, delay_ms=5, tau_ms=4, cite=fast + "delay tuned"),
        Projection("ctx", "STN", 1 - share, delay_ms=2.5, tau_ms=4, cite=fast + "its delay"),
        Projection("common", "ctx", -1, "diffuse", delay_ms=2, cite="assumed"),
        Projection("D1", "SNr", -1, delay_ms=4, tau_ms=6, cite=HUMPHRIES + "; kernel tuned"),
        Projection("D2", "GPe", -share, delay_ms=5, tau_ms=4, cite=fast + "its delay"),
        Projection("STN", "common", gain, "diffuse", delay_ms=2, tau_ms=5, cite="assumed"),
        Projection("STN", "GPe", slope, "diffuse", delay_ms=2, tau_ms=3, cite=fast + "its delay"),
        Projection("STN", "SNr", 1, "diffuse", delay_ms=2, tau_ms=34, cite=TUNED + "; kernel"),
        Projection("GPe", "STN", -1, delay_ms=2, tau_ms=4, cite=fast + "delay 4 there"),
    )
    return Circuit(
        name="spiking_msprt",
        populations=nuclei,
        projections=paths,
        channels=channels,
        reference_nats=top,
        readout_tau_ms=28,
        range_nats=(1.0, 12.0),
        # Losers are silent from top nats behind on.
        readable_nats=(math.log1p((channels - 1) * math.exp(-top)), top - d1_from),
        # Odds of e^5 are past every threshold; more would only outrun the slow common mode.
        reach_nats=5.0,
        most_channels=12,
        about="spiking cells that compute the MSPRT; after circuit J of a feasibility study",
    )
