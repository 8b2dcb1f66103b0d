"""The cells of a table of choices."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.fitting.design import design_of
from bgmodel.fitting.responses import BIN_S
from circuits.errors import DataWarning
from tests.drawn import choices
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
