"""Trials of simulated people with more than two alternatives, as tables and as designs."""

import numpy as np
import pandas as pd

from benchmarks.methods.many import person
from bgmodel.fitting.trials.design import design_of

NAMES = np.array(list("abcdefghijkl"))
TRUTH = {"sensitivity": 2.0, "threshold_nats": 0.2}


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
    given = np.where(some.response == 1, right, wrong)
    found = pd.DataFrame({"rt": some.rt_s, "response": NAMES[given], "shown": NAMES[right]})
    return found if some.strength is None else found.assign(contrast=some.strength)
