"""The circuit against the MSPRT on scoring seeds: make score.

Evidence of every kind, readings every 50 and every 500 ms, two cortices; beside each a
decoder of the circuit's own cortical spikes. These seeds tuned nothing. Tables go to
``benchmarks/out``; with ``--keep`` a condition that is there already is not computed again.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks import OUT
from bgmodel import stream
from bgmodel.comparison.circuits import (
    MSPRT_AT_GAIN,
    compare_with_msprt,
    sample_ms,
)
from bgmodel.comparison.page import page
from bgmodel.evidence import Evidence, gaussian_evidence
from bgmodel.files import read_table, write_table
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from bgmodel.integrators.rivals import RIVALS, rivals_on
from bgmodel.tactile.task import Orientations, SameDifferent, Source, held_out_taps, source
from circuits.anatomy import circuit
from circuits.spec import Circuit

SCORING_SEED = 40_001
TRIALS = 2000
MORE_TRIALS = {
    "gaussian d' 1, N = 2": 10_000,
    "gaussian d' 0.5, N = 2": 10_000,
    "same/different 2 mm": 10_000,
    "real taps, edge 5 degrees": 10_000,
    "gaussian d' 1, N = 4": 5000,
    "same/different 1.5 mm": 5000,
    "4 orientations 2 mm": 5000,
}
"""Where the correlation of times is near what is asked: 2 000 trials know it to +-.03."""
Draw = Callable[..., Evidence]


def gaussian(hypotheses: int, d_prime: float) -> Draw:
    """Return how to draw Gaussian evidence of a pairwise d' a reading."""
    return partial(gaussian_evidence, separation=d_prime / np.sqrt(2), hypotheses=hypotheses)


def kinds() -> Iterator[tuple[str, int, int, Draw]]:
    """Yield name, alternatives, most readings and the drawing of each kind of evidence."""
    gaussians = ((2, 0.5, 120), (4, 0.5, 120), (2, 1, 40), (4, 1, 40), (8, 0.5, 160))
    for count, d_prime, most in gaussians:
        yield f"gaussian d' {d_prime:g}, N = {count}", count, most, gaussian(count, d_prime)
    taps = held_out_taps()
    for period, most in ((1.5, 240), (2.0, 40)):
        drawn = source(taps, SameDifferent(), period_mm=period, fold=0).draw
        yield f"same/different {period:g} mm", 2, most, drawn
    for count in (4, 8):
        drawn = source(taps, Orientations(count), period_mm=2.0, fold=0).draw
        yield f"{count} orientations 2 mm", count, 60, drawn
    if folder := os.environ.get("BGMODEL_RECORDINGS"):
        yield "real taps, edge 5 degrees", 2, 60, real_taps(Path(folder)).draw


def real_taps(folder: Path) -> Source:
    """Return readings of real taps of an edge, as figure R1 makes them."""
    from bgmodel.tactile.edges import decoded_yaw, halves, sources

    return sources(halves(SCORING_SEED, decoded_yaw(SCORING_SEED, folder)), 5.0)[0]


def conditions(trials: int | None = None) -> Iterator[tuple[str, Circuit, Evidence]]:
    """Yield each condition: its name, its circuit, its evidence of so many trials."""
    usual = trials or TRIALS
    for name, count, most, draw in kinds():
        table = circuit("spiking_msprt", count)
        drawn = partial(_drawn, name, most, draw)
        many = trials or MORE_TRIALS.get(name, usual)
        yield f"{name}, every 50 ms", table, drawn(many, 50.0)
        if name.startswith("gaussian d' 0.5") and count < 8:
            evidence = drawn(usual, 50.0)
            yield f"{name}, Poisson cortex", table.with_cell("ctx", cv=1.0), evidence
            apart = table.with_spread(0.1).with_connections(0.25)
            yield f"{name}, 10 % spread, 25 % connections", apart, evidence
        # Slow readings take ten times as long to simulate.
        yield f"{name}, every 500 ms", table, drawn(max(usual // 10, 200), 500.0)


def _drawn(name: str, most: int, draw: Draw, trials: int, step_ms: float) -> Evidence:
    return draw(trials, most, rng=stream(SCORING_SEED, "scoring", name), step_ms=step_ms)


def main() -> None:
    """Score every condition, or those whose name holds a text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, help="of each; 2 000 to 10 000 unless given")
    parser.add_argument("--only", default="", help="conditions whose name contains this")
    parser.add_argument("--gain", type=float, help="another than the usual one")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", action="store_true", help="compute only what is not there")
    given = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    for name, table, evidence in conditions(given.trials):
        if given.only not in name:
            continue
        gain = gain_of(table, given.gain)
        if given.gain:
            name += f", gain {gain:g}"
        path = OUT / f"scoring {name.replace('/', ' ')}.csv"
        behind = {"trials": evidence.trials, "gain": gain, "circuit": str(table)}
        if not (given.keep and path.exists()):
            rivals = rivals_on(zero_is_nothing=name.startswith("gaussian"))
            found = _score(table, evidence, gain, rivals, given.workers)
            write_table(found, path, seed=SCORING_SEED, **behind)
        print(f"\n=== {name}, {evidence.trials} trials")
        scored = read_table(path)
        own = scored["reference"] == MSPRT_AT_GAIN
        print(page(scored[own | scored["model"].isin(RIVALS)]), flush=True)


def _score(
    table: Circuit, evidence: Evidence, gain: float, rivals: list[str], workers: int
) -> pd.DataFrame:
    options: dict[str, Any] = {"workers": workers, "sample_ms": sample_ms(evidence.step_ms)}
    model = BasalGanglia(table, "ensemble", gain, SCORING_SEED, options)
    return compare_with_msprt(model, evidence, seed=SCORING_SEED, rivals=rivals)


if __name__ == "__main__":
    main()
