"""The cells of a table of choices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import hypergeom

from bgmodel.fitting.design import design_of, lean
from bgmodel.fitting.responses import BIN_S
from tests.drawn import choices

SIGNED = st.lists(
    st.tuples(st.sampled_from([-0.4, -0.1, 0.0, 0.1, 0.4]), st.sampled_from([0, 1])), min_size=1
)


@given(SIGNED)
def test_a_trial_and_its_mirror_image_lie_in_one_cell_as_one(trials):
    strength, response = np.array(trials).T
    own = design_of(choices(strength, response))
    # At strength 0 nothing says which response is which: those are as they were.
    image = np.where(strength == 0, response, 1 - response)
    other = design_of(choices(-strength, image))
    assert np.array_equal(own.observed.response, other.observed.response)
    assert np.array_equal(own.observed.cell, other.observed.cell)
    assert np.array_equal(own.strength[own.observed.cell], np.abs(strength))
    right = np.where(strength < 0, response == 0, response == 1)
    assert np.array_equal(own.observed.response == 1, right)


def test_a_trial_without_a_response_has_none_whatever_its_strength():
    found = design_of(choices([-0.1, 0.1, -0.1], [-1, -1, 0], deadline_s=2.0))
    assert found.observed.response.tolist() == [-1, -1, 1]


def test_cells_are_strengths_and_levels_of_the_columns_asked_for():
    some = choices([0.1, -0.1, 0.2, 0.1], [1, 1, 0, 1], dbs=list("nfnn"), day=list("1234"))
    found = design_of(some, ["dbs"])
    assert found.strength.tolist() == [0.1, 0.1, 0.2]
    assert found.conditions == {"dbs": ["f", "n", "n"]}
    assert found.observed.cell.tolist() == [1, 0, 2, 1]
    assert found.trials.tolist() == [1, 2, 1]
    assert [found.label(k) for k in (0, 2)] == ["strength 0.1, dbs f", "strength 0.2, dbs n"]
    assert design_of(some).cells == 2
    with pytest.raises(ValueError, match=r"no condition is called .drug.; there are dbs, day"):
        design_of(some, ["drug"])


def test_without_strengths_every_trial_has_the_same_and_responses_stay():
    found = design_of(choices(None, [1, 0, 1]))
    assert found.strength.tolist() == [1.0]  # as the page of fits says
    assert found.observed.response.tolist() == [1, 0, 1]


def test_the_grid_holds_every_time_and_goes_to_the_deadline():
    rt = np.array([0.3, 1.237, 0.8])
    assert design_of(choices([1, 2, 3], [1, 0, 1], rt)).grid.bins * BIN_S > 1.237 + 5 * BIN_S
    assert design_of(choices([1, 2, 3], [1, 0, 1], rt, 2.0)).grid.bins == 200


def test_a_part_has_the_same_cells_and_its_own_trials():
    some = choices([0.1, 0.2, 0.1, 0.3], [1, 0, 1, -1], [0.3, 0.4, 0.5, 0.6], 1.0)
    whole = design_of(some)
    part = whole.part(np.array([2, 3]))
    assert part.strength is whole.strength
    assert part.trials.tolist() == [1, 0, 1]
    assert part.observed.rt_s[0] == 0.5
    assert (part.observed.deadline_s, part.grid) == (1.0, whole.grid)


def test_lean_is_the_responses_beyond_those_of_two_sides_that_are_alike():
    """9 of 10 and 5 of 10 are right, .7 on both: 14 responses are 1, and 7 + 3 would be."""
    strength = np.repeat([0.2, -0.2, 0.0], [10, 10, 20])
    response = np.repeat([1, 0, 1, 0, 1, 0], [9, 1, 5, 5, 13, 7])
    share, z = lean(choices(strength, response))
    assert share == pytest.approx((4 + 3) / 40)
    variance = 4 * hypergeom.var(20, 14, 10) + 20 / 4
    assert z == pytest.approx(7 / np.sqrt(variance))


def test_z_has_variance_one_over_all_ways_to_divide_what_is_right():
    """Exactly, given how many trials lie on each side and how many responses are right."""
    sides, right = (5, 4), 6
    ways = np.arange(right - sides[1], sides[0] + 1)
    found = []
    for positive in ways:
        negative = right - positive
        ones = [positive, sides[0] - positive, sides[1] - negative, negative]
        response = np.repeat([1, 0, 1, 0], ones)
        found.append(lean(choices(np.repeat([0.3, -0.3], sides), response)))
    shares, z = np.array(found).T
    weights = hypergeom.pmf(ways, sum(sides), right, sides[0])
    assert weights.sum() == pytest.approx(1)
    assert [weights @ shares, weights @ z, weights @ z**2] == pytest.approx([0, 0, 1])


@given(SIGNED)
def test_lean_changes_sign_with_the_responses_and_knows_no_order(trials):
    strength, response = np.array(trials).T
    share, z = lean(choices(strength, response))
    assert lean(choices(-strength, 1 - response)) == pytest.approx((-share, -z))
    assert lean(choices(strength[::-1], response[::-1])) == pytest.approx((share, z))


def test_lean_is_not_known_without_mirror_images():
    alone = choices([0.1, 0.1, 0.4, -0.2, 0.3], [1, 0, 1, 1, -1], deadline_s=2.0)
    assert lean(alone) == lean(choices(None, [1, 0, 1])) == (0, 0)
