"""The log likelihood of many trials against PyDDM on a fine grid: make validate."""

import pytest

from bgmodel.fitting.algorithms import EXPONENTIAL, HYPERBOLIC, WEIBULL
from tests.test_against_other_tools import compared

pytestmark = pytest.mark.validate


@pytest.mark.parametrize("gap", [EXPONENTIAL, HYPERBOLIC, WEIBULL], ids=lambda gap: gap.name)
def test_the_log_likelihood_of_many_trials_is_that_of_pyddm_on_a_fine_grid(gap):
    pytest.importorskip("pyddm")
    ours, _, limit = compared(gap, 92_002, 1000, 0.0005, fall_shape=3.0)
    assert ours.sum() == pytest.approx(limit.sum(), abs=0.5)
