"""The sequential test with a constant gap and a falling one, in bins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting import algorithms, passage
from bgmodel.fitting.algorithms import (
    BOUND,
    EXPONENTIAL,
    FALL,
    FLOOR,
    STEEPNESS,
    WEIBULL,
    GapModel,
)
from bgmodel.fitting.responses import BIN_S, Grid, moments

GRID = Grid(300)
CONSTANT, FALLING = GapModel(), GapModel(EXPONENTIAL)


def decided(model, strength, grid=GRID, **values):
    strength = np.atleast_1d(np.asarray(strength, float))
    every = {name: np.broadcast_to(x, strength.shape).astype(float) for name, x in values.items()}
    return model.decided(every, strength, grid)


@given(st.floats(0, 20), st.floats(0.15, 0.9))
@settings(max_examples=20)
def test_bins_hold_the_mass_accuracy_and_mean_of_the_closed_forms(drift, bound):
    mass = decided(CONSTANT, 1, sensitivity=drift, bound=bound)
    late = passage.constant_at_rest(bound, np.arange(3.0, 30, 0.01)).sum() * 0.01
    assert mass.sum() == pytest.approx(1, abs=max(2e-3, 2 * late))
    sums = {name: value[0] for name, value in moments(mass / BIN_S, GRID).items()}
    assert sums["accuracy"] == pytest.approx(float(passage.accuracy(drift, bound)), abs=1e-6)
    if late < 1e-4:
        assert sums["mean_s"] == pytest.approx(float(passage.mean_time_s(drift, bound)), abs=5e-4)


@pytest.mark.parametrize("model", [CONSTANT, FALLING])
def test_each_cell_has_its_own_parameters(model):
    some = {"sensitivity": [4.0, 12, 8], "bound": [0.5, 0.9, 0.5], "fall_per_s": [1.7, 1.7, 0.5]}
    strength = [0.1, 0.5, 0.2]
    together = decided(model, strength, **some)
    for cell in range(3):
        alone = {name: value[cell] for name, value in some.items()}
        assert together[cell] == pytest.approx(
            decided(model, strength[cell], **alone)[0], rel=1e-12
        )


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
