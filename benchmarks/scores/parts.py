"""The role of each component of the default circuit, on raw evidence: make score.

The circuit without a computational component (controls: the test must fail) or without one that
cancels common input, compared with the intact circuit on the same trials, with populations: the
change of each measure of agreement with the MSPRT at equal accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import pandas as pd

from benchmarks.scores.pieces import Made, Piece, Score, main, wide
from bgmodel import stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Population
from circuits.laws.controls import linear_stn, shuffled_stn

SCORING_SEED = 40_008
TRIALS, COARSE_TRIALS = 3000, 600
CASES = ((2, 0.5, 80, 0.0), (4, 1.0, 40, 0.0), (2, 0.5, 80, 0.5), (4, 1.0, 40, 0.5))
"""Alternatives, d', readings of a trial, and sd, nats, of what a reading adds to all channels."""
ACCURACIES = (0.9, 0.95)
MEASURES = ("agreement", "within_50_ms", "pearson_r", "extra_ms")


def _held(name: str) -> Callable[[Circuit], Circuit]:
    return lambda table: table.clamp(name)


EDITS: dict[str, tuple[str, Callable[[Circuit], Circuit]]] = {
    "a linear STN": ("control", linear_stn),
    "GPe held at its rest": ("control", _held("GPe")),
    "STN's sum to the wrong channel": ("control", shuffled_stn),
    "slow common mode held (GPe to cortex)": ("part", _held("GPe_ctx")),
    "fast inhibition held (ctx_inh)": ("part", _held("ctx_inh")),
    "indirect pathway held (D2)": ("part", _held("D2")),
}
"""Held nuclei fire at their constant resting rate: they keep their tone but carry no signal."""


def changes(
    channels: int, d_prime: float, readings: int, shared_nats: float, trials: int, workers: int
) -> pd.DataFrame:
    """Return the change by each edit, and the circuit itself."""
    table = load_circuit(DEFAULT, channels)
    rng = stream(SCORING_SEED, "parts", str(channels), str(d_prime))
    given = {"d_prime": d_prime, "channels": channels, "t_max": readings}
    evidence = gaussian_evidence(trials, seed=rng, **given)
    shared = shared_nats * rng.standard_normal((trials, readings, 1))
    evidence = replace(evidence, log_likelihood=evidence.log_likelihood + shared)
    engine = Population(workers=workers)
    model = BasalGanglia(table, engine, gain_of(table), SCORING_SEED)
    edited = {name: edit(table) for name, (_, edit) in EDITS.items()}
    found = compare_edits(model, edited, evidence, seed=SCORING_SEED, accuracies=ACCURACIES)
    return found.assign(
        alternatives=channels, d_prime=d_prime, shared_nats=shared_nats, trials=trials
    )


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the comparison of all edits, case by case."""
    trials = COARSE_TRIALS if fast else TRIALS
    for channels, d_prime, readings, shared_nats in CASES:
        make = partial(changes, channels, d_prime, readings, shared_nats, trials, workers)
        name = f"N = {channels}, d' {d_prime:g}, shared {shared_nats:g}"
        yield Piece("changes", name, trials, 0.07 * trials, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the changes, one row a case, an edit and an accuracy."""
    found = made["changes"]
    shown = found[(found["kind"] == "change") & found["measure"].isin(MEASURES)]
    shown = shown[shown["variant"] != "intact"]
    kinds = {name: kind for name, (kind, _) in EDITS.items()}
    shown = shown.assign(role=shown["variant"].map(kinds))
    by = ["alternatives", "d_prime", "shared_nats", "trials", "variant", "role", "accuracy"]
    return {"changes": ("changes", wide(shown, by))}


SCORE = Score("parts", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
