"""Stop signals in the default circuit: closed form and inhibition function.

The circuit stops in closed form: a signal of A nats to STN adds its step response c(t) to OUT, so
that a full run can be predicted from the same trial without a signal. Evaluated on seeds that
tuned nothing; delays were chosen on other seeds, so that 0.2 to 0.8 of the stop trials are
answered. The comparison with the ideal observer and with people is in ``stops``.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from bgmodel.deciding.decision import first_crossing
from bgmodel.stopping.inputs import StopSignal, closed_form, step_response
from circuits.anatomy import DEFAULT
from circuits.arrays import Array
from figures.pieces import Piece, Score
from figures.stopping.observer import SHARE, by_tone, decisions, observed, paired
from figures.stopping.relative import people
from figures.stopping.runs import (
    POSTERIOR,
    SCORING_SEED,
    STEP_MS,
    STEPS,
    agreement,
    evidence_of,
    go_times,
    model_of,
    nth,
    pulse,
    response_times,
    share,
    stop_times,
)

CASES = (
    StopSignal(amount_nats=0.3), StopSignal(amount_nats=0.5), StopSignal(amount_nats=1.0),
    pulse(100.0, amount_nats=1.0),
)  # fmt: skip
"""Signals of the closed form: held for good, and a pulse."""
SSD_MS = {2: 300.0, 4: 800.0}
"""Delay of the closed form, by the number of alternatives."""
DELAYS_MS = np.arange(50.0, 551.0, 50.0)
"""Delays of the inhibition functions."""
OBSERVED_SHARE = 0.25
"""Share of stop trials that the ideal observer expects in its inhibition function."""
FEWEST = 20
"""Fewest failed and successful stops for a time."""


def closed_forms(channels: int, engine: str, trials: int) -> pd.DataFrame:
    """Return how often full runs and the closed form have the same outcome, for each signal."""
    evidence = evidence_of("closed form", trials, channels)
    model, ssd = model_of(channels, engine), SSD_MS[channels]
    level = model.threshold(None, POSTERIOR)
    end = STEP_MS * (STEPS + 1)
    added = [step_response(model, signal, time_ms=end)[1] for signal in CASES]
    predicted: list[list[np.ndarray]] = [[] for _ in CASES]
    for _, _, trace in model.batches(evidence):
        delays = np.full(len(trace.out_nats), ssd)
        for signal, c, parts in zip(CASES, added, predicted, strict=True):
            with_signal = closed_form(trace, delays, signal, c)
            made = first_crossing(with_signal, level, forced=False, checked=False)
            parts.append(response_times(made, channels))
    rows = []
    for signal, parts in zip(CASES, predicted, strict=True):
        full, closed = stop_times(model, evidence, ssd, signal, level), np.concatenate(parts)
        shown = {"p_respond": (~np.isnan(full)).mean(), "p_closed": (~np.isnan(closed)).mean()}
        rows.append(
            {"alternatives": channels, "engine": engine, "amount_nats": signal.amount_nats,
             "duration_ms": signal.duration_ms, "ssd_ms": ssd, "trials": trials}
            | shown | agreement(full, closed)
        )  # fmt: skip
    return pd.DataFrame(rows)


def inhibition(trials: int) -> pd.DataFrame:
    """Return the inhibition functions of the circuit, the ideal observer and an independent race.

    All delays have the same evidence and noise, and the go times are those without any signal. The
    race takes the circuit's go times and one stop-signal reaction time, the circuit's own.
    """
    evidence, model = evidence_of("inhibition", trials), model_of()
    went = go_times(model, evidence)
    parts = []
    for amount in (1.0, 0.3):
        signal = StopSignal(amount_nats=amount)
        stopped = [stop_times(model, evidence, ssd, signal) for ssd in DELAYS_MS]
        unit = "nat" if amount == 1 else "nats"
        parts.append(by_delay(f"circuit, {amount:g} {unit}", went, stopped))
    late = parts[0].loc[parts[0]["ssd_ms"] >= 200, "ssrt_ms"].mean()
    beaten = [np.where(went < ssd + late, went, np.nan) for ssd in DELAYS_MS]
    parts.append(by_delay("race", went, beaten))
    observer = [
        response_times(decisions(observed(evidence, np.full(trials, ssd), OBSERVED_SHARE, "stop",
                                          DELAYS_MS), model.gain), 2)
        for ssd in (np.nan, *DELAYS_MS)
    ]  # fmt: skip
    parts.append(by_delay("ideal observer", observer[0], observer[1:]))
    return pd.concat(parts, ignore_index=True)


def by_delay(decider: str, went: Array, stopped: list[Array]) -> pd.DataFrame:
    """Return the inhibition function, one row per delay."""
    rows = []
    for ssd, times in zip(DELAYS_MS, stopped, strict=True):
        p = share(~np.isnan(times))
        made = times[~np.isnan(times)]
        row = {"decider": decider, "ssd_ms": ssd, "trials": len(times)} | p
        some = FEWEST <= len(made) <= len(times) - FEWEST
        for end in ("", "_low", "_high"):
            row[f"ssrt_ms{end}"] = nth(went, p[f"p_respond{end}"]) - ssd if some else np.nan
        row["failed_ms"] = made.mean() if some else np.nan
        row["failed_se"] = made.std() / np.sqrt(len(made)) if some else np.nan
        shown = {"go_ms": np.nanmean(went), "go_median_ms": np.nanmedian(went)}
        rows.append(row | shown | {"go_sd_ms": np.nanstd(went)})
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the closed form in spikes, the inhibition functions by populations, and the rest.

    Estimates are CPU times; the number of workers changes nothing.
    """
    fewer = 10 if fast else 1
    trials = 2000 // fewer
    for channels in (2, 4):
        make = partial(closed_forms, channels, "spikes", trials)
        name = f"N = {channels}, spikes"
        yield Piece("closed_form", name, trials, 0.09 * channels * trials, make)
    few = 4000 // fewer
    yield Piece("inhibition", "delays", few, 0.012 * few, partial(inhibition, few))
    yield from _of_observer(few, fewer)
    yield Piece("relative", "people", 0, 2, people)


def _of_observer(trials: int, fewer: int) -> Iterator[Piece]:
    """Yield the pieces with the ideal observer."""
    spikes = 1000 // fewer
    make = partial(paired, 2, "spikes", SHARE, spikes)
    yield Piece("paired", f"N = 2, share {SHARE:g}, spikes", spikes, 0.1 * spikes, make)
    yield Piece(
        "tone", "population", trials, 0.004 * trials, partial(by_tone, "population", trials)
    )


SCORE = Score("stopping", SCORING_SEED, (2, 4), pieces, circuit=DEFAULT)
