"""Worlds that give trials and rewards."""

import numpy as np
import pytest

from bgmodel import Evidence, stream
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.learning.worlds import LevelOutcomes, trials_of
from tests.helpers import refused, refusing
from tests.learning.helpers import XI, draw


def test_trials_asked_for_later_are_other_ones():
    """Blocks that do not begin where a request does: no trial comes twice."""
    world = trials_of([draw(stream(9, "switch"))], XI, block=50)
    gaps = np.array([2.0])
    first = [world(k, gaps)[0] for k in range(10, 40)]
    again = [world(k, gaps)[0] for k in range(110, 140)]
    assert first != again


def test_outcomes_are_sorted_by_level_and_count_readings_from_the_onset():
    """Two levels, three trials: times by hand; what comes before the onset takes no reading."""
    evidence = Evidence(np.zeros((3, 2, 2)), np.array([0, 1, 1]), step_ms=50.0)
    choice, time_ms = np.array([[0, 0, 1], [1, 1, 1]]), np.array([[50.0, 25, -9], [100, 75, 150]])
    late = np.array([[False] * 3, [False, False, True]])
    decisions = Tradeoff(np.array([1.4, 0.9]), choice, time_ms, late, time_ms < 0, np.ones((2, 3)))
    made = LevelOutcomes.of(decisions, evidence)
    assert made.levels.tolist() == [0.9, 1.4]
    assert made.correct.tolist() == [[False, True, True], [True, False, True]]
    assert made.steps.tolist() == [[2, 1.5, 3], [1, 0.5, 0]]
    assert made.forced == pytest.approx([1 / 3, 0])
    assert made.rewards(10.0).tolist() == [[-12, -1.5, -3], [-1, -10.5, 0]]
    assert made.best(10.0) == (1.4, pytest.approx(-11.5 / 3))
    with refused("evidence"):
        LevelOutcomes.of(decisions, evidence[:2])


TWO, LEVELS = np.ones((2, 3)), np.array([1.0, 1.1])


test_worlds_without_sense_are_refused = refusing(
    (lambda: LevelOutcomes(LEVELS[::-1], TWO, TWO, np.zeros(2)), "levels"),
    (lambda: LevelOutcomes(LEVELS, TWO[:1], TWO[:1], np.zeros(2)), "correct"),
    (lambda: LevelOutcomes(LEVELS, TWO, np.ones((2, 4)), np.zeros(2)), "steps"),
)
