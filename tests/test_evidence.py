"""Evidence: drawn alike for any number of trials, and refused where it makes no sense."""

import numpy as np
import pytest

from bgmodel import Evidence, stream
from bgmodel.evidence import gaussian_evidence
from tests.helpers import some_evidence


@pytest.mark.parametrize("trials", [10, 11])
def test_gaussian_trials_do_not_depend_on_those_after_them(trials):
    few, many = (
        gaussian_evidence(n, 5, 0.5, hypotheses=3, rng=stream(12, "prefix"))
        for n in (trials, 2 * trials)
    )
    assert np.array_equal(few.log_likelihood, many.log_likelihood[:trials])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: some_evidence(prior=[0.5, 0.5, 0.1]), "prior must sum to 1"),
        (lambda: some_evidence(prior=[0.5, 0.5]), "prior must hold 3"),
        (lambda: some_evidence(onset_ms=-1.0), "onset_ms must be >= 0"),
        (lambda: some_evidence(step_ms=0.0), "step_ms must be > 0"),
        (lambda: Evidence(np.full((1, 1, 2), np.nan), np.array([0])), "must be finite, got nan"),
        (lambda: Evidence(np.full((1, 1, 2), np.inf), np.array([0])), "must be finite, got inf"),
        (lambda: Evidence(np.zeros((0, 1, 2)), np.array([], int)), "at least one trial"),
        (lambda: Evidence(np.zeros((1, 1, 1)), np.array([0])), "two hypotheses"),
        (lambda: Evidence(np.zeros((1, 1, 2)), np.array([2])), "truth must lie in 0..1"),
        (lambda: Evidence(np.zeros((1, 1, 2)), np.array([0.0])), "whole number a trial"),
        (lambda: some_evidence(lengths=np.full(300, 21)), "lengths must lie in 1..20"),
        (lambda: some_evidence(lengths=np.full(300, 2)), "after the last of a trial must be 0"),
        (lambda: some_evidence(lengths=[1.5]), "lengths must hold one whole number per trial"),
        (lambda: some_evidence(numbers=[1]), "numbers must hold one whole number per trial"),
    ],
)
def test_evidence_without_sense_is_refused(call, says):
    with pytest.raises(ValueError, match=says):
        call()
