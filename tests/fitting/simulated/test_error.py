"""The error of simulated trials: what is stated against what other seeds give."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import EXPONENTIAL, SENSITIVITY, GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.posterior import Directions, directions
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated import error
from bgmodel.fitting.simulated.crossings import simulated
from bgmodel.fitting.simulated.error import (
    Control,
    decided,
    exact,
    jackknifed,
    matched,
    simulation_error,
    without_parts,
)
from bgmodel.integrators.first_passage import GaussianIncrements, walk
from tests.drawn import GAIN, TRUTH, drawn, ideal

pytestmark = pytest.mark.usefixtures("brief_search")
THRESHOLDS = np.log1p(np.exp(-np.linspace(2.0, 0.4, 20)))
PARTS = 12
SEEDS = range(16)


@dataclass(frozen=True)
class Integrator:
    """An ideal integrator that is simulated: its likelihood is known, and it has an error."""

    stored: object
    parts: np.ndarray
    threshold_name = "threshold_nats"
    parameters = (
        SENSITIVITY,
        Parameter("threshold_nats", THRESHOLDS[0], THRESHOLDS[-1], 0.25),
        *RESPONSE,
    )

    def decided(self, values, strength, grid):
        drift = values["sensitivity"] * strength
        part = self.stored.part(self.parts)
        return decided([(part, 1.0)], float(values["threshold_nats"][0]), drift, grid)

    def halves(self):
        return tuple(replace(self, parts=np.array(half)) for half in ([True, False], [False, True]))

    def left_out(self):
        return tuple(replace(self, parts=~left) for left in np.eye(PARTS, dtype=bool))


def integrator(seed):
    return Integrator(
        simulated(ideal, THRESHOLDS, seconds=2.0, trials=120, seed=seed), np.ones(1, dtype=bool)
    )


@pytest.fixture(scope="module")
def fits():
    """Return data that differ from the model, and a fit of each of several stores to them."""
    values = {"sensitivity": 10.0, "bound": 0.7, "fall_per_s": 1.0}
    some = drawn(GapModel(EXPONENTIAL), [0.05, 0.3], 300, 3, seconds=2.0, **values)
    held = {name: TRUTH[name] for name in ("t0_sd_s", "lapse")}
    fitted, starts = [], None
    for seed in SEEDS:
        likelihood = likelihood_of(integrator(seed), design_of(some), fixed=held)
        # Stores differ by little: after the first, a search from its optimum finds theirs.
        best = optimum(likelihood, starts=starts)
        starts = starts or [best.vector]
        there = directions(likelihood, best.vector)
        fitted.append((likelihood, best, there, simulation_error(likelihood, there)))
    return fitted


def ratio(seen, stated):
    return np.std(seen, axis=0, ddof=1) / np.sqrt(np.mean(np.square(stated), axis=0))


def test_the_stated_errors_are_those_between_stores(fits):
    """Of 16 stores the scatter is known within a factor of 1.5."""
    logs = [best.log_likelihood for _, best, _, _ in fits]
    assert ratio(logs, [each.log_likelihood for *_, each in fits]) == pytest.approx(1, abs=0.5)
    vectors = [best.vector for _, best, _, _ in fits]
    assert ratio(vectors, [each.parameters for *_, each in fits]) == pytest.approx(1, abs=0.6)
    assert np.std(logs) > 0.5


def test_one_step_goes_where_a_search_would(fits):
    likelihood, best, there, _ = fits[1]
    left, vector = without_parts(likelihood, there)[0]
    searched = optimum(left, starts=[best.vector])
    errors = there.standard_errors
    assert (vector - searched.vector) / errors == pytest.approx(0, abs=0.12)


def test_a_number_at_its_bound_stays_there_and_its_error_is_unknown(fits):
    """It used to be 0, as if other simulated trials were sure to leave the number there."""
    likelihood, best, there, _ = fits[0]
    high = likelihood.freedom.high
    stuck = replace(there, vector=np.where([True, False, False], high, best.vector))
    assert all(vector[0] == high[0] for _, vector in without_parts(likelihood, stuck))
    errors = simulation_error(likelihood, stuck).parameters
    assert np.isnan(errors).tolist() == [True, False, False]
    assert (errors[1:] > 0).all()


@given(st.lists(st.floats(-50, 50), min_size=3, max_size=40))
def test_the_jackknife_of_a_mean_is_the_standard_error(values):
    """Without one of n values the mean moves by its deviation over n - 1."""
    array = np.array(values)
    means = (array.sum() - array) / (len(array) - 1)
    expected = array.std(ddof=1) / np.sqrt(len(array))
    assert float(jackknifed(means)) == pytest.approx(expected, abs=1e-9)


@dataclass(frozen=True)
class Part:
    """Simulated trials that tilt a hill."""

    tilt: float

    def left_out(self):
        return tuple(Part(tilt) for tilt in np.linspace(-1, 1, 16))


class Range:
    low, high = np.array([-3.0]), np.array([3.0])

    def at_bound(self, vector):
        return np.array([False])


@dataclass(frozen=True)
class Hill:
    """A hill that is far flatter at its top than around it."""

    model: Part
    freedom: Range

    def without_parts(self):
        return [replace(self, model=part) for part in self.model.left_out()]

    def __call__(self, vector):
        x = float(vector[0])
        return self.model.tilt * x - 1e-3 * x**2 - x**4


def test_no_step_ends_downhill_or_beyond_the_range():
    """A Newton step from the flat top would reach 500; the maxima are at (tilt / 4) ** (1 / 3)."""
    top = np.zeros(1)
    moved = without_parts(Hill(Part(0.0), Range()), Directions(["x"], top, np.eye(1)))
    for part, at in moved:
        assert part(at) >= part(top)
        assert abs(at[0]) < 2 * (abs(part.model.tilt) / 4) ** (1 / 3)


BOUNDS = np.linspace(1.2, 0.1, 23)
ODDS = np.linspace(2.2, 0.3, 20)
SETUP = {"seconds": 2.0, "trials": 600, "seed": 5}
GRID = Grid(200)


@pytest.mark.parametrize("v", [0.0, 2.0, -5.0])
@pytest.mark.parametrize("bound", [0.3, 0.9])
def test_the_law_of_a_walk_with_drift_is_that_of_the_exact_chain(bound, v):
    law = exact(bound, 200, (v,))[:, :, 0]
    chain = walk(GaussianIncrements(v * BIN_S, np.sqrt(BIN_S)), -bound, bound, t_max=200)
    ended = chain.steps_pmf[1:].copy()
    ended[-1] -= chain.p_forced
    assert law.sum(axis=1) == pytest.approx(ended, abs=1e-9)
    endless = walk(GaussianIncrements(v * BIN_S, np.sqrt(BIN_S)), -bound, bound)
    assert law[:, 1].sum() == pytest.approx(endless.p_upper, abs=chain.p_forced + 1e-9)


def test_the_excess_of_walks_has_no_mean():
    """Over stores it is 0 within its scatter, whatever bound and lag are taken."""
    excess = []
    for seed in range(40):
        walks = simulated(error.ideal, -BOUNDS, **{**SETUP, "seed": seed, "trials": 60})
        control = Control(walks, np.array([0.0, 0.5, 0.03]), 2.4)
        each = control.excess(1.1, np.array([0.0, 3.0]), 100)
        excess.append(each.reshape(5, 20, 2, 2).sum(axis=1))
    z = np.mean(excess, axis=0) / (np.std(excess, axis=0) / np.sqrt(40) + 1e-6)
    assert np.abs(z).max() < 4
    assert np.std(excess, axis=0).max() > 0.003


def stored(seed, *, controlled):
    """Return what an ideal integrator with log odds of twice the evidence stores."""
    setup = {**SETUP, "seed": seed, "trials": 150}
    crossings = simulated(ideal, np.log1p(np.exp(-ODDS)), **setup)
    if not controlled:
        return crossings
    return replace(crossings, control=matched(crossings, simulated(error.ideal, -BOUNDS, **setup)))


def test_walks_are_matched_to_the_bound_of_the_circuit():
    """Without noise or delay the bound is the log odds over the gain, and the lag is 0."""
    control = stored(1, controlled=True).control
    expected = ODDS / GAIN
    assert np.polyval(control.bound_of_odds, ODDS) == pytest.approx(expected, abs=0.03)
    assert control.lag == pytest.approx(0, abs=0.5)


def test_a_control_keeps_the_mean_and_takes_most_of_the_scatter():
    threshold = float(np.log1p(np.exp(-1.13)))
    law = exact(1.13 / GAIN, 200, (0.0, 3.0)).transpose(2, 1, 0)
    early = {}
    for controlled in (False, True):
        stores = (stored(seed, controlled=controlled) for seed in range(20))
        each = [decided([(one, 1.0)], threshold, [0.0, 3.0], GRID) for one in stores]
        early[controlled] = np.array(each)[:, :, :, :25].sum(axis=3)
    expected = law[:, :, :25].sum(axis=2)
    scatter = {k: v.std(axis=0).mean() for k, v in early.items()}
    assert scatter[True] < 0.4 * scatter[False]
    off = early[True].std(axis=0) / np.sqrt(20)
    assert np.abs(early[True].mean(axis=0) - expected).max() < 4 * off.max() + 0.003
