"""Tuning of the macaque's table: comparison with its neighbours, on tuning seeds.

``python -m benchmarks.tuning.macaque [--channels 2] [--d-prime 0.5] [--trials 2000]`` prints, for
each variant, by the population engine and on raw evidence: how far OUT moves when all channels
rise or fall by a nat (constant evidence, without noise), how much STN's rate rises with conflict (0
to 0.9, d' = 1, mean of 150-600 ms), r of decision times against the MSPRT at the circuit's gain,
and the extra time. Kept: high r, with the rise of STN and the animal's rates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.tuning.neighbours import (
    ACCURACIES,
    TUNING_SEEDS,
    against_msprt,
    options,
    tuning_evidence,
)
from bgmodel import stream
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import macaque
from circuits.cells import Phase
from circuits.circuit import Circuit
from circuits.engines import Population

KERNELS_MS = (16.0, 20.0, 28.0, 32.0)
READ_OUTS_MS = (20.0, 40.0)
COMMON_MS = (250.0, 1000.0)


def neighbours(table: Circuit) -> dict[str, Circuit]:
    """Return the table and the variants tried."""
    slow = table.population("GPe_ctx").tau_ms
    found = {"unedited": table}
    for tau_ms in KERNELS_MS:
        found[f"STN->SNr {tau_ms:g} ms"] = table.with_projection("STN", "SNr", tau_ms=tau_ms)
    for tau_ms in READ_OUTS_MS:
        found[f"read-out {tau_ms:g} ms"] = replace(table, readout_tau_ms=tau_ms)
    for acts_ms in COMMON_MS:
        longer = table.with_population("GPe_ctx", tau_ms=slow * acts_ms / 500)
        found[f"GPe_ctx in {acts_ms:g} ms"] = longer
    for name in ("ctx", "D1", "STN", "SNr"):
        many = table.with_population(name, neurons=4 * table.population(name).neurons)
        found[f"4 times the cells of {name}"] = many
    found["MSN of CV 1"] = table.with_population("D1", cell=Phase(1.0))
    found["D1 silent at rest"] = table.with_population(
        "D1", bias_nats=table.population("D1").bias_nats - 0.4
    ).with_population("SNr", bias_nats=table.population("SNr").bias_nats - 0.4)
    return found


def step_response(table: Circuit, size: float) -> tuple[float, float]:
    """Return the rise and fall of the leader's OUT after a step of all channels, nats."""
    drive = np.zeros((1, 30, table.channels))
    drive[0, :, 0] = 2.0
    drive[0, 10:] += size
    model = BasalGanglia(table, Population(noise=False), 1.0)
    found = model.run_drive(drive, 50.0)
    out, after = found.output_nats[0, :, 0], found.time_ms >= 500
    moved = out[after] - out[~after][-20:].mean()
    return float(moved.max()), float(moved.min())


def rise_with_conflict(channels: int, edit: Circuit, seed: int) -> float:
    """Return the relative rise of STN's mean rate in 150-600 ms from conflict 0 to 0.9."""
    means = []
    for conflict in (0.0, 0.9):
        rng = stream(seed, "conflict", channels)
        given = {"d_prime": 1.0, "channels": channels, "conflict": conflict}
        evidence = gaussian_evidence(300, t_max=14, seed=rng, **given)
        model = BasalGanglia(edit, Population(noise=False), gain_of(edit), seed)
        found = model.activity(evidence)
        seen = (found.time_ms >= 150) & (found.time_ms <= 600)
        means.append(found.rates_hz["STN"][:, seen].mean())
    return float(means[1] / means[0] - 1)


def scored(table: Circuit, evidence: Evidence, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return r and the extra time in ms at each of the accuracies."""
    model = BasalGanglia(table, Population(sample_ms=2.0), gain_of(table), seed)
    values = against_msprt(model, evidence, ACCURACIES)
    return values["pearson_r"].to_numpy(), values["extra_ms"].to_numpy()


def main() -> None:
    """Print a line for everything tried."""
    given = options(__doc__, channels=2, d_prime=0.5, trials=2000).parse_args()
    drawn = [
        (tuning_evidence(given.trials, given.channels, given.d_prime, seed), seed)
        for seed in TUNING_SEEDS
    ]
    for name, table in neighbours(macaque(given.channels)).items():
        up, down = step_response(table, 1.0)
        low_up, low_down = step_response(table, -1.0)
        rise = rise_with_conflict(given.channels, table, TUNING_SEEDS[0])
        r, extra_ms = np.mean([scored(table, *each) for each in drawn], axis=0)
        print(
            f"{name}: +1 nat {down:+.3f} {up:+.3f}, -1 nat {low_down:+.3f} {low_up:+.3f}; STN "
            f"{rise:+.1%}; r {np.round(r, 3)}, extra {np.round(extra_ms)} ms",
            flush=True,
        )


if __name__ == "__main__":
    main()
