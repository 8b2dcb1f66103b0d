"""The compiled count of stored trials, against what each trial is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting.simulated.crossings import count

MIDDLE, WIDTH = 40, 0.1


def counted(bins, choice, share, evidence=None, parts=(True,), sides=1):
    """Return the counts that decided and that did not, by bin and evidence, and for two by side."""
    bins, choice = np.array(bins, np.int16), np.array(choice, np.int8)
    evidence = np.zeros(bins.shape) if evidence is None else np.array(evidence, float)
    decided, never = np.zeros((sides, 32, 2 * MIDDLE + 1)), np.zeros(2 * MIDDLE + 1)
    count(bins, choice, evidence, np.array(share), np.array(parts), WIDTH, decided, never)
    return decided if sides == 2 else decided[0], never


def test_a_trial_of_one_choice_lies_between_its_settings_in_time_and_evidence():
    decided, _ = counted([[10], [20]], [[0], [0]], [0.75, 0.25], [[1.0], [3.0]])
    assert decided[12, MIDDLE + 15] == pytest.approx(0.5)
    assert decided[13, MIDDLE + 15] == pytest.approx(0.5)


def test_of_two_sides_each_has_its_choices():
    decided, never = counted([[5, 6, 7]], [[0, 1, -1]], [1.0], [[1.0, 1.0, 1.0]], sides=2)
    assert decided[0, 5, MIDDLE + 10] == pytest.approx(1)
    assert decided[1, 6, MIDDLE - 10] == pytest.approx(1)
    assert decided.sum() == pytest.approx(2)
    assert never[MIDDLE + 10] == pytest.approx(1)


@pytest.mark.parametrize("other", [1, -1])
def test_a_trial_of_two_choices_is_divided_as_the_shares_say(other):
    decided, never = counted([[10], [20]], [[0], [other]], [0.75, 0.25])
    assert decided[10].sum() == pytest.approx(0.75)
    assert decided[20].sum() == pytest.approx(0.25 * (other == 1))
    assert never.sum() == pytest.approx(0.25 * (other == -1))


@given(st.integers(1, 4), st.integers(0, 2**32))
@settings(max_examples=30)
def test_every_trial_counts_once_and_keeps_its_evidence(settings_, seed):
    rng = np.random.default_rng(seed)
    bins, choice = rng.integers(0, 30, (settings_, 40)), rng.integers(0, 2, (settings_, 40))
    evidence = rng.uniform(-3, 3, (settings_, 40))
    share = rng.dirichlet(np.ones(settings_))
    decided, _ = counted(bins, choice, share, evidence)
    assert decided.sum() == pytest.approx(40)
    towards = share @ np.where(choice == 0, evidence, -evidence)
    columns = (np.arange(2 * MIDDLE + 1) - MIDDLE) * WIDTH
    assert (decided @ columns).sum() == pytest.approx(towards.sum())


@given(st.integers(1, 5), st.integers(0, 2**32))
@settings(max_examples=20)
def test_parts_add_up_to_the_whole(parts, seed):
    rng = np.random.default_rng(seed)
    trials = [rng.integers(0, 30, (1, 40)), rng.integers(-1, 2, (1, 40)), [1.0]]
    evidence = rng.uniform(-3, 3, (1, 40))
    each = [counted(*trials, evidence, row) for row in np.eye(parts, dtype=bool)]
    for some, total in zip(zip(*each, strict=True), counted(*trials, evidence), strict=True):
        assert np.sum(some, axis=0) == pytest.approx(total)
