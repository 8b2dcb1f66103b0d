"""Responses and the sides that strengths speak for."""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import hypergeom

from bgmodel.fitting.design import design_of
from bgmodel.fitting.sides import lean
from circuits.errors import DataWarning
from tests.drawn import choices
from tests.fitting.test_design import SIGNED
from tests.helpers import refused


def test_lean_is_the_responses_beyond_those_of_two_sides_that_are_alike():
    """9 of 10 and 5 of 10 are right, 0.7 on both: 14 responses are 1, and 7 + 3 would be."""
    strength = np.repeat([0.2, -0.2, 0.0], [10, 10, 20])
    response = np.repeat([1, 0, 1, 0, 1, 0], [9, 1, 5, 5, 13, 7])
    variance = 4 * hypergeom.var(20, 14, 10) + 20 / 4
    expected = (4 + 3) / 40, 7 / np.sqrt(variance)
    assert lean(choices(strength, response)) == pytest.approx(expected)


def test_z_has_variance_one_over_all_ways_to_divide_what_is_right():
    """Exactly, given the number of trials on each side and of correct responses."""
    sides, right = (5, 4), 6
    ways = np.arange(right - sides[1], sides[0] + 1)
    leans = []
    for positive in ways:
        negative = right - positive
        ones = [positive, sides[0] - positive, sides[1] - negative, negative]
        response = np.repeat([1, 0, 1, 0], ones)
        leans.append(lean(choices(np.repeat([0.3, -0.3], sides), response)))
    shares, z = np.array(leans).T
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


def sided(right, wrong, missed=0):
    """Return choices at strengths of both signs, `right` of which are correct."""
    strength = np.tile([0.2, -0.2], (right + wrong + missed + 1) // 2)[: right + wrong + missed]
    correct = np.repeat([1, 0, -1], [right, wrong, missed])
    response = np.where(strength > 0, correct, 1 - correct)
    return choices(strength, np.where(correct < 0, -1, response), deadline_s=2.0)


@given(st.integers(0, 200))
def test_responses_are_refused_where_fewer_are_right_than_by_chance(right):
    z = (right - 100) / np.sqrt(50)
    with refused("response") if z < -3.29 else nullcontext():
        design_of(sided(right, 200 - right))


def test_one_condition_whose_responses_are_on_the_other_side_is_refused_by_name():
    """Together they are right in half of the trials: sensitivity would be 0."""
    strength, cue = np.tile([0.2, -0.2], 100), np.repeat(["a", "b"], 100)
    right = np.tile([1] * 9 + [0], 20)
    response = np.where(strength > 0, right, 1 - right)
    response = np.where(cue == "b", 1 - response, response)
    some = choices(strength, response, cue=cue)
    design_of(some)
    with refused("response"):
        design_of(some, ["cue"])


@pytest.mark.parametrize(("other", "hint"), [(0.8, True), (0.5, False)])
def test_right_and_wrong_beside_strengths_with_a_sign_are_hinted_at(other, hint):
    """The share of response 1 where the strength speaks for 0; it is 0.8 where it speaks for 1."""
    ones = [80, 20, round(100 * other), round(100 * (1 - other))]
    some = choices(np.repeat([0.2, -0.2], 100), np.repeat([1, 0, 1, 0], ones))
    with pytest.warns(DataWarning) as caught:
        design_of(some)
    assert ("strengths without a sign" in str(caught[0].message)) == hint
