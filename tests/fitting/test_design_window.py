"""The window of response times that a fit uses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of, fence_s
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.responses import BIN_S, BinnedResponses, Grid
from circuits.errors import DataWarning
from tests.drawn import drawn
from tests.helpers import refused

MODEL, SEED = GapModel(), 83
VALUES = {"sensitivity": 12.0, "bound": 0.6}
CLEAN = drawn(MODEL, [0.0, 0.1, 0.4], 100, SEED, seconds=2.0, **VALUES)
FREE = ["sensitivity", "bound", "t0_s"]


def with_times(some, *times_s):
    """Return choices whose first trials have these times."""
    return replace(some, rt_s=np.concatenate([times_s, some.rt_s[len(times_s) :]]))


@pytest.fixture(scope="module")
def clean_fit():
    return optimum(likelihood_of(MODEL, design_of(CLEAN), free=FREE))


@pytest.mark.parametrize("late_s", [23.7, 45.0])
def test_one_late_time_sets_neither_the_grid_nor_the_lapses_nor_the_fit(late_s, clean_fit):
    with pytest.warns(DataWarning) as caught:
        design = design_of(with_times(CLEAN, late_s))
    assert f"the longest {late_s:.3g} s" in str(caught[0].message)
    assert (design.left_out, len(design.observed.rt_s)) == (1, 299)
    assert design.grid.bins * BIN_S < 2.5
    peak = optimum(likelihood_of(MODEL, design, free=FREE))
    assert peak.vector == pytest.approx(clean_fit.vector, rel=0.03)


def test_a_window_that_is_asked_for_leaves_out_what_lies_outside_and_says_how_many():
    rt = CLEAN.rt_s
    outside = int(((rt < 0.4) | (rt > 0.9)).sum())
    with pytest.warns(DataWarning, match=f"{outside} of 300 response times are excluded"):
        design = design_of(CLEAN, rt_window=(0.4, 0.9))
    assert design.left_out == outside > 10
    assert design.observed.window_s == (0.4, 0.9)
    assert design.grid.bins == 90
    assert design_of(with_times(CLEAN, 5.0), rt_window=(0, np.inf)).left_out == 0


@pytest.mark.parametrize(
    "window", [(0.5, 0.2), (-0.1, 2.0), (np.nan, 2.0), (0.2, np.nan), (0.3, 0.3), (0.2,), (9, 10)]
)
def test_a_window_that_is_none_or_has_hardly_a_response_is_refused(window):
    with refused(f"rt_window {'at least 10 responses' if window[0] == 9 else 'earliest'}"):
        design_of(CLEAN, rt_window=window)


def test_with_a_deadline_no_time_is_left_out_unless_asked_and_missed_trials_stay():
    some = with_times(replace(CLEAN, deadline_s=30.0), 23.7)
    none = np.arange(some.trials) == 5
    some = replace(
        some,
        rt_s=np.where(none, np.nan, some.rt_s),
        response=np.where(none, -1, some.response).astype(np.int8),
    )
    assert design_of(some).left_out == 0
    with pytest.warns(DataWarning):
        design = design_of(some, rt_window=(0, 10))
    assert (design.left_out, (design.observed.response < 0).sum()) == (1, 1)


@given(st.floats(0, 0.5), st.floats(0.6, 3.5), st.booleans(), st.integers(0, 2**32))
@settings(max_examples=30)
def test_all_that_can_happen_in_a_window_has_probability_1(early_s, late_s, missed, seed):
    """Densities are constant in each bin here, so that sums over fine times are integrals."""
    grid, rng = Grid(300), np.random.default_rng(seed)
    density = rng.gamma(0.5, size=(1, 2, 1)) * np.ones(grid.bins)
    density *= 0.7 / density.sum() / BIN_S
    late_s, deadline_s = min(late_s, 3.0), 3.0 if missed else None
    fine = BIN_S / 20
    times = np.arange(early_s + fine / 2, late_s, fine)
    rt = np.concatenate([times, times, [np.nan] * missed])
    response = np.concatenate([np.zeros(len(times)), np.ones(len(times)), [-1] * missed])
    seen = BinnedResponses(
        np.zeros(len(rt), int), response.astype(int), rt, grid, deadline_s, (early_s, late_s)
    )
    likelihoods = np.exp(seen.each(density))
    total = likelihoods[np.isfinite(rt)].sum() * fine + likelihoods[np.isnan(rt)].sum()
    assert total == pytest.approx(1, abs=2e-3)


def test_the_fence_is_that_of_the_cell_where_it_is_latest():
    rt = np.concatenate([np.linspace(0.4, 0.5, 41), np.linspace(0.4, 1.2, 41), [9.0]])
    cell = np.repeat([0, 1, 2], [41, 41, 1])
    assert fence_s(rt, cell) == pytest.approx(1.0 + 25 * 0.4)
    few = fence_s(rt[:10], np.arange(10))
    assert few == pytest.approx(np.quantile(rt[:10], 0.75) + 25 * np.ptp(rt[:10]) / 2)
    assert fence_s(np.full(30, 0.5), np.zeros(30, int)) == np.inf
