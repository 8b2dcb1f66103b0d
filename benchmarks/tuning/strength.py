"""Largest usable strength of evidence: where decisions of the macaque's tables stop speeding up.

``python -m benchmarks.tuning.strength [--circuit macaque] [--trials 200]`` prints three tables: the
stability of the loop of STN and GPe against its activity, decision times against d' with one part
of the circuit changed at a time, and the share of late decisions by number of alternatives, from
which ``MOST_LEAD_NATS`` of ``macaque`` and ``macaque_small`` is taken.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np

from bgmodel import stream
from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import load_circuit
from circuits.circuit import Circuit
from circuits.dynamics.fixed_point import solve, wired
from circuits.laws.stability import ringing

SEED = 1004
LATE_MS = 400.0
READINGS = 40
STRENGTHS = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
LEADS = (0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5)
ALTERNATIVES = (2, 3, 4, 5, 6, 7, 8, 10, 12)


def variants(table: Circuit) -> dict[str, Circuit]:
    """Return the table, and variants that change one possible cause at a time."""
    loop = ("set STN->GPe.delay_ms 1", "set GPe->STN.delay_ms 1")
    short = (*loop, "set STN->GPe.tau_ms 1", "set GPe->STN.tau_ms 1")
    return {
        "unedited": table,
        "GPe->STN with a delay of 3 ms": table.set("GPe->STN.delay_ms", 3),
        "STN-GPe loop with times of 1 ms": table.edited(*short),
        "no ceiling of cortex": table.set("ctx.transfer", "rectified"),
        "both": table.edited(*short, "set ctx.transfer rectified"),
        "GPe_ctx 10 times faster": table.set("GPe_ctx.tau_ms", 500),
        "cortical inhibition held": table.clamp("ctx_inh"),
    }


def loop_alone(table: Circuit) -> Circuit:
    """Return the circuit with all but the loop of STN and GPe held at rest."""
    held = table.clamp("GPe_ctx").clamp("ctx_inh")
    return held.set("ctx.transfer", "rectified")


def stability(table: Circuit, rises_nats: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Return the rise of S above rest, Sigma, the amplification by the loop and its frequency."""
    rows: list[tuple[float, ...]] = []
    alone = loop_alone(table)
    wiring = wired(alone)
    stn, hz = wiring.blocks_of("STN"), table.population("STN").gain_hz_per_nat
    for rise in rises_nats:
        drive = np.full(table.channels, rise)
        sigma = float(wiring.rates(solve(wiring, drive[None]))[0, stn].sum()) / hz
        rows.append((rise, sigma, *ringing(alone, drive)))
    return rows


def decided(
    table: Circuit, engine: str, evidence: Evidence, gain: float, posterior: float
) -> Decision:
    """Return the decisions at a posterior, whatever lead the table states."""
    level = -np.log(posterior)
    model = BasalGanglia(table, engine, gain, SEED).until(level)
    parts = [first_crossing(trace, level) for _, _, trace in model._parts(evidence, 0)]
    return parts[0]


def late(decision: Decision, exact: Decision) -> float:
    """Return the share of decisions well after that of the fixed point."""
    return float(((decision.time_ms > exact.time_ms + LATE_MS) & ~exact.forced).mean())


def drawn(d_prime: float, channels: int, trials: int, readings: int = READINGS) -> Evidence:
    """Return Gaussian evidence, a reading every 50 ms."""
    settings = {"t_max": readings, "seed": stream(SEED, "strength")}
    return gaussian_evidence(trials, d_prime=d_prime, channels=channels, **settings)


def main() -> None:
    """Print the three tables."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--circuit", default="macaque")
    asked.add_argument("--trials", type=int, default=200)
    chosen = asked.parse_args()
    name_of_table, trials = chosen.circuit, chosen.trials
    warnings.simplefilter("ignore")
    table = load_circuit(name_of_table, 2)
    print("S above rest, Sigma, amplification (inf: unstable), Hz: the loop of STN and GPe alone")
    for row in stability(table, (0.0, 0.5, 1.0, 1.5, 1.6, 2.0, 2.5, 3.0)):
        print("  " + " ".join(f"{value:8.2f}" for value in row))
    print(f"mean time in ms (late share) at d' = {STRENGTHS}; 2 alternatives, posterior 0.82")
    for name, one in {**variants(table), "spikes": table}.items():
        engine = "spikes" if name == "spikes" else "population"
        cells = []
        for d_prime in STRENGTHS:
            evidence = drawn(d_prime, 2, min(trials, 250))
            exact = decided(table, "algebra", evidence, gain_of(table), 0.82)
            try:
                decision = decided(one, engine, evidence, gain_of(table), 0.82)
            except ValueError as error:
                cells.append(str(error).partition(",")[0][-8:])
                continue
            cells.append(f"{decision.time_ms.mean():.0f} ({late(decision, exact):.2f})")
        print(f"  {name:32s}" + " ".join(f"{cell:>12s}" for cell in cells), flush=True)
    print("late share at posterior 0.9 by alternatives and lead per 100 ms")
    for channels in ALTERNATIVES:
        table, cells = load_circuit(name_of_table, channels), []
        gain = gain_of(table)
        for d_prime in LEADS:
            evidence = drawn(d_prime, channels, min(trials, 250), 60)
            exact = decided(table, "algebra", evidence, gain, 0.9)
            decision = decided(table, "population", evidence, gain, 0.9)
            cells.append(f"{gain * d_prime**2:.2f}: {late(decision, exact):.3f}")
        print(f"  {channels:2d} " + "  ".join(cells), flush=True)


if __name__ == "__main__":
    main()
