"""Posteriors at decisions: what chance alone says of them."""

import numpy as np
import pytest

from bgmodel.deciding.calibration import against_evidence
from bgmodel.support.seeds import stream


@pytest.mark.parametrize("hypotheses", [2, 5])
def test_choices_at_random_are_not_against_the_evidence_and_those_of_the_least_likely_are(
    hypotheses,
):
    rng = stream(7, "choices")
    posterior = rng.dirichlet(np.ones(hypotheses), size=(2000, 200))
    warned = [bool(against_evidence(one[:, 0], hypotheses)) for one in posterior]
    assert np.mean(warned) <= 0.005
    assert against_evidence(posterior[0].min(axis=1), hypotheses)
    assert not against_evidence(posterior[0].max(axis=1), hypotheses)
    assert not against_evidence(np.full(100, 1 / hypotheses), hypotheses)
    assert not against_evidence(posterior[0, :19].min(axis=1), hypotheses)
