"""The stop-signal task in people: estimates, violations, and a stop process in closed form.

The 126 healthy adults of the shipped set are analysed twice: with delays as recorded, where a delay
of 0 means that the signal was never given because the response came first, and with these delays
restored from the staircases. A stop process is fitted to all, by the test and by the circuit, and
to odd and even stop trials to predict the other half. Simulated participants, for whom the model is
right, give the size of each measure that would be expected; others have a known stop-signal
reaction time.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache, partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.fitting.stops.data import go_processes
from bgmodel.fitting.stops.fit import StopFit, fit_stops
from bgmodel.fitting.stops.likelihood import StopValues
from bgmodel.fitting.stops.model import TEST, StopModel, circuit_stop
from bgmodel.fitting.stops.prediction import Prediction, halves
from bgmodel.stopping.estimates import estimate_ssrt, fit_race
from bgmodel.stopping.people import estimates_of, read_people
from bgmodel.stopping.restored import restored_delays
from bgmodel.stopping.trials import StopTrials
from bgmodel.stopping.violations import slowing_of, violations_of
from circuits.anatomy import DEFAULT
from figures.pieces import Made, Piece, Score, main
from figures.stopping.stopped import (
    counted_ssrt,
    known_people,
    late_delays,
    like,
    mean_and_error,
    sequence,
    slopes,
)

SCORING_SEED = 91_001
"""Seed of simulated participants."""
COARSE = 20
"""Number of participants in the coarse form."""
KINDS = ("recorded", "restored", "simulated")
"""Delays as in the set, restored, and those of simulated participants."""
FITS = {
    "test": (TEST, {}),
    "test, same in all": (TEST, {"spread": False}),
    "test, same after stops": (TEST, {"slowed": False}),
    "test, with times": (TEST, {"times": True}),
    "circuit": (None, {}),
}
"""Models and the options of their fits; None is the default circuit."""
KNOWN = StopValues(220.0, 0.0, 20.0, 0.0, 0.0)
"""The stop process of simulated participants whose stop-signal reaction time is known."""
SETS = 12
"""Number of simulated sets of participants to which the fit is repeated."""
SIMULATED, GO, STOPS = 40, 300, 100
"""Their number, and the numbers of go and stop trials."""


@cache
def people_of(kind: str, people: int) -> dict[str, StopTrials]:
    """Return the first participants, with delays of a kind."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        every = dict(list(read_people().items())[:people])
    if kind == "recorded":
        return every
    if kind == "simulated":
        return simulated(people, SCORING_SEED)
    return {who: restored_delays(trials) for who, trials in every.items()}


def simulated(people: int, seed: int) -> dict[str, StopTrials]:
    """Return simulated participants with the parameters of the fit to the restored delays."""
    fit = right(people)
    return like(people_of("restored", people), fit.likelihood.data, fit.values, seed)


@cache
def right(people: int) -> StopFit:
    """Return the fit whose parameters simulated participants have."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fit_stops(people_of("restored", people), go=unknown(people))


@cache
def go_of(people: int) -> pd.DataFrame:
    """Return the go process of each participant."""
    return go_processes(people_of("restored", people))


def unknown(people: int) -> pd.DataFrame:
    """Return unknown go processes: only stop signals that block are then fitted."""
    names = list(people_of("recorded", people))
    return pd.DataFrame({"participant_id": names, "sensitivity": np.nan, "bound": np.nan})


def estimates(kind: str, people: int) -> pd.DataFrame:
    """Return pooled estimates: measure, value, error (over participants), people."""
    chosen = people_of(kind, people)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = estimates_of(chosen)
    ssrt = table["ssrt_ms"].dropna()
    again = [counted_ssrt(chosen[who]) for who in table.loc[ssrt.index, "participant_id"]]
    names = ("go_ms", "failed_ms", "ssd_ms", "p_respond", "omissions", "ssrt_ms", "ssrt_mean_ms")
    rows = [(name, *mean_and_error(table[name])) for name in names]
    rows.append(("failed_minus_go_ms", *mean_and_error(table["failed_ms"] - table["go_ms"])))
    spread = float(ssrt.std())
    rows.append(("ssrt_sd_ms", spread, spread / np.sqrt(2 * len(ssrt) - 2), len(ssrt)))
    apart = float(np.abs(ssrt.to_numpy() - again).max())
    rows.append(("ssrt_apart_ms", apart, np.nan, len(ssrt)))
    rows.append(("refused", (table["refusal"] != "").sum(), np.nan, len(table)))
    zero = sum(((t.ssd_ms == 0) & t.responded).sum() for t in chosen.values())
    rows.append(("delays_of_zero", zero, np.nan, len(table)))
    if kind == "recorded":
        rows.append(("late_delays", *mean_and_error(late_delays(chosen))))
    rows.append(("inhibition_slope", *mean_and_error(slopes(chosen))))
    shuffled = slopes(chosen, stream(SCORING_SEED, "shuffled"))
    rows.append(("inhibition_slope_shuffled", *mean_and_error(shuffled)))
    rows += slowing_of(chosen).itertuples(index=False, name=None)
    order = sequence(chosen)
    rows += [(str(name), *mean_and_error(order[name])) for name in order]
    found = pd.DataFrame(rows, columns=["measure", "value", "error", "people"])
    return found.assign(delays=kind)


def violated(kind: str, people: int) -> pd.DataFrame:
    """Return violations of independence by delay."""
    return violations_of(people_of(kind, people)).assign(delays=kind)


def fitted(name: str, kind: str, people: int) -> pd.DataFrame:
    """Return the parameters of a fit to all stop trials."""
    fit = _fit(name, kind, people)
    found = fit.parameters().assign(model=name, delays=kind, log_likelihood=fit.log_likelihood)
    latency = np.median(fit.likelihood.latency_ms(fit.values.strength_nats))
    thresholds = fit.likelihood.thresholds
    return found.assign(
        latency_ms=latency, threshold_median=np.median(thresholds), threshold_most=thresholds.max(),
        people=len(fit.likelihood.data.names), stop_trials=len(fit.likelihood.data.ssd_ms),
    )  # fmt: skip


def _fit(name: str, kind: str, people: int) -> StopFit:
    model, options = FITS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fit_stops(people_of(kind, people), _model(model), go=go_of(people), **options)


def _model(model: StopModel | None) -> StopModel:
    return circuit_stop(DEFAULT) if model is None else model


def predicted(name: str, kind: str, people: int) -> pd.DataFrame:
    """Return the predictions of each half of the stop trials from the other, in three parts."""
    model, options = FITS[name]
    go = go_of(people) if model is None else unknown(people)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = halves(people_of(kind, people), _model(model), go=go, **options)
    rows = [_parts(half, prediction) for half, (_, prediction) in found.items()]
    return pd.concat(rows, ignore_index=True).assign(model=name, delays=kind)


def _parts(half: str, found: Prediction) -> pd.DataFrame:
    """Return summary, deciles and times of a prediction, told apart by the column part."""
    names = ("bias", "chi2", "p", "largest", "late_ms")
    summary = pd.DataFrame([{name: getattr(found, name) for name in names}])
    parts = {"halves": summary, "deciles": found.deciles, "times": found.times}
    every = [table.assign(part=part, half=half) for part, table in parts.items()]
    return pd.concat(every, ignore_index=True)


def refitted(people: int, sets: int) -> pd.DataFrame:
    """Return the parameters found in simulated sets of participants, next to the true ones."""
    values, errors = [], []
    for number in range(sets):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fit = fit_stops(simulated(people, SCORING_SEED + number), go=unknown(people))
        values.append([getattr(fit.values, name) for name in fit.errors])
        errors.append(list(fit.errors.values()))
    found = np.array(values)
    true = right(people)
    return pd.DataFrame(
        {"parameter": list(true.errors), "true": [getattr(true.values, n) for n in true.errors],
         "mean": found.mean(axis=0), "error": found.std(axis=0, ddof=1) / np.sqrt(sets),
         "sd": found.std(axis=0, ddof=1), "stated": np.mean(errors, axis=0), "sets": sets}
    )  # fmt: skip


def recovered(failures: float, people: int) -> pd.DataFrame:
    """Return the bias of estimators for participants with a known stop-signal reaction time."""
    values = StopValues(KNOWN.ssrt_ms, 0.0, KNOWN.ssrt_trial_sd_ms, failures, 0.0)
    found: dict[str, list[float]] = {"integration": [], "mean": [], "likelihood": []}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for trials in known_people(SCORING_SEED, people, GO, STOPS, values).values():
            estimate = estimate_ssrt(trials, checked=False)
            found["integration"].append(estimate.ssrt_ms)
            found["mean"].append(estimate.ssrt_mean_ms)
            found["likelihood"].append(fit_race(trials)["ssrt_ms"])
    rows = []
    for method, each in found.items():
        mean, error, count = mean_and_error(np.array(each))
        apart = {"bias_ms": mean - KNOWN.ssrt_ms, "error": error, "sd_ms": float(np.std(each))}
        rows.append({"failures": failures, "method": method, **apart, "people": count})
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the analyses of people, fits, predictions and simulated participants."""
    people = COARSE if fast else 126
    trials = 128 * people
    for kind in KINDS:
        yield Piece("people", kind, trials, 3, partial(estimates, kind, people))
        yield Piece("delays", kind, trials, 2, partial(violated, kind, people))
    for name, kind in (*((name, "restored") for name in FITS), ("test", "recorded")):
        make = partial(fitted, name, kind, people)
        yield Piece("fits", f"{name} {kind}", trials, 40, make)
    for name, kind in (*((name, "restored") for name in FITS), ("test", "simulated")):
        make = partial(predicted, name, kind, people)
        yield Piece("predicted", f"{name} {kind}", trials, 40, make)
    make = partial(refitted, people, 2 if fast else SETS)
    yield Piece("refitted", "test", trials, 60, make)
    some = COARSE if fast else SIMULATED
    for failures in (0.0, 0.1):
        make = partial(recovered, failures, some)
        yield Piece("simulated", f"failures {failures:g}", some * (GO + STOPS), 20, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the tables of pages."""
    found = {"people": "people", "people_delays": "delays", "people_fits": "fits",
             "people_simulated": "simulated", "people_refitted": "refitted"}  # fmt: skip
    every = {name: (kind, made[kind]) for name, kind in found.items()}
    for part in ("halves", "deciles", "times"):
        rows = made["predicted"]
        rows = rows[rows["part"] == part].dropna(axis=1, how="all").drop(columns="part")
        every[f"people_{part}"] = ("predicted", rows)
    return every


SCORE = Score("stopping", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
