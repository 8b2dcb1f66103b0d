"""Evidence: drawn alike for any number of trials, and refused where it makes no sense."""

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.evidence import gaussian_evidence


@pytest.mark.parametrize("trials", [10, 11])
def test_gaussian_trials_do_not_depend_on_those_after_them(trials):
    few, many = (
        gaussian_evidence(n, 5, 0.5, hypotheses=3, rng=stream(12, "prefix"))
        for n in (trials, 2 * trials)
    )
    assert np.array_equal(few.log_likelihood, many.log_likelihood[:trials])
