"""Published circuits under one protocol: what each computes, and which known effects it shows.

All circuits receive the same evidence. At equal accuracy they are compared with the MSPRT; designed
trials show which test their times follow; at one threshold they are tested with conflict, loss of
STN and of GPe, and more and less dopamine. The expected changes were written down before any run. A
circuit whose unit is not nats gets the gain with which it is fastest at accuracy 0.9, on trials of
another seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bgmodel import BasalGanglia, stream
from bgmodel.bootstrap import FEWEST_TRIALS, RESAMPLES, resampled
from bgmodel.comparison import designed as designs
from bgmodel.comparison.compare import compare
from bgmodel.comparison.matched import MOST_FORCED, OTHER_NOISE
from bgmodel.comparison.thresholds import MSPRT, fastest_gain
from bgmodel.deciding.tradeoff import WITHOUT_EVIDENCE_SHARE, Tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.engines import engine_of
from figures.pieces import Piece, Score

SCORING_SEED, TUNING_SEED = 76_001, 76_002
"""Of the trials, and of those on which gains are chosen."""
D_PRIME, STEP_MS, READINGS = 0.5, 50.0, 120
CONFLICT = 0.7
"""Mean of one competitor, as a fraction of the true channel's."""
ACCURACY = 0.9
"""Circuits are compared with the MSPRT, and edited, at the threshold of this accuracy."""
DESIGNED_AT = (0.85, 0.9)
"""Designed trials are decided at the thresholds of these accuracies."""
TRIALS, COARSE_TRIALS, TUNING_TRIALS = 2000, 300, 500
WINDOW_MS = (150.0, 600.0)
"""Time after the onset over which the rate of STN is averaged."""


class Entrant(NamedTuple):
    """A circuit, its engine here, and its trials in percent of the usual number."""

    name: str
    engine: str
    percent: int = 100


ENTRANTS = (
    Entrant("bogacz_gurney", "algebra"),
    Entrant("macaque", "population"),
    Entrant("spiking_msprt", "population"),
    Entrant("gpr", "rate"),
    Entrant("stewart", "rate"),
    Entrant("humphries", "spikes", 10),
)


class ExpectedChange(NamedTuple):
    """A measure, the sign of its expected change, and the least change that counts."""

    measure: str
    direction: int
    least: float


class PublishedEffect(NamedTuple):
    """A change of a circuit or of its evidence, its source, and the expected effect."""

    published: str
    edited: Callable[[Circuit], Circuit]
    expected: ExpectedChange
    conflict: float = 0.0


def _same(table: Circuit) -> Circuit:
    return table


def _fewer_stn(table: Circuit) -> Circuit:
    return table.lesion("STN", 0.1)


FASTER, SLOWER = (ExpectedChange("mean_percent", sign, 2.0) for sign in (-1, 1))
EDITS: Mapping[str, PublishedEffect] = {
    "conflict": PublishedEffect(
        "STN fires more (people, Zaghloul 2012, abstract)",
        _same,
        ExpectedChange("stn_percent", 1, 1.0),
        CONFLICT,
    ),
    "a tenth of STN lost": PublishedEffect(
        "less accurate (rats, Baunez 2001, abstract)",
        _fewer_stn,
        ExpectedChange("accuracy", -1, 0.01),
    ),
    "a tenth of STN lost, conflict": PublishedEffect(
        "faster under conflict (people, stimulated, Cavanagh 2011)", _fewer_stn, FASTER, CONFLICT
    ),
    "a fifth of GPe lost": PublishedEffect(
        "slower (derived from Bogacz & Gurney 2007)",
        lambda table: table.lesion("GPe", 0.2),
        SLOWER,
    ),
    "dopamine 1.15": PublishedEffect(
        "hastier (people, Chakroun 2023, abstract)",
        lambda table: table.dopamine(1.15),
        FASTER,
    ),
    "dopamine 0.85": PublishedEffect(
        "slower (derived from Bogacz & Gurney 2007)",
        lambda table: table.dopamine(0.85),
        SLOWER,
    ),
}
AGREES, DISAGREES, OPEN = "as expected", "not as expected", "left open"
NOTHING, WITHOUT, NEVER = "nothing to change", "decides without evidence", "does not decide"


def drawn(alternatives: int, conflict: float, trials: int, seed: int = SCORING_SEED) -> Evidence:
    """Draw the problem; conflict raises the mean of one competitor and changes no noise."""
    settings = {"d_prime": D_PRIME, "t_max": READINGS, "step_ms": STEP_MS, "conflict": conflict}
    rng = stream(seed, "others", str(alternatives))
    return gaussian_evidence(trials, channels=alternatives, seed=rng, **settings)


@cache
def tuned(entrant: Entrant, alternatives: int) -> tuple[BasalGanglia, Tradeoff]:
    """Return a circuit at its gain, and its decisions on trials of the tuning seed."""
    trials = max(FEWEST_TRIALS, TUNING_TRIALS * entrant.percent // 100)
    evidence = drawn(alternatives, 0.0, trials, TUNING_SEED)
    table = load_circuit(entrant.name, alternatives)
    engine = engine_of(entrant.engine).tuned(workers=2)
    model, decided = fastest_gain(table, engine, evidence, TUNING_SEED)
    return replace(model, seed=SCORING_SEED), decided


def decisions(entrant: Entrant, alternatives: int, trials: int) -> pd.DataFrame:
    """Return one row: the comparison with the MSPRT at equal accuracy."""
    model, _ = tuned(entrant, alternatives)
    evidence = drawn(alternatives, 0.0, trials)
    comparison = compare(
        model, evidence, seed=SCORING_SEED, baselines=(), accuracies=(ACCURACY,), noise_ceiling=True
    ).table
    row: dict[str, Any] = {"gain": model.gain}
    of = comparison[(comparison["model"] == CIRCUIT) & (comparison["accuracy"] == ACCURACY)]
    for reference, ending, measures in (
        (MSPRT, "", ("agreement", "agreement_chance", "extra_ms")),
        (OTHER_NOISE, "_ceiling", ("agreement",)),
    ):
        part = of[of["reference"] == reference].set_index("measure")
        for measure in measures:
            known = measure in part.index
            for what, end in (("value", ""), ("low", "_low"), ("high", "_high")):
                row[f"{measure}{ending}{end}"] = part.loc[measure, what] if known else np.nan
    return pd.DataFrame([row])


def computes(entrant: Entrant, alternatives: int, trials: int) -> pd.DataFrame:
    """Return the verdict of designed trials on each theory."""
    model, decided = tuned(entrant, alternatives)
    thresholds = [decided.setting(accuracy) for accuracy in DESIGNED_AT]
    table = designs.designed_circuit(model, thresholds, trials=trials if model.engine.noisy else 1)
    return designs.verdicts(table)


def changes(entrant: Entrant, alternatives: int, trials: int) -> pd.DataFrame:
    """Return the effects of each edit at the threshold of accuracy 0.9, and the expected ones."""
    model, decided = tuned(entrant, alternatives)
    threshold = decided.setting(ACCURACY)
    shown = {conflict: drawn(alternatives, conflict, trials) for conflict in (0.0, CONFLICT)}
    plain = {conflict: seen(model, evidence, threshold) for conflict, evidence in shown.items()}
    weights = resampled(trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"))
    rows = []
    for name, edit in EDITS.items():
        table = edit.edited(model.circuit)
        of_evidence, same = name == "conflict", table == model.circuit
        before = plain[0.0 if of_evidence else edit.conflict]
        after = plain[edit.conflict]
        if not same:
            after = seen(replace(model, circuit=table), shown[edit.conflict], threshold)
        row = {"edit": name, "published": edit.published, "threshold": threshold}
        row |= {"premature": after["premature"].mean(), "forced": after["forced"].mean()}
        row |= differences(before, after, weights)
        row["expected"] = (
            f"{edit.expected.measure} {'up' if edit.expected.direction > 0 else 'down'}"
        )
        row["outcome"] = NOTHING if same and not of_evidence else verdict(row, edit.expected)
        rows.append(row)
    return pd.DataFrame(rows)


def differences(
    before: Mapping[str, Array], after: Mapping[str, Array], weights: Array
) -> dict[str, float]:
    """Return changes of accuracy, mean time and rate of STN, with 95 % intervals over trials."""
    old, new = (
        {name: weights @ values / weights.sum(axis=1) for name, values in one.items()}
        for one in (before, after)
    )
    changed = {
        "accuracy": new["right"] - old["right"],
        "mean_percent": 100 * (new["time_ms"] / old["time_ms"] - 1),
        "stn_percent": 100 * (new["stn_hz"] / old["stn_hz"] - 1),
    }
    row: dict[str, float] = {}
    for measure, values in changed.items():
        low, high = np.quantile(values[1:], (0.025, 0.975))
        row |= {measure: values[0], f"{measure}_low": low, f"{measure}_high": high}
    return row


def verdict(row: Mapping[str, Any], expected: ExpectedChange) -> str:
    """Return whether a change is as expected, or why its row leaves this open."""
    if row["forced"] > MOST_FORCED:
        return NEVER
    if row["premature"] > WITHOUT_EVIDENCE_SHARE:
        return WITHOUT
    return outcome(expected, row[f"{expected.measure}_low"], row[f"{expected.measure}_high"])


def outcome(expected: ExpectedChange, low: float, high: float) -> str:
    """Compare the interval of a change with the least change that counts."""
    if expected.direction < 0:
        low, high = -high, -low
    if not np.isfinite([low, high]).all():
        return OPEN
    return AGREES if low > expected.least else DISAGREES if high < expected.least else OPEN


def seen(model: BasalGanglia, evidence: Evidence, threshold: float) -> dict[str, Array]:
    """Return choices, times and rates of STN at a threshold, (trials,) each.

    The rate of STN is the mean over channels and ``WINDOW_MS``, whenever the trial decides.
    """
    decided = decide_at_thresholds(model, evidence, [threshold], decoder_tau_ms=None)[CIRCUIT]
    short = replace(
        evidence, log_likelihood=evidence.log_likelihood[:, : int(WINDOW_MS[1] / STEP_MS)]
    )
    rates = []
    for _, activity, _ in model.batches(short):
        inside = (activity.time_ms >= WINDOW_MS[0]) & (activity.time_ms <= WINDOW_MS[1])
        rates.append(activity.rates_hz["STN"][:, inside].mean(axis=(1, 2)))
    return {
        "right": (decided.choice[0] == evidence.truth).astype(float),
        "time_ms": decided.time_ms[0],
        "premature": decided.premature[0].astype(float),
        "forced": decided.forced[0].astype(float),
        "stn_hz": np.concatenate(rates).astype(float),
    }


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield decisions, designed trials and edits, circuit by circuit."""
    for entrant in ENTRANTS:
        trials = max(FEWEST_TRIALS, (COARSE_TRIALS if fast else TRIALS) * entrant.percent // 100)
        for count in (2, 4):
            for kind, make in (("decisions", decisions), ("changes", changes)):
                yield _piece(kind, entrant, count, trials, make)
        yield _piece("computes", entrant, 4, max(40, trials // 10), computes)


def _piece(
    kind: str, entrant: Entrant, count: int, trials: int, make: Callable[..., pd.DataFrame]
) -> Piece:
    def made() -> pd.DataFrame:
        table = make(entrant, count, trials)
        return table.assign(
            circuit=entrant.name, engine=entrant.engine, alternatives=count, trials=trials
        )

    name = f"{entrant.name}, N = {count}"
    return Piece(kind, name, trials, 0.02 * count * trials, made)


PUBLISHED = tuple(entrant.name for entrant in ENTRANTS if entrant.name != DEFAULT)
SCORE = Score("others", SCORING_SEED, (2, 4), pieces, circuit=DEFAULT, others=PUBLISHED)
