"""Simulated people who choose between more than two alternatives."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bgmodel.fitting.exact.algorithms import Model
from bgmodel.fitting.exact.responses import BIN_S, Grid, responded
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.trials.design import design_of
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials

RESPONSE = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}
"""Non-decision time and lapses of all simulated people."""


def person(
    model: Model,
    alternatives: int,
    strengths: list[float],
    trials: int,
    seed: int,
    *,
    seconds: float = 3.0,
    **values: float,
) -> Trials:
    """Return trials drawn from a model, the same number at each strength.

    Parameters
    ----------
    model : Model
        A model of choices between some number of alternatives.
    alternatives : int
        That number.
    strengths : list of float
        Strengths; one strength is left out of the table.
    trials, seed : int
        Trials at each strength, and the seed.
    seconds : float, s
        Deadline.
    **values : float
        Parameters of the model; those of responses are ``RESPONSE`` by default.
    """
    grid, strength = Grid(round(seconds / BIN_S)), np.array(strengths, float)
    every = {name: np.full(len(strength), x) for name, x in {**RESPONSE, **values}.items()}
    decided = model.decided(every, strength, grid)
    own = {name: every[name] for name in RESPONSE}
    density = responded(decided, grid, **own, alternatives=alternatives)
    rng = stream(seed, "person")
    below = density.reshape(len(strength), -1).cumsum(axis=1)
    below *= BIN_S
    place = np.concatenate([np.searchsorted(each, rng.random(trials)) for each in below])
    missed, count = place >= 2 * grid.bins, len(place)
    response, bins = np.divmod(place, grid.bins)
    return Trials(
        np.full(count, "all"),
        np.where(missed, np.nan, (bins + rng.random(count)) * BIN_S),
        np.where(missed, -1, response).astype(np.int8),
        np.repeat(strength, trials) if len(strength) > 1 else None,
        pd.DataFrame(index=range(count)),
        seconds,
        alternatives=alternatives,
    )


def fitted(choices: Trials, model: Model) -> tuple[Likelihood, Optimum]:
    """Return the likelihood of a person's trials under a model, and its maximum."""
    likelihood = likelihood_of(model, design_of(choices))
    return likelihood, optimum(likelihood, starts=likelihood.starts()[:1])
