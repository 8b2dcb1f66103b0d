"""The sequential test with a constant gap and a falling one, in bins."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting import algorithms, passage
from bgmodel.fitting.algorithms import (
    BOUND,
    CONSTANT,
    EXPONENTIAL,
    FALL,
    FLOOR,
    GAPS,
    STEEPNESS,
    WEIBULL,
    GapModel,
)
from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.support.saved import packed, unpacked
from tests.closed_forms import accuracy, mean_time_s

GRID = Grid(300)


@given(st.floats(0, 20), st.floats(0.15, 0.9))
@settings(max_examples=20)
def test_bins_hold_the_mass_accuracy_and_mean_of_the_closed_forms(drift, bound):
    every = {"sensitivity": np.array([drift]), "bound": np.array([bound])}
    mass = GapModel().decided(every, np.ones(1), GRID)
    late = passage.constant_at_rest(bound, np.arange(3.0, 30, 0.01)).sum() * 0.01
    assert mass.sum() == pytest.approx(1, abs=max(2e-3, 2 * late))
    sums = {name: value[0] for name, value in moments(mass / BIN_S, GRID).items()}
    assert sums["accuracy"] == pytest.approx(float(accuracy(drift, bound)), abs=1e-6)
    if late < 1e-4:
        assert sums["mean_s"] == pytest.approx(float(mean_time_s(drift, bound)), abs=5e-4)


@pytest.mark.parametrize(
    ("gap", "shape"),
    [(EXPONENTIAL, {FALL.name: 4.0}), (EXPONENTIAL, {FALL.name: 0.3}),
     (WEIBULL, {FALL.name: 1.0, STEEPNESS.name: 6.0})],
    ids=["early", "slow", "late and steep"],
)  # fmt: skip
def test_bins_have_enough_parts(gap, shape, monkeypatch):
    model, strength = GapModel(gap), np.array([0.0, 1.0])
    values = {"sensitivity": 2.0, BOUND.name: 2.0, FLOOR.name: 0.1, **shape}
    every = {name: np.full(2, value) for name, value in values.items()}
    mass = model.decided(every, strength, Grid(400))
    width_s = np.full(8 * 400, BIN_S / 8)
    finer = (width_s.cumsum() - width_s / 2, width_s, np.repeat(np.arange(400), 8))
    monkeypatch.setattr(algorithms, "_parts", lambda *_: finer)
    exact = model.decided(every, strength, Grid(400))
    seen = exact > 1e-5
    # nats that a thousand trials at each strength are wrong by, if no errors cancel
    assert 1000 * (exact[seen] * np.abs(np.log(exact[seen] / mass[seen]))).sum() < 0.3


FALLING = [gap for gap in GAPS.values() if gap is not CONSTANT]
EACH = pytest.mark.parametrize("gap", FALLING, ids=lambda gap: gap.name)
LOWEST = {FALL: 0.05, STEEPNESS: STEEPNESS.low, FLOOR: FLOOR.low}
VALUES = st.fixed_dictionaries({p.name: st.floats(low, p.high) for p, low in LOWEST.items()})


def decided(gap, **values):
    every = {name: np.full(3, value) for name, value in {"sensitivity": 9.0, **values}.items()}
    return GapModel(gap).decided(every, np.array([-0.3, 0.0, 0.2]), Grid(400))


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
    left = {"falling_gap": np.exp(-1), "hyperbolic_gap": 0.5, "weibull_gap": np.exp(-1)}
    for (name, share), floor in product(left.items(), (0.0, 0.5)):
        (at,), _ = GAPS[name].at(1.2, {**values, FLOOR.name: floor}, time)
        assert at == pytest.approx(1.2 * (floor + (1 - floor) * share))


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
