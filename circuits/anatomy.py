"""THE TABLES: every nucleus, every pathway, every number with its source.

Weights are in nats: what a nat of the source's activity adds to the target's input. Rates follow
from each row's baseline and gain. Where a source is "assumed" or "tuned", that is what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from circuits.cells import Lif, Phase, Rate
from circuits.checks import is_whole
from circuits.spec import GABA, Circuit, Population, Projection

BG2007 = "Bogacz & Gurney 2007"
APPENDIX_B = "Bogacz & Gurney 2007, appendix B"
HUMPHRIES = "Humphries, Stewart & Gurney 2006"
STUDY = "tuned"


def bogacz_gurney(channels: int = 2) -> Circuit:
    """Return the exact circuit: OUT = -ln P (Bogacz & Gurney 2007, sections 3 and 4)."""
    return appendix_b(channels, w_gpe_stn=1.0, w_d2_gpe=0.0)


def appendix_b(
    channels: int = 2,
    *,
    w_gpe_stn: float = 0.7,
    w_gpe_snr: float | None = None,
    w_d2_gpe: float = 0.5,
    w_d1_snr: float | None = None,
) -> Circuit:
    """Return a member of the exact family with all pathways (Bogacz & Gurney 2007, appendix B).

    Parameters
    ----------
    channels : int
        Alternatives.
    w_gpe_stn, w_gpe_snr : float
        Magnitudes of GPe's weights, 0..1; they add to 1.
    w_d2_gpe, w_d1_snr : float
        Magnitudes of the striatal weights; ``w_d1_snr = 1 + w_d2_gpe``.

    Raises
    ------
    ValueError
        If the weights break either constraint.
    """
    _check_channels(channels)
    w_gpe_snr = 1 - w_gpe_stn if w_gpe_snr is None else w_gpe_snr
    w_d1_snr = 1 + w_d2_gpe if w_d1_snr is None else w_d1_snr
    if min(w_gpe_stn, w_gpe_snr, w_d2_gpe) < 0 or not math.isclose(w_gpe_stn + w_gpe_snr, 1.0):
        raise ValueError(
            "w_gpe_stn + w_gpe_snr must be 1 with no weight negative, got "
            f"{w_gpe_stn} + {w_gpe_snr}, w_d2_gpe {w_d2_gpe}"
        )
    if not math.isclose(w_d1_snr, 1 + w_d2_gpe):
        raise ValueError(f"w_d1_snr must be 1 + w_d2_gpe = {1 + w_d2_gpe}, got {w_d1_snr}")
    simple = w_gpe_snr == 0 and w_d2_gpe == 0
    cite = BG2007 if simple else APPENDIX_B
    signed, unit = Rate(signed=True), Rate()
    # The source is algebraic: what only dynamics and Hz need is ours.
    weight, cite = cite + "; delay assumed", cite + "; tau and gain in Hz assumed"
    nuclei = [
        Population("ctx", signed, 0, 10, cite="y = g* Y, " + BG2007 + "; gain in Hz assumed"),
        # The direct leg lasts as long as the one through STN: only so OUT has no dip in passing.
        Population("D1", signed, 0, 10, GABA, tau_ms=5, receptor="D1", cite=cite),
        Population("D2", signed, 0, 10, GABA, tau_ms=10, receptor="D2", cite=cite),
        Population("STN", unit, 0, 8, transfer="exp", tau_ms=5, cite=cite),
        Population("GPe", signed, 0, 15, GABA, pooled=simple, tau_ms=10, cite=cite),
        Population("SNr", unit, 0, 30, GABA, tau_ms=5, cite=cite),
    ]
    paths = [
        Projection("ctx", "D1", 1, delay_ms=3, cite=weight),
        Projection("ctx", "D2", 1, delay_ms=5, cite=weight),
        Projection("ctx", "STN", 1, delay_ms=3, cite=weight),
        Projection("D1", "SNr", -w_d1_snr, delay_ms=2, cite=weight),
        Projection("D2", "GPe", -w_d2_gpe, delay_ms=4, cite=weight),
        Projection("STN", "GPe", 1, "diffuse", 2, transfer="s_minus_log_s", cite=weight),
        Projection("STN", "SNr", 1, "diffuse", 2, cite=weight),
        Projection("GPe", "STN", -w_gpe_stn, delay_ms=2, cite=weight),
        Projection("GPe", "SNr", -w_gpe_snr, delay_ms=2, cite=weight),
    ]
    if simple:
        nuclei = [row for row in nuclei if row.name != "D2"]
        paths = [p for p in paths if "D2" not in p.name and p.name != "GPe->SNr"]
    return Circuit(
        name="bogacz_gurney" if simple else "appendix_b",
        populations=tuple(nuclei),
        projections=tuple(paths),
        channels=channels,
        drive_gain=1 / (1 + w_gpe_stn * w_d2_gpe),
        exact=True,
        range_nats=(0.0, 5.0),
        about=f"OUT = -ln P exactly; {BG2007 if simple else APPENDIX_B}",
    )


def linear_gpe(channels: int = 2, *, slope: float = 1.0) -> Circuit:
    """Return the circuit whose GPe is linear, ``GPe = slope * Sigma``; Bogacz & Gurney 2007.

    Their figure's best is slope .84 with the evidence scaled by .4.
    """
    if not slope > 0:
        raise ValueError(f"slope must be > 0, got {slope}")
    exact = bogacz_gurney(channels)
    linear = exact.changed("STN->GPe", transfer="linear", weight=slope, cite=BG2007)
    # Up to a loop gain slope * Sigma of 4, as the exact circuit: it oscillates from 4.5.
    high = 4 + math.log(4 / slope)
    return _renamed(linear, "linear_gpe", "GPe linear in its input; Bogacz & Gurney 2007", high)


def spiking_msprt(channels: int = 2) -> Circuit:
    """Return the circuit of spiking cells that computes the MSPRT.

    The drive is held where STN's sum Sigma is near ``s0``: there a channel's y is ``top`` less its
    OUT. Without evidence that is ``rest`` for any number of channels, so that all have the same
    room below it: a loser that falls silent no longer tells STN how far behind it is. STN and GPe
    follow ``Sigma = S`` about that point, GPe by a linear ``S - ln S``; a slow, bounded common mode
    takes from every cortical channel what lifts Sigma above ``s0``, which leaves OUT as it is. D1
    speaks above ``d1_from`` only, so that MSN are quiet at rest: OUT up to ``top - d1_from`` is
    read. ``share`` of the evidence reaches STN through D2 and GPe, the rest directly: the exponent
    still sums to y. Tuned by ``benchmarks/tuning.py`` on its own seeds.
    """
    _check_channels(channels)
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
    fitted = f"{STUDY}; currents by fit_current"
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
            cite="CV assumed; " + STUDY,
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
        Projection("STN", "SNr", 1, "diffuse", delay_ms=2, tau_ms=34, cite=STUDY + "; kernel"),
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


CIRCUITS: dict[str, Callable[..., Circuit]] = {
    "bogacz_gurney": bogacz_gurney,
    "appendix_b": appendix_b,
    "linear_gpe": linear_gpe,
    "spiking_msprt": spiking_msprt,
}
"""All tables by name; each takes the number of channels."""


def circuit(name: str, channels: int = 2) -> Circuit:
    """Return a circuit by name; raises ValueError with the names that there are."""
    if name not in CIRCUITS:
        raise ValueError(f"circuit must be one of {', '.join(CIRCUITS)}, got {name!r}")
    return CIRCUITS[name](channels)


def _check_channels(channels: int) -> None:
    """Raise ValueError, before anything is computed from it, for what is no number of channels."""
    if not is_whole(channels) or channels < 2:
        raise ValueError(f"channels must be a whole number >= 2, got {channels!r}")


def _renamed(row: Circuit, name: str, about: str, high: float) -> Circuit:
    return replace(row, name=name, about=about, range_nats=(0.0, high), exact=False)
