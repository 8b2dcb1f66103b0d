"""The reward of a decision is that of the paper."""

import numpy as np
import pytest

from bgmodel import Sprt, first_crossing, stream
from bgmodel.deciding.reward import reward, reward_of
from bgmodel.simulated_evidence import separated_evidence
from tests.helpers import refused
from tests.learning.helpers import SEPARATION, T_MAX


def test_the_reward_is_that_of_the_paper():
    evidence = separated_evidence(200, T_MAX, SEPARATION, rng=stream(1, "reward"))
    trace = Sprt().run(evidence)
    decision = first_crossing(trace, float(Sprt.threshold(3.0)))
    wrong = decision.choice != evidence.truth
    assert reward(decision, evidence.truth, 7.0) == pytest.approx(-7.0 * wrong - decision.steps)
    free = first_crossing(trace, -1e9, forced=False)
    assert reward(free, evidence.truth, 7.0) == pytest.approx(np.full(200, -7.0 - T_MAX))


def test_an_error_may_cost_less_than_a_reading_but_not_nothing():
    assert reward_of([False, True], [2.0, 3.0], 0.5).tolist() == [-2.0, -3.5]
    for xi in (0.0, -1.0, np.nan, np.inf):
        with refused("xi"):
            reward_of(True, 1.0, xi)
