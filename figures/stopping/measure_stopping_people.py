"""The stop-signal task in people: estimates, violations, and a stop process in closed form.

The 126 healthy adults of the shipped set are analysed twice: with delays as recorded, where a delay
of 0 means that the signal was never given because the response came first, and with these delays
restored from the staircases. A stop process is fitted to all, by the test and by the circuit, and
to odd and even stop trials to predict the other half. Simulated participants, for whom the model is
right, give the size of each measure that would be expected.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pandas as pd

from bgmodel.fitting.hierarchy.chains import MOST
from bgmodel.fitting.hierarchy.group_fit import GroupFit, fit_group
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.stop_process import FEWEST_GO, go_process, laid
from bgmodel.fitting.stop_race import STRENGTH, StopLikelihood, StopRace, likelihood, stop_model
from bgmodel.stopping.inputs import MOST_NATS
from bgmodel.stopping.people import AFTER, estimates_of, read_people, slowing_of, violations_of
from bgmodel.stopping.trials import StopTrials
from bgmodel.trials.reader import Columns
from circuits.anatomy import DEFAULT
from circuits.arrays import Array
from figures.pieces import Made, Piece, Score
from figures.stopping.stopped import StopValues, like, mean_and_error, predictions

SCORING_SEED = 91_001
"""Seed of simulated participants."""
COARSE = 20
"""Number of participants in the coarse form."""
NUMBERS = ("ssrt_ms", "ssrt_sd_ms", "failures")
"""Parameters of a fit."""
FITS = {"test": (), "test, same in all": NUMBERS, "test, same after stops": (), "circuit": ()}
"""Models, and the parameters that people share in addition to the standard deviation of SSRT."""
STRENGTHS = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Strengths of the stop signal that are tried: quantiles of people's thresholds."""
FALL_NATS, ALIKE_NATS = 1.92, 0.01
"""Fall of the log likelihood at the end of a 95 % interval (half of chi-squared, 1 d.f.), and how
close those of strengths are that count as alike: the strongest of them is reported."""
SETS = 4
"""Number of simulated sets of participants to which the fit is repeated."""
MOST_DRAWS = 1000
"""Largest number of draws of each chain from which the other half of the trials is predicted."""


@cache
def people_of(kind: str, people: int) -> dict[str, StopTrials]:
    """Return the first participants, with delays as recorded, restored or simulated."""
    if kind == "simulated":
        return simulated(people, SCORING_SEED)
    columns = Columns(restore_delays=kind == "restored")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dict(list(read_people(columns=columns).items())[:people])


def simulated(people: int, seed: int) -> dict[str, StopTrials]:
    """Return simulated participants with the parameters of the fit to the restored delays."""
    every = likelihoods_of("test", "restored", people)
    data = {who: laid(each.trials, each.model.slowing_ms) for who, each in every.items()}
    return like(people_of("restored", people), data, true_values(people), seed)


@cache
def true_values(people: int) -> StopValues:
    """Return the stop processes of simulated participants: medians of a posterior."""
    drawn = draws_of(_fit("test", "restored", people))
    return StopValues(*(float(np.median(each)) for each in drawn.values()))


@cache
def go_of(people: int) -> dict[str, dict[str, float]]:
    """Return the go process of each participant."""
    return {
        who: go_process(each.to_trials()) for who, each in people_of("restored", people).items()
    }


def estimates(kind: str, people: int) -> pd.DataFrame:
    """Return pooled estimates: measure, value, error (over participants), people."""
    chosen = people_of(kind, people)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = estimates_of(chosen)
    rows = [(name, *mean_and_error(table[name])) for name in ("go_ms", "ssrt_ms")]
    zero = sum(((t.ssd_ms == 0) & t.responded).sum() for t in chosen.values())
    rows.append(("delays_of_zero", zero, np.nan, len(table)))
    rows += slowing_of(chosen).itertuples(index=False, name=None)
    summary = pd.DataFrame(rows, columns=["measure", "value", "error", "people"])
    return summary.assign(delays=kind)


def violated(kind: str, people: int) -> pd.DataFrame:
    """Return violations of independence by delay."""
    return violations_of(people_of(kind, people)).assign(delays=kind)


def likelihoods_of(name: str, kind: str, people: int) -> dict[str, StopLikelihood]:
    """Return the likelihood of each participant's trials under one of ``FITS``."""
    return likelihoods(name, people_of(kind, people), people)


def likelihoods(
    name: str, chosen: dict[str, StopTrials], people: int, strength: float = MOST_NATS
) -> dict[str, StopLikelihood]:
    """Return likelihoods with the mean slowing after stop trials, for people with go responses."""
    chosen = {
        who: one for who, one in chosen.items() if (one.responded & ~one.stop).sum() >= FEWEST_GO
    }
    race = stop_model(DEFAULT) if name == "circuit" else StopRace()
    table = slowing_of(chosen).set_index("measure")["value"]
    slowing = tuple(float(table[f"after_{each.replace(' ', '_')}_ms"]) for each in AFTER)
    if name == "test, same after stops":
        slowing = (0.0, 0.0)
    go = go_of(people) if name == "circuit" or strength < MOST_NATS else {}
    return {
        who: likelihood(
            replace(race, go=go.get(who, {}), slowing_ms=slowing), one.to_trials(who),
            fixed={STRENGTH: strength},
        )
        for who, one in chosen.items()
    }  # fmt: skip


def draws_of(fit: GroupFit) -> dict[str, Array]:
    """Return draws of the group by name; people differ in the logit of failures."""
    mean, between = (
        dict(zip(NUMBERS, np.moveaxis(each, 2, 0), strict=True))
        for each in (fit.group, fit.between)
    )
    f = mean["failures"]
    return {
        "ssrt_ms": mean["ssrt_ms"], "ssrt_people_sd_ms": between["ssrt_ms"],
        "ssrt_trial_sd_ms": mean["ssrt_sd_ms"], "failures": f,
        "failures_people_sd": between["failures"] / (f * (1 - f)),
    }  # fmt: skip


def fitted(name: str, kind: str, people: int) -> pd.DataFrame:
    """Return the group of a fit to all stop trials, and the strength of the stop signal."""
    fit = _fit(name, kind, people)
    rows = [
        {"parameter": each, "value": np.median(drawn), "error": drawn.std(),
         "low": np.quantile(drawn, 0.025), "high": np.quantile(drawn, 0.975)}
        for each, drawn in draws_of(fit).items()
    ]  # fmt: skip
    if name == "test":
        rows.append(strength(people))
    most = np.array([MOST_NATS])
    every = likelihoods_of(name, kind, people).values()
    latency = float(np.median([each.model.latency_ms(most)[0] for each in every]))
    stops = sum(each.stop.sum() for each in people_of(kind, people).values())
    log = float(fit.log_likelihood.sum(axis=2).mean())
    return pd.DataFrame(rows).assign(
        model=name, delays=kind, log_likelihood=log, people=len(fit.people), stop_trials=stops,
        latency_ms=latency,
    )  # fmt: skip


def strength(people: int) -> dict[str, float | str]:
    """Return the strength of the stop signal from its profile: the best of each person's trials."""
    chosen = people_of("restored", people)
    races = [each.model for each in likelihoods("test", chosen, people, 0.0).values()]
    tried = np.quantile([race.threshold for race in races], STRENGTHS)
    tried = np.unique([0.0, *tried[tried < MOST_NATS], MOST_NATS])[::-1]
    log = np.array([
        sum(
            optimum(each).log_likelihood
            for each in likelihoods("test", chosen, people, at).values()
        )
        for at in tried.tolist()
    ])  # fmt: skip
    inside = tried[log > log.max() - FALL_NATS]
    best = tried[np.argmax(log > log.max() - ALIKE_NATS)]
    return {"parameter": STRENGTH, "value": best, "low": inside.min(), "high": inside.max()}


@cache
def _fit(name: str, kind: str, people: int) -> GroupFit:
    return _grouped(name, likelihoods_of(name, kind, people))


def _grouped(name: str, each: dict[str, StopLikelihood], most: int = MOST) -> GroupFit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fit_group(each, shared=FITS[name] or None, most_draws=most)


def predicted(name: str, kind: str, people: int) -> pd.DataFrame:
    """Return the predictions of each half of the stop trials from the other, in two parts."""
    every, rows = likelihoods_of(name, kind, people), []
    for first, half in enumerate(("odd", "even")):
        stops = {who: np.flatnonzero(np.isfinite(one.trials.ssd_s)) for who, one in every.items()}
        left = {who: each[1 - first :: 2] for who, each in stops.items()}
        some = {
            who: one.part(np.setdiff1d(np.arange(one.trials.trials), left[who]))
            for who, one in every.items()
        }
        parts = predictions(_grouped(name, some, MOST_DRAWS), every, left)
        rows += [table.assign(part=part, half=half) for part, table in parts.items()]
    return pd.concat(rows, ignore_index=True).assign(model=name, delays=kind)


def refitted(people: int, sets: int) -> pd.DataFrame:
    """Return the parameters found in simulated sets of participants, next to the true ones."""
    every = []
    for number in range(sets):
        chosen = simulated(people, SCORING_SEED + number)
        every.append(draws_of(_grouped("test", likelihoods("test", chosen, people))))
    rows = []
    for name, true in vars(true_values(people)).items():
        medians = np.array([np.median(drawn[name]) for drawn in every])
        stated = np.mean([drawn[name].std() for drawn in every])
        sd = medians.std(ddof=1)
        rows.append(
            {"parameter": name, "true": true, "mean": medians.mean(), "error": sd / np.sqrt(sets),
             "sd": sd, "stated": stated, "sets": sets}
        )  # fmt: skip
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the analyses of people, fits, predictions and simulated participants."""
    people = COARSE if fast else 126
    trials = 128 * people
    for kind in ("recorded", "restored"):
        make = partial(estimates, kind, people)
        yield Piece("people", kind, trials, 3, make, of_circuit=False)
    for kind in ("restored", "simulated"):
        make = partial(violated, kind, people)
        yield Piece("delays", kind, trials, 2, make, of_circuit=False)
    for name in FITS:
        make = partial(fitted, name, "restored", people)
        yield Piece("fits", f"{name} restored", trials, 100, make, name == "circuit")
    for name in FITS:
        make = partial(predicted, name, "restored", people)
        yield Piece("predicted", f"{name} restored", trials, 200, make, name == "circuit")
    make = partial(refitted, people, 2 if fast else SETS)
    yield Piece("refitted", "test", trials, 1500, make, of_circuit=False)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the tables of pages."""
    kinds = {"people": "people", "people_delays": "delays", "people_fits": "fits",
             "people_refitted": "refitted"}  # fmt: skip
    every = {name: (kind, made[kind]) for name, kind in kinds.items()}
    fits = made["fits"]
    same = fits["model"].eq("test, same in all") & fits["parameter"].str.contains("people_sd")
    every["people_fits"] = ("fits", fits[~same])
    for part in ("halves", "deciles"):
        rows = made["predicted"]
        rows = rows[rows["part"] == part].dropna(axis=1, how="all").drop(columns="part")
        every[f"people_{part}"] = ("predicted", rows)
    return every


SCORE = Score("stopping", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)
