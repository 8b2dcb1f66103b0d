"""The cells of a table of choices."""

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
from tests.drawn import choices, drawn
from tests.helpers import refused, unwarned

# So few that not even all wrong ones are fewer right ones than by chance.
SIGNED = st.lists(
    st.tuples(st.sampled_from([-0.4, -0.1, 0.0, 0.1, 0.4]), st.sampled_from([0, 1])),
    min_size=1,
    max_size=10,
)


@given(SIGNED)
def test_a_trial_and_its_mirror_image_lie_in_one_cell_as_one(trials):
    strength, response = np.array(trials).T
    design = design_of(choices(strength, response))
    # At strength 0 responses have no correct side, so they are unchanged.
    image = np.where(strength == 0, response, 1 - response)
    other = design_of(choices(-strength, image))
    assert np.array_equal(design.observed.response, other.observed.response)
    assert np.array_equal(design.observed.cell, other.observed.cell)
    assert np.array_equal(design.strength[design.observed.cell], np.abs(strength))
    right = np.where(strength < 0, response == 0, response == 1)
    assert np.array_equal(design.observed.response == 1, right)


def test_a_trial_without_a_response_has_none_whatever_its_strength():
    design = design_of(choices([-0.1, 0.1, -0.1], [-1, -1, 0], deadline_s=2.0))
    assert design.observed.response.tolist() == [-1, -1, 1]


def test_cells_are_strengths_and_levels_of_the_columns_asked_for():
    some = choices([0.1, -0.1, 0.2, 0.1], [1, 1, 0, 1], dbs=list("nfnn"), day=list("1234"))
    design = design_of(some, ["dbs"])
    assert design.strength.tolist() == [0.1, 0.1, 0.2]
    assert design.conditions == {"dbs": ["f", "n", "n"]}
    assert design.observed.cell.tolist() == [1, 0, 2, 1]
    assert design.trials.tolist() == [1, 2, 1]
    assert [design.label(k) for k in (0, 2)] == ["strength 0.1, dbs f", "strength 0.2, dbs n"]
    assert design_of(some).cells == 2
    with refused("by"):
        design_of(some, ["drug"])


def test_without_strengths_every_trial_has_the_same_and_responses_stay():
    design = design_of(choices(None, [1, 0, 1]))
    assert design.strength.tolist() == [1.0]  # as the page of fits says
    assert design.observed.response.tolist() == [1, 0, 1]


def test_the_grid_holds_every_time_and_goes_to_the_deadline():
    rt = np.array([0.3, 1.237, 0.8])
    assert design_of(choices([1, 2, 3], [1, 0, 1], rt)).grid.bins * BIN_S > 1.237 + 5 * BIN_S
    assert design_of(choices([1, 2, 3], [1, 0, 1], rt, 2.0)).grid.bins == 200


def test_a_part_has_the_same_cells_and_its_own_trials():
    some = choices([0.1, 0.2, 0.1, 0.3], [1, 0, 1, -1], [0.3, 0.4, 0.5, 0.6], 1.0)
    design = design_of(some)
    part = design.part(np.array([2, 3]))
    assert part.strength is design.strength
    assert part.trials.tolist() == [1, 0, 1]
    assert part.observed.rt_s[0] == 0.5
    assert (part.observed.deadline_s, part.grid) == (1.0, design.grid)


def test_participants_are_pooled_only_where_that_is_said():
    some = choices([0.1, -0.1, 0.2, 0.1], [1, 1, 0, 1])
    both = replace(some, participant=np.array(["a", "a", "b", "b"]))
    with pytest.warns(DataWarning):
        design_of(both)
    with unwarned():
        assert design_of(both, pooled=True).who == "all"
        design_of(some)


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
    response = np.where(none, -1, some.response).astype(np.int8)
    some = replace(some, rt_s=np.where(none, np.nan, some.rt_s), response=response)
    assert design_of(some).left_out == 0
    with pytest.warns(DataWarning):
        design = design_of(some, rt_window=(0, 10))
    assert (design.left_out, (design.observed.response < 0).sum()) == (1, 1)


@given(st.integers(0, 1000), st.integers(1200, 7000), st.booleans(), st.integers(0, 2**32))
@settings(max_examples=30)
def test_all_that_can_happen_in_a_window_has_probability_1(early, late, missed, seed):
    """Densities are constant in each bin here, so that sums over fine times are integrals."""
    grid, rng = Grid(300), np.random.default_rng(seed)
    density = rng.gamma(0.5, size=(1, 2, 1)) * np.ones(grid.bins)
    density *= 0.7 / density.sum() / BIN_S
    fine, late, deadline_s = BIN_S / 20, min(late, 6000), 3.0 if missed else None
    early_s, late_s = fine * early, fine * late
    times = fine * (np.arange(early, late) + 0.5)
    rt = np.concatenate([times, times, [np.nan] * missed])
    response = np.concatenate([np.zeros(len(times)), np.ones(len(times)), [-1] * missed])
    cell, window_s = np.zeros(len(rt), int), (early_s, late_s)
    seen = BinnedResponses(cell, response.astype(int), rt, grid, deadline_s, window_s)
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
