"""Tuning of the cortical code of spiking_msprt: its distance from silence and its Hz per nat.

``python -m benchmarks.tuning.cortex [--channels 2] [--d-prime 1] [--trials 1000]`` prints, on
tuning seeds, r of decision times against the MSPRT at the circuit's gain, mean over the accuracies
of ``benchmarks.tuning.filters``, over the lowest four and the highest three of them: with six times
the cells of one population, which shows whose noise matters, and with other cortical codes. A code
with a lower resting rate is less noisy at the same Hz per nat, because the variance is proportional
to the rate, but losing channels fall silent sooner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.tuning.filters import ACCURACIES
from benchmarks.tuning.neighbours import TUNING_SEEDS, against_msprt, options, tuning_evidence
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.anatomy import load_circuit
from circuits.circuit import Circuit
from circuits.engines import Ensemble

TIMES = 6
CODES = ((1.6, 27), (1.9, 27), (2.2, 20), (2.2, 30), (2.5, 25))
"""Nats at rest and Hz a nat."""
BEFORE = (3.5, 20)
"""A code whose winner, not its rest, was the same for any number of channels: nats, Hz a nat."""


def coded(table: Circuit, top_nats: float, hz_per_nat: float) -> Circuit:
    """Return the circuit with another cortical code; at the fixed point it does the same.

    Parameters
    ----------
    table : Circuit
        A ``spiking_msprt``.
    top_nats : float
        Activity of a channel whose OUT is 0; without evidence that of all is less by ln N.
    hz_per_nat : float
        Cortex's gain.
    """
    by = table.reference_nats - top_nats
    table = table.with_population("ctx", gain_hz_per_nat=hz_per_nat)
    for name in ("D1", "D2"):
        row = table.population(name)
        moved = {
            "bias_nats": row.bias_nats + by,
            "operating_point_nats": row.operating_point_nats - by,
        }
        table = table.with_population(name, **moved)
    # D2 brings its share of the exponent, already moved.
    own = table.projection("ctx", "STN").weight
    bias = table.population("STN").bias_nats + own * by
    return replace(table.with_population("STN", bias_nats=bias), reference_nats=top_nats)


def tried(table: Circuit) -> Iterator[tuple[str, Circuit]]:
    """Yield the table and its variants, with a name each."""
    yield "unedited", table
    for row in table.populations:
        if row.spiking and row.name != "D2":
            more = table.with_population(row.name, neurons=TIMES * row.neurons)
            yield f"{TIMES} times the cells of {row.name}", more
    floor = table.population("ctx").baseline_hz
    tops = [(rest + float(np.log(table.channels)), hz) for rest, hz in CODES]
    for top, hz in (*tops, BEFORE):
        rest_hz, most_hz = floor + hz * (top - np.log(table.channels)), floor + hz * top
        name = f"{hz} Hz a nat, {rest_hz:.0f} Hz at rest, {most_hz:.0f} Hz at most"
        yield name, coded(table, top, hz)


def scored(table: Circuit, evidence: Evidence, gain: float, seed: int) -> tuple[np.ndarray, float]:
    """Return r at each of the accuracies, and the offset in ms."""
    model = BasalGanglia(table, Ensemble(workers=2), gain, seed)
    values = against_msprt(model, evidence, ACCURACIES)
    return values["pearson_r"].to_numpy(), float(values["offset_ms"])


def main() -> None:
    """Print r for everything tried."""
    given = options(__doc__, channels=2, d_prime=1.0, trials=1000).parse_args()
    table = load_circuit("spiking_msprt", given.channels)
    gain = gain_of(table)
    drawn = [
        (seed, tuning_evidence(given.trials, given.channels, given.d_prime, seed))
        for seed in TUNING_SEEDS
    ]
    print(
        f"N = {given.channels}, d' {given.d_prime:g}, gain {gain:g}, {given.trials} trials a seed"
    )
    for name, edited in tried(table):
        found = [scored(edited, evidence, gain, seed) for seed, evidence in drawn]
        r = np.mean([every for every, _ in found], axis=0)
        offset = np.mean([offset for _, offset in found])
        print(
            f"{name}: r {r.mean():.3f}, {r[:4].mean():.3f}, {r[-3:].mean():.3f}; "
            f"offset {offset:.0f} ms",
            flush=True,
        )


if __name__ == "__main__":
    main()
