"""The race of independent accumulators against integrals and symmetry."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import invgauss

from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated.race import LcaModel, RaceModel, arrived

GRID = Grid(400)
VALUES = {"sensitivity": 2.0, "input": 1.0, "bound": 0.8}


def decided(alternatives, grid=GRID, **values):
    every = {name: np.array([value]) for name, value in {**VALUES, **values}.items()}
    return RaceModel(alternatives).decided(every, np.ones(1), grid)[0]


def wald(drift):
    """Return an inverse Gaussian: bound 0.8, noise of variance 1/2 per second."""
    shape = 0.8**2 / 0.5
    return invgauss((0.8 / drift) / shape, scale=shape)


@pytest.mark.parametrize("side", [0, 1])
def test_the_mass_of_a_bin_is_the_integral_of_the_density(side):
    right, wrong = wald(3.0), wald(1.0)

    def density(t):
        if side:
            return right.pdf(t) * wrong.sf(t) ** 3
        return 3 * wrong.pdf(t) * wrong.sf(t) ** 2 * right.sf(t)

    mass = decided(4)[side]
    for k in (10, 20, 60):
        assert mass[k] == pytest.approx(quad(density, k * BIN_S, (k + 1) * BIN_S)[0], rel=1e-3)


@pytest.mark.parametrize("alternatives", [2, 3, 12])
def test_what_is_not_decided_survives_in_all_accumulators(alternatives):
    mass = decided(alternatives, Grid(40)).sum()
    end = np.array([0.0, 0.4])
    right, wrong = (arrived(end, v, np.array([[0.8]]))[0, 1] for v in (3.0, 1.0))
    assert mass == pytest.approx(1 - (1 - right) * (1 - wrong) ** (alternatives - 1), abs=1e-4)


def test_an_accumulator_without_drift_arrives_in_the_end_with_a_heavy_tail():
    late = arrived(np.array([0.0, 1.0, 1e6]), np.array([[0.0]]), np.array([[0.8]]))[0]
    assert late[0] == 0
    assert late[2] == pytest.approx(1, abs=0.01)


SHORT = Grid(150)
TRIALS = 3000
"""Simulated are a quarter of them for each number of alternatives."""
LCA = {"sensitivity": 2.0, "input": 8.0, "bound": 3.0, "leak": 0.0, "inhibition": 0.0}


def means(model=None, **changed):
    """Return the moments of a model, by default of leaky competing accumulators."""
    every = {name: np.array([value]) for name, value in {**LCA, **changed}.items()}
    mass = (model or LcaModel(3, TRIALS, 7, 1.5)).decided(every, np.ones(1), SHORT)
    return {name: each[0] for name, each in moments(mass / BIN_S, SHORT).items()}


def test_without_leak_and_inhibition_it_is_a_race():
    """Far above 0, where the floor matters only in the first moments."""
    leakless, race = means(), means(RaceModel(3))
    few, share = TRIALS // 4, race["accuracy"]
    assert leakless["mean_s"] == pytest.approx(race["mean_s"], abs=4 * race["sd_s"] / few**0.5)
    assert leakless["accuracy"] == pytest.approx(share, abs=4 * (share * (1 - share) / few) ** 0.5)
    assert leakless["sd_s"] == pytest.approx(race["sd_s"], rel=0.1)


@pytest.mark.parametrize("name", ["leak", "inhibition"])
def test_leak_and_inhibition_delay_decisions(name):
    assert means(**{name: 2.0})["mean_s"] > 1.2 * means()["mean_s"]
