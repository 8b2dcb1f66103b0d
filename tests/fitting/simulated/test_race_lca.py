"""Leaky competing accumulators: limits, symmetry, and what leak and inhibition do."""

import numpy as np
import pytest

from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated.race import LcaModel, RaceModel

GRID = Grid(150)
TRIALS = 3000
"""Simulated are a quarter of them for each number of alternatives."""
VALUES = {"sensitivity": 2.0, "input": 8.0, "bound": 3.0, "leak": 0.0, "inhibition": 0.0}


def decided(model, strengths=(1.0,), **changed):
    every = {k: np.full(len(strengths), v) for k, v in {**VALUES, **changed}.items()}
    return model.decided(every, np.array(strengths), GRID)


def lca(alternatives=3, **options):
    return LcaModel(alternatives, TRIALS, 7, 1.5, **options)


def means(mass):
    return {name: each[0] for name, each in moments(mass / BIN_S, GRID).items()}


def test_without_leak_and_inhibition_it_is_a_race():
    """Far above 0, where the floor matters only in the first moments."""
    leakless, race = means(decided(lca())), means(decided(RaceModel(3)))
    few = TRIALS // 4
    assert leakless["mean_s"] == pytest.approx(race["mean_s"], abs=4 * race["sd_s"] / few**0.5)
    share = race["accuracy"]
    assert leakless["accuracy"] == pytest.approx(share, abs=4 * (share * (1 - share) / few) ** 0.5)
    assert leakless["sd_s"] == pytest.approx(race["sd_s"], rel=0.1)


@pytest.mark.parametrize("name", ["leak", "inhibition"])
def test_leak_and_inhibition_delay_decisions(name):
    assert means(decided(lca(), **{name: 2.0}))["mean_s"] > 1.2 * means(decided(lca()))["mean_s"]
