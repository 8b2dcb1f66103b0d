"""A Simon task of patients on and off medication: predictions from dopamine, and results.

Predictions are in ``medication.toml``, committed before people were analysed, from another seed
than the simulated people here. The response deadline of training was 0.8 s in most sessions and
about 1.5 s in others, in three patients only in one of the two. Results are therefore those of
people with 0.8 s in all their sessions. Those of everyone, and of people whose sessions have the
same deadline, are in the tables too. After a first analysis the latter were added, and intervals
were widened to those of ``figures.dopamine.simon``: shuffled labels had shown them to be too
narrow, excluding 0 in 7 % of cases. A brief input of the location was added then too: it is no
prediction.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial

import numpy as np
import pandas as pd
from scipy.stats import norm

from bgmodel import stream
from bgmodel.trials.files import SIMON_SET, shipped_table
from circuits.errors import require
from figures.dopamine.simon import between, by_order, means, named, of_people, within
from figures.dopamine.simon_model import CIRCUIT, Simon
from figures.dopamine.simon_predictions import (
    CONTROLS,
    KINDS,
    MAIN,
    OFF_CONTROLS,
    ON_CONTROLS,
    ON_OFF,
    SESSIONS,
    contrasts,
    models,
    told,
)
from figures.pieces import Made, Piece, Score

SCORING_SEED = 92_001
"""Seed of simulated people, bootstrap and shuffles."""
SIMULATED, COARSE = 200, 20
DEADLINE_S = 0.81
"""Sessions with no later response in training had the deadline of 0.8 s."""
WHO = ONE_DEADLINE, EQUAL, EVERYONE = ("0.8 s", "equal", "all")
"""People with 0.8 s in all their sessions, with the same deadline in all of them, and everyone."""
LATER = Simon(0.479, 1.014, 0.78, 1.0, 340.0, "brief")
"""Parameters of a brief input of the location, fitted to the same means as the others."""
SHUFFLES, COARSE_SHUFFLES = 200, 20


def of_deadline(trials: pd.DataFrame, who: str) -> pd.DataFrame:
    """Return the trials of some people, one of ``WHO``, by the deadlines of their sessions."""
    require(who in WHO, "who", f"must be one of {', '.join(WHO)}", who)
    training = trials[trials["phase"] == "training"]
    late = training.groupby(["participant_id", "session"])["rt"].max() > DEADLINE_S
    by = late.groupby("participant_id")
    kept = {ONE_DEADLINE: ~by.any(), EQUAL: by.nunique() == 1, EVERYONE: by.size() > 0}[who]
    return trials[trials["participant_id"].isin(kept.index[kept])]


@cache
def measured(who: str) -> pd.DataFrame:
    """Return the measures of people, one row per session."""
    return of_people(of_deadline(shipped_table(SIMON_SET)[0], who))


def found(each: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Return all contrasts of people, as from ``of_people``, with 95 % intervals over people."""
    names = named(each)
    off, on, controls = (each[each["medication"] == m][names] for m in ("off", "on", "none"))
    patients = each[each["medication"] != "none"]
    later = within(patients, "session", 2, 1)
    first = patients[patients["session"] == 1].set_index("participant_id")["medication"]
    parts = {
        CONTROLS: means(controls, rng),
        "off": means(off, rng),
        "on": means(on, rng),
        ON_OFF: means(within(patients, "medication", "on", "off"), rng),
        OFF_CONTROLS: between(off, controls, rng),
        ON_CONTROLS: between(on, controls, rng),
        SESSIONS: by_order(later, (first[later.index] == "on").to_numpy(), rng),
    }
    tables = [part.assign(contrast=name) for name, part in parts.items()]
    return pd.concat(tables, ignore_index=True)


def people(who: str) -> pd.DataFrame:
    """Return the contrasts of people."""
    return found(measured(who), stream(SCORING_SEED, "people", who)).assign(who=who)


def circuit(kind: str, simulated: int) -> pd.DataFrame:
    """Return the contrasts of simulated people, at each level of dopamine off medication."""
    simon = LATER if kind == LATER.kind else told().of(kind)
    rows = contrasts(models(simon, simulated, SCORING_SEED, tested=kind == MAIN))
    return rows.dropna().assign(kind=kind, people=simulated)


def shuffled(shuffles: int) -> pd.DataFrame:
    """Return how often intervals of on minus off exclude 0 if labels are exchanged at random."""
    each = measured(ONE_DEADLINE)
    change = within(each[each["medication"] != "none"], "medication", "on", "off")
    rng = stream(SCORING_SEED, "shuffled")
    tables = []
    for _ in range(shuffles):
        sign = pd.Series(rng.choice([-1.0, 1.0], len(change)), index=change.index)
        tables.append(means(change.mul(sign, axis=0), rng))
    every = pd.concat(tables)
    every["excluded"] = (every["low"] > 0) | (every["high"] < 0)
    by = every.groupby("measure", sort=False)
    shares = by.agg(excluded=("excluded", "mean"), value=("value", "mean")).reset_index()
    return shares.assign(shuffles=shuffles)


def outcomes(table: pd.DataFrame) -> pd.DataFrame:
    """Return each prediction with the value in people, and the outcome."""
    rows = []
    by = {(r["who"], r["contrast"], r["measure"]): r for r in table.to_dict("records")}
    for each in told().predictions:
        for who in WHO:
            data = by[who, each.contrast, each.measure]
            about = {"kind": each.kind, "contrast": each.contrast, "measure": each.measure,
                     "printed": each.printed, "who": who, "sign": each.sign}  # fmt: skip
            about |= {"predicted": each.value, "predicted_low": each.low}
            about |= {"predicted_high": each.high}
            about |= {name: data[name] for name in ("value", "low", "high", "people")}
            about |= {"power": power(each.value, data["low"], data["high"])}
            rows.append(about | {"outcome": each.outcome(data["low"], data["high"])})
    return pd.DataFrame(rows)


def power(value: float, low: float, high: float) -> float:
    """Return how often intervals of this width exclude 0 if the mean is ``value``."""
    error = (high - low) / (2 * norm.ppf(0.975))
    return float(norm.sf(norm.ppf(0.975) - abs(value) / error)
                 + norm.sf(norm.ppf(0.975) + abs(value) / error))  # fmt: skip


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield people, shuffled labels, and the circuit with each course of the location's input."""
    trials = len(shipped_table(SIMON_SET)[0])
    for who in WHO:
        yield Piece("people", who, trials, 6, partial(people, who))
    shuffles = COARSE_SHUFFLES if fast else SHUFFLES
    yield Piece("shuffled", "labels", trials, 0.06 * shuffles, partial(shuffled, shuffles))
    simulated = COARSE if fast else SIMULATED
    for kind in (*KINDS, LATER.kind):
        seconds = (1.2 if kind == MAIN else 0.4) * simulated
        make = partial(circuit, kind, simulated)
        yield Piece("circuit", kind, 376 * simulated, seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the tables of the pages."""
    every = {kind: (kind, made[kind]) for kind in ("people", "circuit", "shuffled")}
    return every | {"outcomes": ("people", outcomes(made["people"]))}


SCORE = Score("medication", SCORING_SEED, (2,), pieces, tables, circuit=CIRCUIT)
