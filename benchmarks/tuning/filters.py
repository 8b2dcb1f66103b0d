"""Tuning of spiking_msprt's read-out filters: OUT for many filters from one spiking run.

``python -m benchmarks.tuning.filters [--channels 2] [--d-prime 1] [--gain 0.7]`` runs the table on
tuning seeds, then computes OUT again for other delays and time constants of D1->SNr, STN->SNr and
the read-out. None of these feeds back, so D1's and STN's spikes are those of the run; SNr keeps its
own noise and gets what the new filters change in its input. Printed: r of decision times against
the MSPRT at the circuit's gain, mean over accuracies of 0.885 to 0.975 in steps of 0.01, over the
lowest four, and over the highest three.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.signal import lfilter

from benchmarks.tuning.neighbours import STEP_MS, TUNING_SEEDS, options, tuning_evidence
from bgmodel import stream
from bgmodel.comparison.matched import matched_measures
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import thresholds_about
from circuits.anatomy import load_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.engines import Ensemble

ACCURACIES = tuple(np.arange(0.885, 0.98, 0.01).round(3))


def low_passed(x: Array, tau_ms: float, start: float) -> Array:
    """Return x (trials, ms, channels) behind one pole that was at ``start``."""
    keep = np.exp(-1 / tau_ms)
    before = np.full((len(x), 1, x.shape[2]), keep * start)
    return np.asarray(lfilter([1 - keep], [1, -keep], x, axis=1, zi=before)[0])


class Run:
    """Rates of one run, ms by ms, from which OUT is computed for other filters."""

    def __init__(self, table: Circuit, evidence: Evidence, gain: float, seed: int) -> None:
        self.evidence = evidence
        self.test = msprt_tradeoffs(evidence, gain)[MSPRT_AT_GAIN]
        self.thresholds = thresholds_about(self.test)
        kept: dict[str, list[Array]] = {"D1": [], "STN": [], "SNr": []}
        model = BasalGanglia(table, Ensemble(workers=2), gain, seed)
        for _, activity, _ in model.batches(evidence):
            for name, parts in kept.items():
                parts.append(activity.decoded_nats(name))
        self.nats = {name: np.concatenate(parts) for name, parts in kept.items()}
        # Of the projection that is diffuse only the sum counts; STN's baseline is 0.
        self.nats["STN"] = self.nats["STN"].sum(axis=2, keepdims=True)
        self.rest = {name: float(nats[:, :3].mean()) for name, nats in self.nats.items()}
        self.as_run = self._input(table)

    def _input(self, table: Circuit) -> Array:
        parts = {}
        for name in ("STN", "D1"):
            row, x = table.projection(name, "SNr"), self.nats[name]
            late = round(row.delay_ms)
            x = np.concatenate([np.full_like(x[:, :late], self.rest[name]), x], axis=1)
            parts[name] = low_passed(x[:, : x.shape[1] - late], row.tau_ms, self.rest[name])
        return parts["STN"] - parts["D1"]

    def out(self, table: Circuit) -> Trace:
        """Return OUT with the filters of another table."""
        nats = self.nats["SNr"] + self._input(table) - self.as_run
        out = low_passed(nats, table.readout_tau_ms, self.rest["SNr"])
        return Trace(out, np.arange(1.0, out.shape[1] + 1), 0.0, STEP_MS)

    def scored(self, table: Circuit) -> tuple[Array, float, float]:
        """Return r at each accuracy, the offset in ms, and the slope."""
        found = matched_measures(
            self.test,
            tradeoff(self.out(table), self.evidence, self.thresholds),
            rng=stream(0, "unused"),
            accuracies=ACCURACIES,
            resamples=2,
        ).set_index("measure")["value"]
        return found["pearson_r"].to_numpy(), found["offset_ms"], found["slope"]


def tried(table: Circuit) -> Iterator[tuple[str, Circuit]]:
    """Yield the table, and others with their filters in words."""
    yield "unedited", table
    direct = ((4, 5), (6, 4), (8, 4), (12, 4))
    for read_out, kernel, (tau, delay) in product((36, 28, 24), (24, 30, 34, 40), direct):
        edited = table.with_projection("D1", "SNr", tau_ms=tau, delay_ms=delay)
        edited = edited.with_projection("STN", "SNr", tau_ms=kernel)
        name = f"read-out {read_out}, STN->SNr {kernel}, D1->SNr {tau} after {delay} ms"
        yield name, replace(edited, readout_tau_ms=read_out)


def main() -> None:
    """Print r for every filter tried."""
    parser = options(__doc__, channels=2, d_prime=1.0, trials=2000)
    parser.add_argument("--gain", type=float)
    given = parser.parse_args()
    table = load_circuit("spiking_msprt", given.channels)
    gain = gain_of(table, given.gain)
    runs = []
    for seed in TUNING_SEEDS:
        evidence = tuning_evidence(given.trials, given.channels, given.d_prime, seed)
        runs.append(Run(table, evidence, gain, seed))
    print(
        f"N = {given.channels}, d' {given.d_prime:g}, gain {gain:g}, {given.trials} trials a seed"
    )
    for name, edited in tried(table):
        every, offsets, slopes = zip(*(run.scored(edited) for run in runs), strict=True)
        r = np.mean(every, axis=0)
        print(
            f"{name}: r {r.mean():.3f}, {r[:4].mean():.3f}, {r[-3:].mean():.3f}; offset "
            f"{np.mean(offsets):.0f} ms, slope {np.mean(slopes):.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
