"""Gains of additions to the sequential test in monkeys and people.

A bias, starts and drifts that vary across trials, and gaps that fall in three shapes are added to
the test with a constant gap, alone and together. Every model is fitted to the same trials.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bgmodel.fitting.algorithms import DRIFT_SD, GAPS, SPREAD, START, STEEPNESS, GapModel
from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import OPTIMUM_SEED, Optimum, optimum
from bgmodel.trials.reader import read_trials
from figures.pieces import Made, Piece, Score

CONSTANT, EXPONENTIAL = "constant gap", "exponential gap"
FULL = "exponential gap, all variability"


class Addition(NamedTuple):
    """A model: name of its gap, parameters that are free in addition, and a model that it contains.

    The search begins at the optimum of that model, with additions at ``BEGUN``.
    """

    gap: str
    free: tuple[str, ...] = ()
    within: str = ""


BEGUN = {START.name: 0.05, SPREAD.name: 0.4, DRIFT_SD.name: 0.8, STEEPNESS.name: 1.5}
"""Values at which the search begins for parameters that the smaller model lacks."""
BOTH = (SPREAD.name, DRIFT_SD.name)
MODELS = {
    CONSTANT: Addition("constant_gap"),
    "start": Addition("constant_gap", (START.name,), CONSTANT),
    "variable start": Addition("constant_gap", (SPREAD.name,), CONSTANT),
    "variable drift": Addition("constant_gap", (DRIFT_SD.name,), CONSTANT),
    EXPONENTIAL: Addition("falling_gap"),
    "hyperbolic gap": Addition("hyperbolic_gap", (), EXPONENTIAL),
    "Weibull gap": Addition("weibull_gap", (), EXPONENTIAL),
    FULL: Addition("falling_gap", BOTH, EXPONENTIAL),
}
"""The models by their names in tables; all but the first have additions."""
FAST = (CONSTANT, "start", "variable drift")
"""Models of the coarse form."""


def fitted(design: Design, added: Addition, smaller: Mapping[str, Optimum]) -> Optimum:
    """Return the optimum of a model for one person's trials, given those of smaller models."""
    model = GapModel(GAPS[added.gap])
    default = [each.name for each in model.parameters if each.free]
    likelihood = likelihood_of(model, design, free=[*default, *added.free])
    if not added.within:
        return optimum(likelihood)
    begun = BEGUN | smaller[added.within].values
    names = zip(likelihood.freedom.names, likelihood.freedom.start, strict=True)
    return optimum(likelihood, starts=[np.array([begun.get(name, at) for name, at in names])])


def person(data: str, who: str, names: tuple[str, ...]) -> pd.DataFrame:
    """Return the fits to one person: the gain of each addition, and its parameters."""
    choices = read_trials(data, strength="coherence", participant=who)
    made: dict[str, Optimum] = {}
    rows: list[dict[str, Any]] = []
    with warnings.catch_warnings():
        # A bias that most models lack is what is measured here.
        warnings.simplefilter("ignore")
        designs = {sides: design_of(choices, sides=sides) for sides in (False, True)}
    for name in names:
        added = MODELS[name]
        made[name] = best = fitted(designs[START.name in added.free], added, made)
        gain = best.log_likelihood - made[CONSTANT].log_likelihood
        more = len(best.vector) - len(made[CONSTANT].vector)
        row = {
            "data": data, "participant": who, "model": name,
            "log_likelihood": best.log_likelihood, "gain_nats": gain,
            "bic_nats": gain - more * np.log(choices.trials) / 2,
        }  # fmt: skip
        rows.append(row | best.values)
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the pieces of the score; threads are not used."""
    names = FAST if fast else tuple(MODELS)
    for data in ("roitman_shadlen_2002", "palmer_huk_shadlen_2005"):
        choices = read_trials(data, strength="coherence")
        for who in choices.people():
            count = int((choices.participant == who).sum())
            yield Piece("people", who, count, 90, partial(person, data, who, names))


def tables(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the one table."""
    return {"worth": ("people", made["people"])}


SCORE = Score("additions", OPTIMUM_SEED, (), pieces, tables, circuit="")
