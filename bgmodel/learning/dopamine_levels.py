"""A circuit with a fixed threshold at levels of dopamine, compared with the MSPRT."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from bgmodel.bootstrap import interval, resampled
from bgmodel.comparison.thresholds import msprt_tradeoffs
from bgmodel.deciding.tradeoff import Tradeoff, curve
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.dopamine import (
    THRESHOLD_NATS,
    decide_at_levels,
    levels_between,
    stopping_posterior,
    working_range,
)
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Engine, Ensemble, Population, Rate

STEPS = {2: 120, 4: 160}
"""Numbers of alternatives, and largest number of readings in a trial."""
LEVELS = 14
LOWEST_SHARE = 0.85
"""Lowest level, as a share of the lowest at which the fixed point decides: below the latter, noise
can still take OUT to the threshold."""
SPIKING_SHARE = 0.5
"""Trials of the spiking engine, as a share of those of other engines."""
LATENCY_MS = {2: 50.6, 4: 54.2}
"""Non-decision time: the default circuit's offset against the MSPRT at its gain where noise costs
least, d' = 1 at accuracy 0.9 to 0.95 (`figures.decisions.measure_raw`). It is subtracted in the
comparison with the full MSPRT too, so that the cost of the lower gain is not."""
ENGINES = (Rate().coarse(), Population(), Ensemble())


def level_table(
    swept: Tradeoff,
    tests: Mapping[str, Tradeoff],
    *,
    circuit: Circuit,
    gain: float,
    latency_ms: float,
    threshold_nats: float = THRESHOLD_NATS,
    rng: np.random.Generator,
    resamples: int = 500,
) -> pd.DataFrame:
    """Return measures of decisions at each level of dopamine, with the fixed point and tests.

    One row per level and measure: mean_posterior (of the choice), fixed_point (posterior at which
    the fixed point decides, NaN outside its range), mean_ms, forced, premature; and per test
    accuracy_gap (expected accuracy minus the test's at the same mean time less ``latency_ms``) and
    extra_ms (mean time minus the test's at the same expected accuracy, latency included).
    """
    weights = resampled(swept.trials, resamples, rng)
    weights = weights / weights.sum(axis=1, keepdims=True)
    values = {
        ("mean_posterior", ""): weights @ swept.posterior.T,
        ("mean_ms", ""): weights @ swept.time_ms.T,
        ("forced", ""): weights @ swept.forced.T,
        ("premature", ""): weights @ swept.premature.T,
    }
    reached, took = values["mean_posterior", ""], values["mean_ms", ""]
    for name, test in tests.items():
        known, time = curve(test, weights)
        values["accuracy_gap", name] = reached - _between(took - latency_ms, time, known)
        values["extra_ms", name] = took - _between(reached, known, time)
    low, high = working_range(circuit, threshold_nats)
    rows = []
    for k, level in enumerate(swept.settings):
        inside = low < level < high
        exact = (
            stopping_posterior(circuit, float(level), threshold_nats, gain) if inside else np.nan
        )
        rows.append((level, "fixed_point", exact, np.nan, np.nan, ""))
        rows += [(level, m, *interval(draws[:, k]), name) for (m, name), draws in values.items()]
    return pd.DataFrame(rows, columns=["level", "measure", "value", "low", "high", "reference"])


def _between(at: Array, x: Array, y: Array) -> Array:
    """Return each row of y, interpolated where x is ``at``; NaN outside the range of x."""
    return np.array([np.interp(*row, np.nan, np.nan) for row in zip(at, x, y, strict=True)])


def levels_against_msprt(
    seed: int,
    trials: int,
    spiking_every: int = 1,
    alternatives: Sequence[int] = tuple(STEPS),
    engines: Sequence[Engine] = ENGINES,
) -> pd.DataFrame:
    """Return ``level_table`` for some numbers of alternatives and engines, and the tests' curves.

    The spiking engine runs every ``spiking_every``-th level. Rows with the measure "curve" are
    those of a test: level is its posterior, value its mean time, ms.
    """
    parts = []
    for channels in alternatives:
        table = load_circuit(DEFAULT, channels)
        gain = gain_of(table)
        low, high = working_range(table, THRESHOLD_NATS)
        levels = levels_between(LOWEST_SHARE * low, 0.98 * high, LEVELS)
        rng = stream(seed, "figD2", channels)
        evidence = separated_evidence(
            trials, STEPS[channels], 0.5 / np.sqrt(2), rng=rng, hypotheses=channels, step_ms=50.0
        )
        tests = msprt_tradeoffs(evidence, gain)
        for engine in engines:
            model = BasalGanglia(table, engine, gain, seed)
            played = levels[::spiking_every] if engine.spiking else levels
            decided = evidence[: round(SPIKING_SHARE * trials)] if engine.spiking else evidence
            measures = level_table(
                decide_at_levels(model, decided, played, THRESHOLD_NATS),
                msprt_tradeoffs(decided, gain),
                circuit=table,
                gain=gain,
                latency_ms=LATENCY_MS[channels],
                rng=stream(seed, "bootstrap"),
            )
            parts.append(measures.assign(channels=channels, engine=engine.id))
        for name, test in tests.items():
            line = {"level": test.posterior.mean(axis=1), "value": test.time_ms.mean(axis=1)}
            parts.append(
                pd.DataFrame(line).assign(measure="curve", reference=name, channels=channels)
            )
    return pd.concat(parts, ignore_index=True)
