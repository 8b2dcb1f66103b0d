"""What keeps the circuit's decision times from the MSPRT's, on the scoring seed: make score.

The circuit as it is, beside itself with six times the cells in cortex, with six times the cells
everywhere else, and without noise (the rate engine), each that spikes with a decoder of its own
cortical spikes. More cells tell which noise it is, no noise what its dynamics alone take away.
Nothing is chosen by these numbers.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import pandas as pd

from benchmarks import OUT
from benchmarks.scores.agreement import SCORING_SEED, conditions
from bgmodel.comparison.circuits import MSPRT_AT_GAIN, compare_with_msprt
from bgmodel.comparison.page import page
from bgmodel.files import read_table, write_table
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from circuits.engines import NOISY
from circuits.spec import Circuit

TIMES = 6
"""So many times the cells."""


def cases(table: Circuit) -> Iterator[tuple[str, str, Circuit]]:
    """Yield name, engine and circuit of each case."""
    spiking = [row.name for row in table.populations if row.spiking]
    others = [name for name in spiking if name != table.input]
    yield "as it is", "ensemble", table
    yield f"{TIMES} times the cells outside {table.input}", "ensemble", with_cells(table, others)
    yield f"{TIMES} times the cells of {table.input}", "ensemble", with_cells(table, [table.input])
    yield "no noise", "rate", table


def with_cells(table: Circuit, names: list[str]) -> Circuit:
    """Return the circuit with ``TIMES`` the cells in some populations."""
    for name in names:
        table = table.with_population(name, neurons=TIMES * table.population(name).neurons)
    return table


def main() -> None:
    """Score the cases on all evidence of up to four alternatives, readings every 50 ms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--only", default="", help="conditions whose name contains this")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    for name, table, evidence in conditions(given.trials):
        fast = name.endswith("every 50 ms") and table.channels <= 4
        if not fast or given.only not in name:
            continue
        gain, parts = gain_of(table), []
        for case, engine, edited in cases(table):
            noisy = engine in NOISY
            options = {"workers": given.workers} if noisy else {}
            model = BasalGanglia(edited, engine, gain, SCORING_SEED if noisy else None, options)
            found = compare_with_msprt(model, evidence, seed=SCORING_SEED, rivals=())
            parts.append(found[found["reference"] == MSPRT_AT_GAIN].assign(variant=case))
        path = OUT / f"limits {name.replace('/', ' ')}.csv"
        behind = {"trials": evidence.trials, "gain": gain, "circuit": str(table)}
        write_table(pd.concat(parts, ignore_index=True), path, seed=SCORING_SEED, **behind)
        print(f"\n=== {name}, {evidence.trials} trials")
        print(page(read_table(path).drop(columns="reference")), flush=True)


if __name__ == "__main__":
    main()
