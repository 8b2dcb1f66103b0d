"""More than two alternatives: parameters recovered, and the test told from a race and an LCA.

People choose at three mixed strengths by the deadline. Parameters of the MSPRT and of the default
circuit are drawn for each simulated person, and the fitted model has other simulated trials. The
expected log likelihood ratio per trial, from many trials of one person who follows the MSPRT,
gives the number of trials for a factor of 10, and for one in 95 % of people. At the latter, 24
people with other trials are fitted by all three models.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache, partial

import numpy as np
import pandas as pd

from benchmarks.methods.many import fitted, person
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel.fitting.alternatives.circuit import ManyCircuitModel
from bgmodel.fitting.alternatives.lca import LcaModel
from bgmodel.fitting.alternatives.msprt import MsprtModel
from bgmodel.fitting.alternatives.race import RaceModel
from bgmodel.fitting.exact.algorithms import Model
from bgmodel.support.seeds import stream
from circuits.anatomy import DEFAULT, load_circuit

SCORING_SEED, EXPECTED_SEED = 47_701, 47_702
"""Seeds of people who are scored, and of the trials behind expected ratios. Tried on seed 5."""
PERSON_SEED = 47_703
"""Seed of the simulated trials of a model that is a person: fits have other ones."""
ALTERNATIVES, STRENGTHS, SECONDS = (3, 4), [0.5, 1.0, 2.0], 3.0
SETS, OBSERVERS = 20, 24
RECOVERED, MANY = 400, 6000
"""Trials at each strength for recovery, and for expected ratios."""
STORED = 8000
"""Simulated trials of a model."""
NEEDED = {3: 549, 4: 678}
"""Trials that the expected ratios imply, rounded up to a multiple of the strengths."""
OBSERVER = {"sensitivity": 2.0, "threshold_nats": 0.15}
"""Parameters of the person whose trials tell models apart."""
RANGES = {
    "msprt": {"sensitivity": (1.5, 3.0), "threshold_nats": (0.08, 0.3)},
    "circuit": {"sensitivity": (1.5, 3.0), "threshold_nats": (0.12, 0.35)},
}
RESPONSES = {"t0_s": (0.25, 0.4), "t0_sd_s": (0.03, 0.07), "lapse": (0.005, 0.03)}
"""Ranges from which parameters of people are drawn."""


@cache
def model(name: str, alternatives: int, seed: int | None = None) -> Model:
    """Return a model, with the seed of fits unless another is given."""
    more = {} if seed is None else {"seed": seed}
    if name == "circuit":
        circuit = load_circuit(DEFAULT, alternatives)
        return ManyCircuitModel(circuit, seconds=SECONDS, trials=STORED, **more)
    if name == "lca":
        return LcaModel(alternatives, STORED, seconds=SECONDS, **more)
    return RaceModel(alternatives) if name == "race" else MsprtModel(alternatives, STORED, **more)


def recovered(name: str, alternatives: int, sets: int) -> pd.DataFrame:
    """Return true and estimated parameters of people who follow a model."""
    rows = []
    for number in range(sets):
        rng = stream(SCORING_SEED, "parameters", name, alternatives, number)
        ranges = {**RANGES[name], **RESPONSES}
        true = {each: float(rng.uniform(*ends)) for each, ends in ranges.items()}
        seed = SCORING_SEED + 1000 * alternatives + number
        follows = model(name, alternatives, PERSON_SEED)
        some = person(follows, alternatives, STRENGTHS, RECOVERED, seed, seconds=SECONDS, **true)
        begun = time.process_time()
        _, found = fitted(some, model(name, alternatives))
        cpu_s = time.process_time() - begun
        for each, value in found.values.items():
            row = (name, alternatives, some.trials, number, each, true[each], value, cpu_s)
            rows.append(row)
    names = ["model", "alternatives", "trials", "person", "parameter", "true", "estimate", "cpu_s"]
    return pd.DataFrame(rows, columns=names)


def ratios(alternatives: int, trials: int, seed: int) -> dict[str, tuple[np.ndarray, int, float]]:
    """Return each model's log likelihood of every trial, its free parameters and time of its fit.

    Of one person who follows the MSPRT, with some number of trials at each strength.
    """
    follows = model("msprt", alternatives, PERSON_SEED)
    some = person(follows, alternatives, STRENGTHS, trials, seed, seconds=SECONDS, **OBSERVER)
    found = {}
    for name in ("msprt", "race", "lca"):
        begun = time.process_time()
        likelihood, best = fitted(some, model(name, alternatives))
        cpu_s = time.process_time() - begun
        found[name] = (likelihood.each(best.vector), len(best.vector), cpu_s)
    return found


def expected(alternatives: int, trials: int) -> pd.DataFrame:
    """Return the expected log likelihood ratio per trial over each rival, and trials needed."""
    found, rows = ratios(alternatives, trials, EXPECTED_SEED + alternatives), []
    for rival in ("race", "lca"):
        apart = found["msprt"][0] - found[rival][0]
        mean, sd = float(apart.mean()), float(apart.std())
        # The mean of the sum minus 1.645 of its standard deviations is ln 10.
        root = (1.645 * sd + np.sqrt((1.645 * sd) ** 2 + 4 * mean * np.log(10))) / (2 * mean)
        error = sd / np.sqrt(len(apart))
        tenfold = np.log(10) / mean
        rows.append((alternatives, rival, len(apart), mean, error, tenfold, root**2))
    names = ["alternatives", "rival", "trials", "per_trial", "error", "tenfold", "needed"]
    return pd.DataFrame(rows, columns=names)


def told(alternatives: int, trials: int, observers: int) -> pd.DataFrame:
    """Return the log likelihood ratio and that of BIC over each rival, of each person."""
    rows = []
    for number in range(observers):
        seed = SCORING_SEED + 1000 * alternatives + 500 + number
        found = ratios(alternatives, trials, seed)
        own, size, _ = found["msprt"]
        for rival in ("race", "lca"):
            each, more, cpu_s = found[rival]
            apart = float((own - each).sum())
            factor = apart + (more - size) / 2 * np.log(len(own))
            rows.append((alternatives, number, rival, len(own), apart, factor, cpu_s))
    names = ["alternatives", "person", "rival", "trials", "ratio", "factor", "cpu_s"]
    return pd.DataFrame(rows, columns=names)


def biases(made: pd.DataFrame) -> pd.DataFrame:
    """Return bias and correlation of each parameter."""
    rows = []
    keys = ["model", "alternatives", "parameter"]
    for key, part in made.groupby(keys, sort=False):
        off = (part["estimate"] - part["true"]) / part["true"].mean()
        error = off.std(ddof=1) / np.sqrt(len(off))
        r = np.corrcoef(part["estimate"], part["true"])[0, 1]
        longest = part["cpu_s"].max()
        rows.append((*key, len(part), part["trials"].iloc[0], off.mean(), error, r, longest))
    names = [*keys, "people", "trials", "bias", "bias_se", "correlation", "cpu_s"]
    return pd.DataFrame(rows, columns=names)


def counted(made: pd.DataFrame) -> pd.DataFrame:
    """Return how often the test is preferred by a factor of 10, without and with BIC's penalty."""
    rows = []
    for (alternatives, rival), part in made.groupby(["alternatives", "rival"], sort=False):
        row = [alternatives, rival, part["trials"].iloc[0], len(part)]
        for name in ("ratio", "factor"):
            own, other = (int((sign * part[name] > np.log(10)).sum()) for sign in (1, -1))
            row += [own, other, len(part) - own - other, part[name].mean()]
        rows.append((*row, part["cpu_s"].max()))
    kinds = [f"{kind}{by}" for by in ("", "_bic") for kind in ("own", "other", "neither", "mean")]
    names = ["alternatives", "rival", "trials", "people", *kinds, "cpu_s"]
    return pd.DataFrame(rows, columns=names)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield recovery by both models, expected ratios, and people at the number of trials needed."""
    for n in ALTERNATIVES:
        sets, many, people = (2, 500, 2) if fast else (SETS, MANY, OBSERVERS)
        make = partial(expected, n, many)
        yield Piece("expected", f"{n}", many * len(STRENGTHS), 100, make)
        for name in RANGES:
            make = partial(recovered, name, n, sets)
            trials = RECOVERED * len(STRENGTHS) * sets
            yield Piece("recovered", f"{name} {n}", trials, 60 + 8 * sets, make)
        make = partial(told, n, NEEDED[n] // len(STRENGTHS), people)
        yield Piece("told", f"{n}", NEEDED[n] * people, 30 * people, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return expected ratios, biases and preferences."""
    return {
        "expected": ("expected", made["expected"]),
        "recovered": ("recovered", biases(made["recovered"])),
        "told": ("told", counted(made["told"])),
    }


SCORE = Score("many", SCORING_SEED, ALTERNATIVES, pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
