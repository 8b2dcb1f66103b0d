"""The compiled sums over stored trials, against what each trial is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting.weights import between, gather


def rows_of(bins, choice, share, evidence=None, mixture=None):
    """Return the rows that ``between`` fills: place, chosen, read, log weight."""
    bins, choice = np.array(bins, np.int32), np.array(choice, np.int8)
    evidence = np.zeros(bins.shape) if evidence is None else np.array(evidence, float)
    mixture = np.zeros(bins.shape) if mixture is None else np.array(mixture, float)
    place, read, weight = np.empty((3, bins.size))
    chosen = np.empty(bins.size, np.int8)
    used = between(
        bins, choice, evidence, mixture, np.array(share, float), place, chosen, read, weight
    )
    return [each[:used] for each in (place, chosen, read, weight)]


def test_a_trial_of_one_choice_lies_between_its_settings_in_all_it_is():
    found = rows_of([[10], [20]], [[1], [1]], [0.75, 0.25], [[1.0], [3.0]], [[0.0], [4.0]])
    assert [each.tolist() for each in found] == [[12.5], [1], [1.5], [-1.0]]


@pytest.mark.parametrize("other", [0, -1])
def test_a_trial_of_two_choices_is_divided_as_the_shares_say(other):
    mixture = [[0.5], [2.0]]
    place, chosen, _, weight = rows_of([[10], [20]], [[1], [other]], [0.75, 0.25], mixture=mixture)
    assert place.tolist() == [10, 20]
    assert chosen.tolist() == [1, other]
    assert weight == pytest.approx([np.log(0.75) - 0.5, np.log(0.25) - 2.0])


@given(st.integers(1, 4), st.integers(0, 2**32))
@settings(max_examples=30)
def test_every_trial_weighs_1_in_all(settings_, seed):
    rng = np.random.default_rng(seed)
    bins, choice = rng.integers(0, 30, (settings_, 40)), rng.integers(-1, 2, (settings_, 40))
    weight = rows_of(bins, choice, rng.dirichlet(np.ones(settings_)))[3]
    assert np.exp(weight).sum() == pytest.approx(40)


def summed(place, chosen, as_zero, as_one, bins=5):
    found = np.zeros((len(as_zero), 2, bins))
    gather(np.array(place, float), np.array(chosen, np.int8), np.array(as_zero, float),
           np.array(as_one, float), found)  # fmt: skip
    return found


def test_a_trial_as_one_chose_the_other_channel_and_its_image_its_own():
    """Channel 0 is what stored evidence speaks for, response 1 what the asked drift does."""
    found = summed([2], [0], [[1.0]], [[3.0]])
    assert found[0, 1, 2] == 0.75
    assert found[0, 0, 2] == 0.25
    assert found.sum() == 1
    assert np.array_equal(summed([2], [1], [[1.0]], [[3.0]]), found[:, ::-1])


def test_a_place_between_two_bins_goes_to_both():
    found = summed([2.25], [0], [[0.0]], [[1.0]])
    assert found[0, 1].tolist() == [0, 0, 0.75, 0.25, 0]


def test_what_is_undecided_or_late_counts_to_the_whole_alone():
    assert summed([1, 4, 7, 4.5], [0, -1, 0, 1], np.ones((1, 4)), np.ones((1, 4)))[0].tolist() == [
        [0, 0.125, 0, 0, 0.0625],
        [0, 0.125, 0, 0, 0.0625],
    ]
