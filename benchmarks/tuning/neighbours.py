"""Tuning of spiking_msprt: comparison of the table with its neighbours, on tuning seeds.

``python -m benchmarks.tuning.neighbours [--channels 4] [--d-prime 0.5] [--trials 500]`` prints, for
every variant, its resting rates and a comparison with the MSPRT at its gain. These seeds are used
only for tuning, those of ``figures.decisions.kinds`` only for scores. Among variants with a
latency of at most 65 ms and the animal's resting rates, the one with the highest correlation of
decision times was kept; many are equally good within the error of 500 trials. The filters before
OUT and the default gain were tuned with ``benchmarks.tuning.filters``, the cortical code with
``benchmarks.tuning.cortex``, which resolve smaller differences.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from bgmodel import stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.comparison.matched import matched_measures
from bgmodel.comparison.page import page
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds, thresholds_about
from bgmodel.integrators.steady import resting_activity
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import load_circuit
from circuits.cells.membrane import fit_current
from circuits.circuit import Circuit
from circuits.engines import Ensemble

TUNING_SEEDS = (1001, 1002, 1003)
ACCURACIES = (0.90, 0.93, 0.95, 0.97)
STEP_MS = 50.0


def tuning_evidence(trials: int, channels: int, d_prime: float, seed: int) -> Evidence:
    """Return Gaussian evidence for tuning, long enough for an accuracy of 0.98."""
    steps, rng = int(60 / d_prime), stream(seed, "tuning", channels)
    return gaussian_evidence(trials, d_prime=d_prime, channels=channels, t_max=steps, seed=rng)


def options(text: str, *, channels: int, d_prime: float, trials: int) -> argparse.ArgumentParser:
    """Return the options of a script that tunes, with its defaults."""
    parser = argparse.ArgumentParser(description=text)
    parser.add_argument("--channels", type=int, default=channels)
    parser.add_argument("--d-prime", type=float, default=d_prime)
    parser.add_argument("--trials", type=int, default=trials)
    return parser


def against_msprt(
    model: BasalGanglia, evidence: Evidence, accuracies: Sequence[float]
) -> pd.Series:
    """Return measures at equal accuracy against the MSPRT at a circuit's gain, by their name."""
    test = msprt_tradeoffs(evidence, model.gain)[MSPRT_AT_GAIN]
    levels = thresholds_about(test)
    own = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    given = {"rng": stream(0, "unused"), "accuracies": accuracies, "resamples": 2}
    return matched_measures(test, own, **given).set_index("measure")["value"]


def synapses(table: Circuit, cortical_ms: float, striatal_ms: float) -> Circuit:
    """Return the circuit with other time constants of the direct pathway's two synapses."""
    table = table.with_projection("D1", "SNr", tau_ms=striatal_ms)
    for target in ("D1", "D2", "STN"):
        table = table.with_projection("ctx", target, tau_ms=cortical_ms)
    return table


def steeper_d1(table: Circuit, gain_hz_per_nat: float) -> Circuit:
    """Return the circuit with another gain of D1, its currents fitted anew."""
    cell: Any = table.population("D1").cell
    rest, slope = fit_current(cell, 0, gain_hz_per_nat, (4, 90))
    cell = replace(cell, rest_mv=rest, mv_per_nat=slope)
    return table.with_population("D1", cell=cell, gain_hz_per_nat=gain_hz_per_nat)


def neighbours(table: Circuit) -> dict[str, Circuit]:
    """Return the variants tried in addition to the table."""

    def common(acts_ms: float) -> Circuit:
        return table.with_population("common", tau_ms=10 * acts_ms)

    def read_out(tau_ms: float, kernel_ms: float) -> Circuit:
        return replace(table.with_projection("STN", "SNr", tau_ms=kernel_ms), readout_tau_ms=tau_ms)

    def direct(tau_ms: float, delay_ms: float) -> Circuit:
        return table.with_projection("D1", "SNr", tau_ms=tau_ms, delay_ms=delay_ms)

    return {
        "common mode 100 ms": common(100),
        "common mode 400 ms": common(400),
        "GPe replaced by its rest": table.clamp("GPe"),
        "synapses of 8 ms, read-out 25": replace(synapses(table, 8, 8), readout_tau_ms=25),
        "STN-GPe loop 5 and 8 ms": table.with_projection("STN", "GPe", tau_ms=5).with_projection(
            "GPe", "STN", tau_ms=8
        ),
        "kernel 24 ms": read_out(28, 24),
        "kernel 40 ms": read_out(28, 40),
        "read-out 36, kernel 26 ms": read_out(36, 26),
        "read-out 36, kernel 34 ms": read_out(36, 34),
        "read-out 20, kernel 34 ms": read_out(20, 34),
        "STN filter 8 ms": table.with_population("STN", tau_ms=8),
        "Poisson cortex": table.with_cell("ctx", cv=1.0),
        "STN of CV 0.6": table.with_cell("STN", cv=0.6),
        "D1->SNr 12 ms": direct(12, 4),
        "D1->SNr 4 ms, delay 2 ms": direct(4, 2),
        "D1 of 120 Hz a nat": steeper_d1(table, 120),
    }


def main() -> None:
    """Print the table of variants."""
    given = options(__doc__, channels=4, d_prime=0.5, trials=500).parse_args()
    table = load_circuit("spiking_msprt", given.channels)
    gain = gain_of(table)
    tried = neighbours(table)
    for name, row in {"unedited": table, **tried}.items():
        at = resting_activity(row, seed=TUNING_SEEDS[0])
        print(f"{name}, at rest:\n{at.to_string(index=False, float_format='{:.2f}'.format)}")
    for seed in TUNING_SEEDS:
        evidence = tuning_evidence(given.trials, given.channels, given.d_prime, seed)
        model = BasalGanglia(table, Ensemble(workers=2), gain, seed)
        found = compare_edits(model, tried, evidence, seed=seed, accuracies=ACCURACIES)
        print(f"\nseed {seed}, N = {given.channels}, d' {given.d_prime:g}, {given.trials} trials")
        print(page(found[found["kind"] == "value"].drop(columns="kind")))


if __name__ == "__main__":
    main()
