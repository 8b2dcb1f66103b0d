"""The dopamine level in place of a threshold: how it sets the posterior of a circuit's decisions.

The threshold of the read-out is fixed. Dopamine changes the cortical gains of D1 and D2 in
opposite directions, and with them OUT, so that the circuit stops at another posterior. A level is
learned in the same way as a gap (``learning.reinforce.learn``): only from rewards and from the
learner's perturbations of the level, without access to a gap, the evidence or a test.
``levels_against_msprt`` compares its decisions at many levels with those of the MSPRT.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import interval, resampled
from bgmodel.comparison.thresholds import msprt_tradeoffs
from bgmodel.deciding.calibration import against_evidence
from bgmodel.deciding.decision import any_crossing
from bgmodel.deciding.tradeoff import OF_TRIALS, Tradeoff, curve
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.basal_ganglia import NOISE_SHARE, BasalGanglia
from bgmodel.integrators.criterion import check_threshold, gain_of
from bgmodel.integrators.steady import leader_out
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.checks import check_positive, is_number
from bgmodel.support.seeds import stream
from circuits.anatomy import DEFAULT, checked_circuit, load_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.engines import Engine, Populations, Rates, Spikes
from circuits.errors import InputError, NoiseWarning, RangeWarning, quiet, require

ALLOWED = (0.0, 2.0)
"""Allowed levels; 1 is normal."""
MARGIN = 0.02
"""Relative margin of a learner from levels at which the fixed point stops deciding."""
THRESHOLD_NATS = 0.3
"""Default threshold on OUT for all levels. For two to four alternatives, levels then set stopping
posteriors of 0.75 to 0.99 at the fixed point."""


def decided_out(circuit: Circuit, level: float, log_odds: npt.ArrayLike) -> Array:
    """Return the leader's OUT at the fixed point, nats, by its log odds over each competitor."""
    circuit.check_nats("a drive of log odds")
    return leader_out(circuit.dopamine(level), log_odds)


def _odds(circuit: Circuit) -> Array:
    """Return log odds from 0 to the largest that still affect the circuit.

    Competitors more than ``reference_nats`` behind are silent; more evidence does not affect them.
    """
    circuit.check_nats("a stopping posterior that dopamine sets")
    n = circuit.channels
    most = (circuit.range_nats[1] - circuit.reference_nats + np.log(n)) * n / (n - 1)
    silent = np.inf if circuit.centred else circuit.reference_nats
    return np.linspace(0.0, min(circuit.max_deficit_nats, most, silent), 201)


@lru_cache(maxsize=1024)
def working_range(circuit: Circuit, threshold_nats: float) -> tuple[float, float]:
    """Return the lowest and highest level at which the fixed point decides by evidence.

    Below this range, OUT stays above the threshold whatever the evidence. Above it, OUT at rest is
    already below, so that the circuit decides without evidence, unless the range ends at 2, the
    highest level allowed. Spiking noise blurs both limits.
    """
    from scipy.optimize import brentq

    circuit = checked_circuit(circuit)
    require(is_number(threshold_nats), "threshold_nats", "must be a number", threshold_nats)
    odds = _odds(circuit)
    low_nats, high_nats = circuit.readable_nats
    if not low_nats < threshold_nats < high_nats:
        must = f"must be within the range of {circuit.name}, {low_nats:.3g} to {high_nats:.3g} nats"
        raise InputError.of("threshold_nats", must, threshold_nats)

    def turns(log_odds: Array) -> float:
        def past(level: float) -> float:
            return float(decided_out(circuit, level, log_odds).min()) - threshold_nats

        low, high = ALLOWED
        if past(low) <= 0:
            return low
        return high if past(high) > 0 else float(brentq(past, low, high, xtol=1e-4))

    low, high = turns(odds), turns(odds[:1])
    if not low < high:
        raise InputError(
            f"no level of dopamine in {ALLOWED[0]:g}..{ALLOWED[1]:g} takes {circuit.name} to a "
            f"threshold of {threshold_nats:.2f} nats by evidence alone",
            "threshold_nats",
        )
    return low, high


def usable_range(model: BasalGanglia, threshold_nats: float) -> tuple[float, float]:
    """Return the lowest and highest level that a learner should use.

    This is the working range, reduced by ``MARGIN`` at both ends (but not at a level of 2). With
    noise it also ends below the level at which OUT at rest meets the threshold in more than
    ``NOISE_SHARE`` of 200 trials of half a second.
    """
    low, high = working_range(model.circuit, threshold_nats)
    low = low * (1 + MARGIN)
    high = high * (1 - MARGIN) if high < ALLOWED[1] else high

    def noisy(level: float) -> bool:
        edited = replace(model, circuit=model.circuit.dopamine(level))
        return bool(any_crossing(edited.out_at_rest(200), threshold_nats).mean() > NOISE_SHARE)

    if model.engine.noisy and noisy(high):
        quiet = low
        while high - quiet > 0.01:
            middle = (quiet + high) / 2
            quiet, high = (quiet, middle) if noisy(middle) else (middle, high)
        high = quiet
    if not 0 < low < high:
        raise InputError(
            f"no level of dopamine takes {model.circuit.name} to a threshold of "
            f"{threshold_nats:.2f} nats by evidence and not by noise",
            "threshold_nats",
        )
    return low, high


def playable_levels(
    model: BasalGanglia, count: int, threshold_nats: float = THRESHOLD_NATS
) -> Array:
    """Return levels (count,) for learning, over the ``usable_range`` of a circuit.

    They are evenly spaced in their logarithm: OUT changes less at higher levels.
    """
    return np.geomspace(*usable_range(model, threshold_nats), count)


@lru_cache(maxsize=1024)
def stopping_posterior(circuit: Circuit, level: float, threshold_nats: float, gain: float) -> float:
    """Return the posterior at which the fixed point decides, with equal competitors.

    ``gain`` is in nats of drive per nat of evidence. A level outside ``working_range`` raises.
    """
    from scipy.optimize import brentq

    check_positive(gain=gain)
    circuit = checked_circuit(circuit)
    odds = _odds(circuit)
    past = decided_out(circuit, level, odds) - threshold_nats
    if not past[0] > 0 >= past.min():
        low, high = working_range(circuit, threshold_nats)
        raise InputError(
            f"at a threshold of {threshold_nats:g} nats {circuit.name} decides by evidence at "
            f"levels {low:.2f} to {high:.2f}, got {level:g}",
            "level",
        )
    first = int(np.argmax(past <= 0))
    edited = circuit.dopamine(level)
    log_odds = brentq(
        lambda o: float(leader_out(edited, o)) - threshold_nats,
        odds[first - 1],
        odds[first],
        xtol=1e-7,
    )
    return float(1 / (1 + (circuit.channels - 1) * np.exp(-log_odds / gain)))


def decide_at_levels(
    model: BasalGanglia, evidence: Evidence, levels: npt.ArrayLike, threshold_nats: float
) -> Tradeoff:
    """Decide at several levels of dopamine, (K,), with one threshold, nats, and the same noise.

    The levels are the ``settings`` of the result, highest first. A threshold at which the unchanged
    circuit would decide without evidence, or that it never reaches, raises.
    """
    check_threshold(model.circuit, threshold_nats)
    falling = np.sort(np.asarray(levels, dtype=np.float64))[::-1]
    low, high = ALLOWED
    if falling.ndim != 1 or not len(falling) or not np.all(np.diff(falling) < 0):
        raise InputError.of("levels", "must be one or more numbers, each once", levels)
    if not (falling[-1] >= low and falling[0] <= high):
        raise InputError.of("levels", f"must be within {low:g}..{high:g}", levels)
    model = model.adapted_to(evidence)
    model.check_strength(evidence)
    with quiet(RangeWarning):  # the levels are run on the same evidence
        rows = [
            decide_at_thresholds(
                replace(model, circuit=model.circuit.dopamine(float(level))),
                evidence,
                [threshold_nats],
                decoder_tau_ms=None,
            )[CIRCUIT]
            for level in falling
        ]
    for level, row in zip(falling, rows, strict=True):
        if warning := against_evidence(row.posterior[~row.forced], evidence.hypotheses):
            NoiseWarning.warn(f"at a level of {level:g} {warning}")
    return Tradeoff(falling, *(np.concatenate([getattr(r, n) for r in rows]) for n in OF_TRIALS))


STEPS = {2: 120, 4: 160}
"""Numbers of alternatives, and largest number of readings in a trial."""
LEVELS, RESAMPLES = 14, 500
LOWEST_SHARE = 0.85
"""Lowest level, as a share of the lowest at which the fixed point decides: below the latter, noise
can still take OUT to the threshold."""
SPIKING_SHARE = 0.5
"""Trials of the spiking engine, as a share of those of other engines."""
LATENCY_MS = {2: 47.8, 4: 51.5}
"""Non-decision time: the default circuit's offset against the MSPRT at its gain where noise costs
least, d' = 1 at accuracy 0.9 to 0.95 (`figures.decisions.measure_raw`). It is subtracted in the
comparison with the full MSPRT too, so that the cost of the lower gain is not."""
ENGINES = (Rates().coarse(), Populations(), Spikes())


def level_table(
    swept: Tradeoff,
    tests: Mapping[str, Tradeoff],
    *,
    circuit: Circuit,
    gain: float,
    latency_ms: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Return measures of decisions at each level of dopamine, with the fixed point and tests.

    One row per level and measure: mean_posterior (of the choice), fixed_point (posterior at which
    the fixed point decides, NaN outside its range), mean_ms, forced, premature; and per test
    accuracy_gap (expected accuracy minus the test's at the same mean time less ``latency_ms``) and
    extra_ms (mean time minus the test's at the same expected accuracy, latency included).
    """
    weights = resampled(swept.trials, RESAMPLES, rng)
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
    low, high = working_range(circuit, THRESHOLD_NATS)
    rows = []
    for k, level in enumerate(swept.settings):
        inside = low < level < high
        at = circuit, float(level), THRESHOLD_NATS, gain
        exact = stopping_posterior(*at) if inside else np.nan
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
        levels = np.geomspace(LOWEST_SHARE * low, 0.98 * high, LEVELS)
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
