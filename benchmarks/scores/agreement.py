"""Comparison of the circuit with the MSPRT on scoring seeds: make score.

All kinds of evidence, readings every 50 and every 500 ms, two cortical codes; each also with a
decoder of the circuit's own cortical spikes. Simulated taps come from six folds, and their
intervals are over folds. Evaluated on held-out seeds. The coarse form omits readings every 500 ms,
which take ten times as long.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from benchmarks.scores.pieces import TABLE, Made, Piece, Score, main, wide
from bgmodel import stream
from bgmodel.comparison.compare import compare
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import CIRCUIT, sample_ms
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import FOLDS, Folds, Source, Tactile, folds, held_out_taps
from bgmodel.tactile.task import EdgeTurn, Orientation, SameDifferent
from circuits.anatomy import load_circuit
from circuits.circuit import Circuit
from circuits.engines import Ensemble

SCORING_SEED = 40_001
GAIN = 0.5
"""A second gain, nats in the circuit per nat of evidence."""
TRIALS, COARSE_TRIALS, SLOW_TRIALS = 2000, 200, 200
MORE_TRIALS = {
    "Gaussian, d' 1, N = 2": 10_000,
    "Gaussian, d' 0.5, N = 2": 10_000,
    "same/different, 2 mm": 10_000,
    "real taps, edge 5 degrees": 10_000,
    "Gaussian, d' 1, N = 4": 5000,
    "Gaussian, d' 0.5, N = 4": 6000,
    "same/different, 1.5 mm": 5000,
    "4 orientations, 2 mm": 5000,
}
"""More trials if the correlation of times is near its target: 2 000 determine it to +-0.03."""
WITH_BASELINES = "Gaussian, d' 0.5"
"""Evidence on which the baselines' loss of accuracy is shown."""
Draw = Callable[..., Evidence]


class Kind(NamedTuple):
    """A kind of evidence: alternatives, most readings, drawing, CPU seconds per 100 trials."""

    name: str
    channels: int
    most: int
    draw: Draw
    seconds: float


class Condition(NamedTuple):
    """A kind of evidence for a circuit."""

    name: str
    table: Circuit
    gain: float
    trials: int
    draw: Callable[[], Evidence]
    seconds: float
    usual: bool
    """Whether the circuit is unedited and readings come every 50 ms."""


def gaussian(hypotheses: int, d_prime: float) -> Draw:
    """Return a function that draws Gaussian evidence of a pairwise d' per reading."""
    return partial(separated_evidence, separation=d_prime / np.sqrt(2), hypotheses=hypotheses)


def kinds() -> Iterator[Kind]:
    """Yield the kinds of evidence."""
    gaussians = ((2, 0.5, 120, 3), (4, 0.5, 120, 7), (2, 1, 40, 1.5), (4, 1, 40, 2.5))
    for count, d_prime, most, seconds in (*gaussians, (8, 0.5, 160, 16)):
        name = f"Gaussian, d' {d_prime:g}, N = {count}"
        yield Kind(name, count, most, gaussian(count, d_prime), seconds)
    for period, most, seconds in ((1.5, 240, 4), (2.0, 40, 1)):
        draw = partial(read, partial(gratings, SameDifferent(period)))
        yield Kind(f"same/different, {period:g} mm", 2, most, draw, seconds)
    for count, seconds in ((4, 2), (8, 7)):
        draw = partial(read, partial(gratings, Orientation(count)))
        yield Kind(f"{count} orientations, 2 mm", count, 60, draw, seconds)
    if folder := os.environ.get("BGMODEL_RECORDINGS"):
        draw = partial(read, partial(real_taps, Path(folder)))
        yield Kind("real taps, edge 5 degrees", 2, 60, draw, 1.5)


def read(source: Callable[[], Source | Folds], *given: Any, **named: Any) -> Evidence:
    """Draw evidence from a source that is created on first use."""
    return source().draw(*given, **named)


@cache
def gratings(question: Tactile) -> Folds:
    """Return readings of held-out taps of a grating, of all folds."""
    return folds(held_out_taps(), question)


@cache
def real_taps(folder: Path) -> Folds:
    """Return readings of pairs of real taps of an edge, of all folds."""
    from bgmodel.tactile.edges import decoded_edges

    return folds(decoded_edges(SCORING_SEED, folder), EdgeTurn(2, step_deg=5.0))


def conditions(fast: bool = False, trials: int | None = None) -> Iterator[Condition]:
    """Yield the conditions, each with its usual trials unless their number is given."""
    usual = trials or (COARSE_TRIALS if fast else TRIALS)
    for kind in kinds():
        table = load_circuit(TABLE, kind.channels)
        many = usual if fast or trials else MORE_TRIALS.get(kind.name, usual)
        one = partial(_condition, kind)
        yield one("", table, many)
        if kind.name.startswith("Gaussian, d' 0.5") and kind.channels < 8:
            yield one(", Poisson cortex", table.with_cell("ctx", cv=1.0), usual)
            apart = table.with_heterogeneity(0.1).with_connections(0.25)
            yield one(", 10 % spread, 25 % connections", apart, usual, times=4)
            # The levels of dopamine use this as the non-decision time.
            if gain_of(table) != GAIN:
                yield one(f", gain {GAIN:g}", table, usual, gain=GAIN)
        if not fast:
            yield one(", every 500 ms", table, SLOW_TRIALS, step_ms=500.0, times=10)


def _condition(
    kind: Kind,
    ending: str,
    table: Circuit,
    trials: int,
    *,
    gain: float | None = None,
    step_ms: float = 50.0,
    times: float = 1.0,
) -> Condition:
    draw = partial(drawn, kind, trials, step_ms)
    seconds = times * kind.seconds * trials / 100
    name = f"{kind.name}{ending}"
    return Condition(name, table, gain_of(table, gain), trials, draw, seconds, not ending)


def drawn(kind: Kind, trials: int, step_ms: float) -> Evidence:
    """Return evidence of a kind, the same for every circuit."""
    rng = stream(SCORING_SEED, "scoring", kind.name)
    return kind.draw(trials, kind.most, rng=rng, step_ms=step_ms)


def groups_of(name: str, trials: int) -> npt.NDArray[np.intp] | None:
    """Return the fold of each trial of taps; intervals resample whole folds."""
    tapped = name.startswith(("same/different", "4 orient", "8 orient", "real taps"))
    return np.arange(trials) % FOLDS if tapped else None


def groups(condition: Condition) -> npt.NDArray[np.intp] | None:
    """Return the fold of each trial of a condition."""
    return groups_of(condition.name, condition.trials)


def decisions(condition: Condition, workers: int) -> pd.DataFrame:
    """Return the comparison of a condition, as from ``compare``."""
    evidence = condition.draw()
    engine = Ensemble(workers=workers, sample_ms=sample_ms(evidence.step_ms))
    model = BasalGanglia(condition.table, engine, condition.gain, SCORING_SEED)
    baselines = baselines_on(zero_is_nothing=condition.name.startswith("Gaussian"))
    found = compare(
        model, evidence, seed=SCORING_SEED, baselines=baselines, groups=groups(condition)
    ).table
    known = {"evidence": condition.name, "trials": condition.trials, "gain": condition.gain}
    return found.assign(**known, channels=condition.table.channels)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per condition."""
    for condition in conditions(fast):
        make = partial(decisions, condition, workers)
        yield Piece("decisions", condition.name, condition.trials, condition.seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return decisions at equal accuracy, extra time as a line, and the baselines' loss."""
    found = made["decisions"]
    own = found[found["reference"] == MSPRT_AT_GAIN]
    own = own.assign(
        measure=own["measure"].where(own["model"] == CIRCUIT, "decoder_" + own["measure"])
    )
    by = ["evidence", "channels", "trials", "gain"]
    lines = own[own["accuracy"].isna()]
    shown = ["agreement", "agreement_chance", "error_agreement", "within_50_ms", "pearson_r"]
    shown += ["within_50_ms_chance", "extra_ms", "decoder_pearson_r"]
    at = own[own["accuracy"].notna() & own["measure"].isin(shown)]
    gaps = found[(found["reference"] == MSPRT) & (found["measure"] == "accuracy_gap")]
    gaps = gaps[gaps["evidence"].str.fullmatch(rf"{WITH_BASELINES}, N = \d+")]
    gaps = gaps[gaps["model"].isin([CIRCUIT, *BASELINES])]
    return {
        "decisions": ("decisions", wide(at, [*by, "accuracy"])),
        "lines": ("decisions", wide(lines, by)),
        "baselines": ("decisions", wide(gaps, ["channels", "trials", "accuracy", "model"])),
    }


SCORE = Score("agreement", SCORING_SEED, (2, 4, 8), pieces, tables)

if __name__ == "__main__":
    main(SCORE)
