"""Shapes of the gap: their equations, limits, mass, and one record each."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import (
    CONSTANT,
    EXPONENTIAL,
    FALL,
    FLOOR,
    GAPS,
    STEEPNESS,
    WEIBULL,
    GapModel,
)
from bgmodel.fitting.responses import Grid
from bgmodel.support.saved import packed, unpacked

pytestmark = pytest.mark.usefixtures("brief_search")
FALLING = [gap for gap in GAPS.values() if gap is not CONSTANT]
EACH = pytest.mark.parametrize("gap", FALLING, ids=lambda gap: gap.name)
GRID, STRENGTHS = Grid(400), np.array([-0.3, 0.0, 0.2])
VALUES = st.fixed_dictionaries(
    {
        FALL.name: st.floats(0.05, FALL.high),
        STEEPNESS.name: st.floats(STEEPNESS.low, STEEPNESS.high),
        FLOOR.name: st.floats(FLOOR.low, FLOOR.high),
    }
)


def decided(gap, **values):
    every = {name: np.full(3, value) for name, value in {"sensitivity": 9.0, **values}.items()}
    return GapModel(gap).decided(every, STRENGTHS, GRID)


@EACH
@given(VALUES, st.floats(0.2, 4.0))
@settings(max_examples=30)
def test_a_gap_falls_from_the_bound_to_its_floor_with_the_slope_of_its_times(gap, values, bound):
    times = np.concatenate([[1e-9], np.linspace(0.01, 3.0, 200), [1e6]])
    at, slope = gap.at(bound, values, times)
    assert at[0] == pytest.approx(bound, rel=1e-6)
    assert at[-1] == pytest.approx(bound * values[FLOOR.name], abs=1e-4 * bound)
    assert (np.diff(at) <= 1e-12).all()
    later, _ = gap.at(bound, values, times + 1e-6)
    sooner, _ = gap.at(bound, values, times - 1e-9 * (times > 1))
    assert slope[1:-1] == pytest.approx((later - at)[1:-1] / 1e-6, abs=2e-3 * bound)
    assert (sooner >= at).all()


def test_the_equations_at_the_time_that_the_rate_sets():
    """At 1 / rate: 1/e, 1/2, and 1/e for any exponent; with a floor of a half, halfway to it."""
    values, time = {FALL.name: 2.0, STEEPNESS.name: 3.0}, np.array([0.5])
    for name, left in {
        "falling_gap": np.exp(-1),
        "hyperbolic_gap": 0.5,
        "weibull_gap": np.exp(-1),
    }.items():
        (at,), _ = GAPS[name].at(1.2, values, time)
        assert at == pytest.approx(1.2 * left)
        (at,), _ = GAPS[name].at(1.2, {**values, FLOOR.name: 0.5}, time)
        assert at == pytest.approx(1.2 * (0.5 + 0.5 * left))


def test_a_weibull_gap_of_exponent_1_is_the_exponential_one():
    for floor in (0.0, 0.4):
        same = {"bound": 1.1, "fall_per_s": 1.3, "floor": floor, "start": 0.2}
        weibull = decided(WEIBULL, **same, fall_shape=1.0)
        assert weibull == pytest.approx(decided(EXPONENTIAL, **same), abs=1e-14)
        assert np.abs(decided(WEIBULL, **same, fall_shape=2.0) - weibull).max() > 1e-3


@EACH
def test_a_gap_that_does_not_fall_is_constant(gap):
    same = {"bound": 0.8, "fall_shape": 2.0, "start": 0.3}
    constant = decided(CONSTANT, **same)
    assert np.array_equal(decided(gap, **same, fall_per_s=0.0), constant)
    assert decided(gap, **same, fall_per_s=1e-7) == pytest.approx(constant, abs=1e-5)
    # So is one of which nearly all remains.
    assert decided(gap, **same, fall_per_s=2.0, floor=0.95) == pytest.approx(constant, abs=5e-3)


@EACH
@given(VALUES, st.floats(0.25, 2.0), st.floats(-0.8, 0.8))
@settings(max_examples=15)
def test_no_trial_is_lost_or_made(gap, values, bound, start):
    """With floors of up to 0.2 all trials are decided within the grid."""
    values = {**values, FLOOR.name: 0.2 * values[FLOOR.name], FALL.name: max(values[FALL.name], 2)}
    mass = decided(gap, bound=bound, start=start, **values)
    assert mass.sum(axis=(1, 2)) == pytest.approx(1, abs=4e-3)
    assert (mass >= 0).all()


@pytest.mark.parametrize("gap", GAPS.values(), ids=lambda gap: gap.name)
def test_a_model_is_saved_as_its_gap(gap):
    model = GapModel(gap)
    assert unpacked(packed(model)) == model
