"""Designed trials: noise-free evidence on which theories of decision making disagree.

Competitors are separated from the first reading on, then the leader alone rises by the same amount
at each reading. At any time a theory summarises the competitors in one number: the MSPRT by the log
of their summed exponentials, max-vs-next by the highest, max-vs-average by the mean. Each design
keeps one of these numbers and changes the others. A theory compares the leader with its number, so
the shift of a crossing time by a design is the change of the number over the leader's rise, at any
threshold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.comparison.matched import row_means
from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import ROUNDING_NATS, BasalGanglia
from bgmodel.integrators.baselines import BASELINES
from bgmodel.integrators.criterion import check_threshold
from bgmodel.integrators.sprt import Integrator, Msprt
from bgmodel.support.checks import reals
from bgmodel.support.processes import advance
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError, RangeWarning, quiet, require

CHANNELS = 4
THRESHOLDS = (0.35, 0.25, 0.15)
"""Default thresholds on OUT, nats."""
SPREAD_NATS = 1.6
"""Distance of hopeless competitors below close ones, in the circuit's nats."""
RISE_NATS_S = 2.0
"""Rate at which the leader rises, in the circuit's nats per second."""
STEP_MS = 50.0
CLOSE_MS, APART_MS = 60.0, 100.0
"""A circuit follows a theory if all differences are within the first, and differs from it if
at each threshold one is beyond the second."""
FEWEST_RIGHT = 0.9
"""A difference is reported if the leader is chosen in at least this share of trials."""
MOST_READINGS = 512
LEAD, AVERAGE = "same lead", "same average"
MSPRT = "MSPRT"
UNABLE = {"max vs next": LEAD, "max vs average": AVERAGE}
"""The alternatives to the MSPRT, and the design each cannot distinguish from equal competitors."""
FOLLOWS, APART, OPEN = "follows", "told apart", "left open"


@dataclass(frozen=True)
class DesignedTrial:
    """A designed trial: evidence for competitors from the first reading on, (channels - 1,) nats.

    ``held`` names what is the same as with equal competitors: the lead over the next competitor
    ("same lead") or over the average ("same average").
    """

    name: str
    held: str
    competitors: tuple[float, ...]

    def evidence(self, readings: int, *, trials: int = 1, kappa: float = 1.0) -> Evidence:
        """Return copies of the trial; ``kappa`` is nats of the design per nat of evidence.

        Channel 0 is the leader.
        """
        count = len(self.competitors) + 1
        values = np.zeros((readings, count))
        values[0, 1:] = self.competitors
        values[:, 0] = RISE_NATS_S * STEP_MS / 1000
        values = np.repeat(values[None] / kappa, trials, axis=0)
        return Evidence(values, np.zeros(trials, int), step_ms=STEP_MS, baseline=0.0)


def designs(channels: int = CHANNELS) -> tuple[DesignedTrial, ...]:
    """Return the designed trials, the one with equal competitors first."""
    if channels < 3:
        raise InputError(f"designed trials need 3 channels or more, got {channels}", "channels")
    competitors = channels - 1
    kinds = [DesignedTrial(f"{competitors} equal", "", (0.0,) * competitors)]
    for held in (LEAD, AVERAGE):
        # One close competitor, and one hopeless one; with two competitors these are the same.
        for close in dict.fromkeys((1, competitors - 1)):
            far = competitors - close
            up = SPREAD_NATS * far / competitors if held == AVERAGE else 0.0
            each = (up,) * close + (up - SPREAD_NATS,) * far
            kinds.append(DesignedTrial(f"{close} close, {far} hopeless", held, each))
    return tuple(kinds)


def theories(kappa: float = 1.0) -> dict[str, Integrator]:
    """Return the MSPRT at a gain, and alternatives to it."""
    return {MSPRT: Msprt(kappa), **{name: BASELINES[name]() for name in UNABLE}}


def designed_circuit(
    model: BasalGanglia,
    thresholds: Sequence[float] = THRESHOLDS,
    *,
    trials: int = 200,
) -> pd.DataFrame:
    """Return decision times of a circuit on designed trials minus those of theories.

    The table is that of ``designed``, with the MSPRT at the circuit's gain. ``trials`` of a design
    have independent noise that is the same in all designs; there is 1 for an engine without noise.
    ValueError if the circuit has two channels, a threshold is outside the range of its read-out,
    there is no fixed point or it never reaches a threshold, or trials are too few for an interval.
    """
    trials, _ = size(model, thresholds, trials)
    model = model.unadapted  # the designs are in nats of drive
    return designed(
        model,
        thresholds,
        settled=at_fixed_point(model),
        kappa=kappa_of(model),
        channels=model.circuit.channels,
        trials=trials,
    )


def size(model: BasalGanglia, thresholds: Sequence[float], trials: int) -> tuple[int, int]:
    """Return the number of trials per design, and of readings.

    Arguments and errors are those of ``designed_circuit``.
    """
    if not model.engine.noisy:
        trials = 1
    elif trials < 2:
        raise InputError.of("trials", "must be at least 2 for an engine with noise", trials)
    for threshold in checked_thresholds(thresholds):
        check_read(model.circuit, threshold)
    settings: dict[str, Any] = {"channels": model.circuit.channels, "kappa": kappa_of(model)}
    return trials, readings_of(at_fixed_point(model), thresholds, **settings)


def at_fixed_point(model: BasalGanglia) -> BasalGanglia:
    """Return the circuit without noise and without any delay."""
    # Drop the record of edits: those that the fixed point ignores should not warn here.
    circuit = replace(model.circuit, unedited=None)
    return replace(model, circuit=circuit, engine="algebra")


def kappa_of(model: BasalGanglia) -> float:
    """Return nats of a design per nat of evidence: 1 for a circuit that does not work in nats."""
    return model.gain if model.circuit.unit == NATS else 1.0


def checked_thresholds(thresholds: Sequence[float] | Array) -> Array:
    """Return unique thresholds; ValueError unless they are a list of at least one number."""
    values = np.asarray(reals("thresholds", thresholds), dtype=np.float64)
    if values.ndim != 1 or not values.size:
        raise InputError.of("thresholds", "must be a list of numbers, such as [0.2]", thresholds)
    return np.array(list(dict.fromkeys(values.tolist())))


def check_read(circuit: Circuit, threshold: float) -> None:
    """Raise ValueError unless a circuit can decide by evidence at this OUT."""
    require(np.isfinite(threshold), "thresholds", "must be finite", threshold)
    check_threshold(circuit, threshold)
    if threshold > circuit.readable_nats[1]:
        raise InputError(
            f"{circuit.name} resolves no OUT above {circuit.readable_nats[1]:.3g} "
            f"{circuit.unit}; the threshold is {threshold:.2f} {circuit.unit}",
            "threshold",
        )


def designed(
    observed: Integrator,
    thresholds: Sequence[float] = THRESHOLDS,
    *,
    settled: Integrator | None = None,
    kappa: float = 1.0,
    channels: int = CHANNELS,
    trials: int = 1,
) -> pd.DataFrame:
    """Return decision times of an integrator on designed trials minus those of theories.

    The threshold of each theory is its OUT at the time at which ``settled`` crosses with equal
    competitors, where all differences are 0. OUT is interpolated linearly between readings.
    """
    if isinstance(observed, type) or not hasattr(observed, "run"):
        raise InputError.of("observed", "must be an integrator, such as Msprt()", observed)
    settled = observed if settled is None else settled
    levels = checked_thresholds(thresholds)
    readings = readings_of(settled, levels, channels=channels, kappa=kappa)
    every = designs(channels)
    start_ms = _times(settled, every[0].evidence(readings, kappa=kappa), levels)[:, 0]
    seen = [
        _times(observed, design.evidence(readings, trials=trials, kappa=kappa), levels)
        for design in every
    ]
    latency_ms = row_means(seen[0]) - start_ms
    parts = []
    for name, theory in theories(kappa).items():
        trace = theory.run(every[0].evidence(readings, kappa=kappa))
        at_start = np.interp(start_ms, trace.time_ms, trace.out_nats[0, :, 0])
        for design, times in zip(every, seen, strict=True):
            theory_ms = _times(theory, design.evidence(readings, kappa=kappa), at_start)[:, 0]
            moved = (times - seen[0]) - (theory_ms - start_ms)[:, None]
            value, low, high = _intervals(moved)
            columns = {
                "threshold": levels,
                "design": design.name,
                "held": design.held,
                "theory": name,
                "value": value,
                "low": low,
                "high": high,
                "observed_ms": row_means(times),
                "latency_ms": latency_ms,
                "theory_ms": theory_ms,
                "theory_threshold": at_start,
                "right": np.isfinite(times).mean(axis=1),
            }
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def readings_of(
    settled: Integrator,
    thresholds: Sequence[float] | Array,
    *,
    channels: int = CHANNELS,
    kappa: float = 1.0,
) -> int:
    """Return the readings needed to cross all thresholds in all designs, plus half of them."""
    readings, levels = 32, np.asarray(thresholds, dtype=np.float64)
    while readings <= MOST_READINGS:
        with quiet(RangeWarning):  # the leader rises for longer here than in the actual trials
            last_ms = [
                _times(settled, design.evidence(readings, kappa=kappa), levels, led=False)
                for design in designs(channels)
            ]
        if np.isfinite(last_ms).all():
            return int(1.5 * np.max(last_ms) / STEP_MS) + 4
        readings *= 2
    raise InputError(
        f"OUT of {', '.join(f'{level:g}' for level in levels)} is not reached in "
        f"{MOST_READINGS * STEP_MS / 1000:.0f} s of designed trials: give a higher OUT",
        "thresholds",
    )


def _times(
    integrator: Integrator, evidence: Evidence, thresholds: Array, *, led: bool = True
) -> Array:
    """Return decision times (thresholds, trials), ms; if ``led`` NaN for another choice."""
    parts = []
    for trace in _traces(integrator, evidence, float(thresholds.min())):
        decision = first_crossing(trace, thresholds, forced=False, checked=False)
        times = _between_readings(trace, decision, thresholds)
        parts.append(np.where(decision.choice == 0, times, np.nan) if led else times)
    return np.concatenate(parts, axis=1)


def _traces(integrator: Integrator, evidence: Evidence, lowest: float) -> Iterator[Trace]:
    if not isinstance(integrator, BasalGanglia):
        yield integrator.run(evidence)
        return
    for part, _, trace in integrator.until(lowest - ROUNDING_NATS).batches(evidence):
        yield trace
        advance(part.trials)


def _between_readings(trace: Trace, decision: Decision, thresholds: Array) -> Array:
    """Return threshold crossings, interpolated linearly from the tick before the decision."""
    relative_ms = trace.time_ms - trace.onset_ms
    crossed = np.isfinite(decision.time_ms)
    now = np.searchsorted(relative_ms, np.where(crossed, decision.time_ms, 0.0))
    before = np.maximum(now - 1, 0)
    trial, choice = np.arange(now.shape[1]), np.maximum(decision.choice, 0)
    high, low = trace.out_nats[trial, before, choice], trace.out_nats[trial, now, choice]
    fall = np.where(high > low, high - low, np.inf)
    share = 1 - np.clip((high - thresholds[:, None]) / fall, 0, 1)
    earlier_ms = np.where(np.isinf(fall), 0.0, share * (relative_ms[now] - relative_ms[before]))
    return np.asarray(decision.time_ms - earlier_ms)


def _intervals(moved: Array) -> tuple[Array, Array, Array]:
    """Return means over trials with their 95 % intervals; one trial has no noise."""
    # Importing scipy.stats takes half a second: only when intervals are needed.
    from scipy.stats import t

    known = np.isfinite(moved)
    count = known.sum(axis=1)
    value = np.where(count >= FEWEST_RIGHT * moved.shape[1], row_means(moved), np.nan)
    half = np.zeros(len(moved))
    if moved.shape[1] > 1:
        pairs = zip(moved, known, strict=True)
        spread = np.array([row[ok].std(ddof=1) if ok.sum() > 1 else np.nan for row, ok in pairs])
        half = spread / np.sqrt(count) * t.ppf(0.975, count - 1)
    return value, value - half, value + half


def verdicts(table: pd.DataFrame) -> pd.DataFrame:
    """Return the verdict of a table of designed trials on each theory, with its differences in ms.

    A theory is followed if the whole interval of each difference is within ``CLOSE_MS``, and
    told apart if at each threshold the whole interval of a difference is beyond ``APART_MS``.
    """
    rows = []
    for name, part in table.groupby("theory", sort=False):
        farthest = part[["low", "high"]].abs().max(axis=1)
        one_side = np.sign(part["low"]) == np.sign(part["high"])
        nearest = part[["low", "high"]].abs().min(axis=1).where(one_side, 0.0)
        largest = part["value"].abs().groupby(part["threshold"]).max()
        apart = nearest.groupby(part["threshold"]).max()
        outcome = OPEN
        if part["value"].notna().all() and (farthest <= CLOSE_MS).all():
            outcome = FOLLOWS
        elif (apart > APART_MS).all():
            outcome = APART
        rows.append((name, largest.max(), largest.min(), outcome))
    return pd.DataFrame(rows, columns=["theory", "largest_ms", "least_ms", "outcome"])
