"""The reward, as the paper defines it."""

import numpy as np
import pytest

from bgmodel import Sprt, first_crossing, stream, threshold_from_gap
from bgmodel.evidence import gaussian_evidence
from bgmodel.learning.reward import reward
from tests.learning.helpers import SEPARATION, T_MAX


def test_the_reward_is_that_of_the_paper():
    evidence = gaussian_evidence(200, T_MAX, SEPARATION, rng=stream(1, "reward"))
    trace = Sprt().run(evidence)
    decision = first_crossing(trace, float(threshold_from_gap(3.0)))
    wrong = decision.choice != evidence.truth
    assert reward(decision, evidence.truth, 7.0) == pytest.approx(-7.0 * wrong - decision.steps)
    free = first_crossing(trace, -1e9, forced=False)
    assert reward(free, evidence.truth, 7.0) == pytest.approx(np.full(200, -7.0 - T_MAX))
