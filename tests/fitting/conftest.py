"""A small group of people, drawn from the sequential test, and its fit."""

from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest

from bgmodel.fit_trials import fit
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.hierarchy import chains, guide
from bgmodel.fitting.person_fit import fit_likelihood
from circuits.errors import FitWarning
from tests.drawn import drawn, rows_of
from tests.helpers import told

PEOPLE = {"anna": 8.0, "ben": 9.0, "cleo": 10.0, "dora": 11.0}
"""Sensitivity of each person."""
FIXED = {"t0_sd_s": 0.05, "lapse": 0.01}
MOST, WARM_UP = 60, 20
SEED = 24_321


def table(people=PEOPLE, trials=60, **columns):
    """Return the trials of people who differ in sensitivity."""
    parts = []
    for number, (who, sensitivity) in enumerate(people.items()):
        values = {"sensitivity": sensitivity, "bound": 0.5}
        some = drawn(GapModel(), [0.2], trials, SEED + number, seconds=1.5, **values)
        block = np.where(np.arange(some.trials) % 4 < 2, "early", "late")
        parts.append(rows_of(some, participant_id=who, block=block, **columns))
    return pd.concat(parts, ignore_index=True)


def fitted_with(words, likelihood):
    """Return a fit, and those of its warnings that have these words."""
    fits = []
    texts = told(lambda: fits.append(fit_likelihood(likelihood)))
    return fits[0], [text for text in texts if words in text]


@contextmanager
def short_chains():
    """Make chains short: that long ones agree is tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chains, "BLOCK", MOST)
        patch.setattr(chains, "WARM_UP", WARM_UP)
        yield


@pytest.fixture
def few_moves(monkeypatch):
    """Propose the end of a hundred moves: after any number of them the posterior is the same."""
    monkeypatch.setattr(guide, "MOVES_OF_ALL", 100)


@pytest.fixture(scope="session")
def group():
    """Return the fit of the group, whose chains are too short to agree."""
    asked = {"strength": "strength", "fix": FIXED, "people": "hierarchical"}
    with short_chains(), pytest.warns(FitWarning, match="have not converged"):
        return fit(table(), "constant_gap", most_draws=MOST, **asked)
