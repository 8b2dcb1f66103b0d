"""Trials of simulated people with more than two alternatives, as tables and as designs."""

import numpy as np
import pandas as pd

from bgmodel.fitting.design import design_of
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials

NAMES = np.array(list("abcdefghijkl"))
TRUTH = {"sensitivity": 2.0, "threshold_nats": 0.2}

RESPONSE = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}
"""Non-decision time and lapses of all simulated people."""


def person(model, alternatives, strengths, trials, seed, *, seconds=3.0, **values):
    """Return trials drawn from a model, the same number at each strength; one is left out."""
    grid, strength = Grid(round(seconds / BIN_S)), np.array(strengths, float)
    every = {name: np.full(len(strength), x) for name, x in {**RESPONSE, **values}.items()}
    decided = model.decided(every, strength, grid)
    delay = {name: every[name] for name in RESPONSE}
    density = responded(decided, grid, **delay, alternatives=alternatives)
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


def design(model, alternatives, trials, seed=5, strengths=(1.0,)):
    """Return the design of a person who follows a model at ``TRUTH``."""
    return design_of(person(model, alternatives, list(strengths), trials, seed, **TRUTH))


def table(model, alternatives, trials, seed=5, strengths=(1.0,), **values):
    """Return trials as a user's table, with names of responses and of the correct ones."""
    some = person(model, alternatives, list(strengths), trials, seed, **{**TRUTH, **values})
    some = some.where(some.response >= 0)
    rng = np.random.default_rng(seed)
    right = rng.integers(alternatives, size=some.trials)
    wrong = (right + rng.integers(1, alternatives, size=some.trials)) % alternatives
    responses = np.where(some.response == 1, right, wrong)
    rows = pd.DataFrame({"rt": some.rt_s, "response": NAMES[responses], "shown": NAMES[right]})
    return rows if some.strength is None else rows.assign(contrast=some.strength)
