"""A smaller macaque: the same computation in an eighth of the cells."""

from __future__ import annotations

from dataclasses import replace
from math import log

from circuits.anatomy.macaque import SHARED, SHEN, macaque
from circuits.circuit import Circuit

MOST_LEAD_NATS = {
    2: 1.2, 3: 2.4, 4: 2.4, 5: 1.5, 6: 1.1, 7: 0.65, 8: 0.6, 9: 0.5, 10: 0.4, 11: 0.33, 12: 0.28,
}  # fmt: skip
"""As in ``macaque``; with few alternatives the delays of the STN-GPe loop set the limit, which
oscillates above Sigma = 5.1."""


def macaque_small(channels: int = 2) -> Circuit:
    """Return a circuit that computes OUT as ``macaque`` does, with cells of larger gain.

    With a gain of more Hz per nat an eighth of the cells have 1.3 times the noise (it goes as
    ``rate / (cells gain^2)``), and a run in spikes costs a third. The price: no FSI, a weaker and
    faster loop of STN and GPe without a beta rhythm of 8 to 15 Hz, and resting rates outside the
    macaque's: MSN at 3 and 5 Hz, STN at 44 / N and SNr at 20 + 36 ln N Hz. With two alternatives
    the largest lead of evidence that it tracks is about a third of that of ``macaque``.
    """
    circuit = macaque(channels, name="macaque_small")
    log_n, rest = log(channels), 2.2
    above_floor, sigma, share, indirect = 0.4, 2.2, 0.35, 0.1
    # As in ``macaque``: what follows from OUT = -ln P.
    direct, to_d1 = 1 - indirect * share, (1 + indirect * (1 - share)) * rest
    from_stn = sigma - log(sigma)
    loop = {"weight": -share, "tau_ms": 4, "cite": f"{SHARED}; D2 {SHEN}"}
    # fmt: off
    changes: dict[str, dict[str, object]] = {
        "ctx": {"neurons": 600, "gain_hz_per_nat": 11},
        "D1": {"neurons": 5000, "gain_hz_per_nat": 12, "bias_nats": above_floor - to_d1},
        "D2": {"neurons": 600, "gain_hz_per_nat": 2, "baseline_hz": 3},
        "STN": {"neurons": 300, "gain_hz_per_nat": 20, "tau_ms": 5,
                "bias_nats": log(sigma) - rest * direct - log_n},
        "GPe": {"neurons": 300, "gain_hz_per_nat": 50, "bias_nats": -from_stn},
        "GPe_ctx": {"bias_nats": 3.0 - 10 * sigma},
        "SNr": {"neurons": 600, "gain_hz_per_nat": 36, "baseline_hz": 20,
                "bias_nats": log_n + above_floor - sigma},
        "ctx->D1": {"weight": to_d1 / rest, "tau_ms": 4},
        "ctx->D2": {"tau_ms": 4},
        "ctx->STN": {"weight": direct, "tau_ms": 4},
        "D1->SNr": {"tau_ms": 6},
        "STN->GPe": {"operating_point_nats": from_stn},
        "STN->SNr": {"tau_ms": 19},
        "GPe->STN": loop,
        "GPe->SNr": {"weight": share - 1},
    }
    # fmt: on
    return replace(
        circuit,
        populations=tuple(
            replace(row, **changes.get(row.name, {}))  # type: ignore[arg-type]
            for row in circuit.populations
            if row.name != "FSI"
        ),
        projections=tuple(
            replace(row, **changes.get(row.name, {}))  # type: ignore[arg-type]
            for row in circuit.projections
            if "FSI" not in (row.source, row.target)
        ),
        max_lead_nats=MOST_LEAD_NATS[channels],
        about="the computation of macaque in an eighth of the cells, without its rates at rest",
    )
