"""Evidence from intervals: moments, closed forms of what a reading says, and calibration."""

import numpy as np
import pytest

from benchmarks.methods.intervals import NULL, PREFERRED, interval_evidence
from bgmodel import Msprt, first_crossing, stream


@pytest.mark.parametrize("cells", [PREFERRED, NULL])
@pytest.mark.parametrize("coherence", list(PREFERRED))
def test_intervals_have_the_mean_and_the_sd_that_are_given(cells, coherence):
    kind = cells[coherence]
    log_ms = np.linspace(kind.log_mean - 9 * kind.log_sd, kind.log_mean + 9 * kind.log_sd, 4001)
    density = np.exp(kind.log_density(log_ms))
    ms = np.exp(log_ms)
    whole, mean, square = (np.trapezoid(density * each, log_ms) for each in (1, ms, ms**2))
    assert whole == pytest.approx(1)
    assert mean == pytest.approx(kind.mean_ms)
    assert np.sqrt(square - mean**2) == pytest.approx(kind.sd_ms)


def test_numbers_are_those_of_the_authors_row_by_row():
    """Caballero, Humphries & Gurney 2018, their code; copied a second time, in their order."""
    rows = {
        "preferred mean": [54.11, 51.96, 46.11, 37.74, 29.86],
        "preferred sd": [33.13, 32.18, 30.49, 28.01, 25.98],
        "null mean": [59.37, 62.90, 65.53, 70.15, 83.45],
        "null sd": [34.54, 35.32, 36.14, 37.15, 40.63],
    }
    for name, cells in (("preferred", PREFERRED), ("null", NULL)):
        assert list(cells) == [0.032, 0.064, 0.128, 0.256, 0.512]
        assert [each.mean_ms for each in cells.values()] == rows[f"{name} mean"]
        assert [each.sd_ms for each in cells.values()] == rows[f"{name} sd"]


def divergence(one, other):
    """Return the Kullback-Leibler divergence of two normal densities of logarithms."""
    apart = one.log_sd**2 + (one.log_mean - other.log_mean) ** 2
    return np.log(other.log_sd / one.log_sd) + apart / (2 * other.log_sd**2) - 0.5


@pytest.mark.parametrize("coherence", list(PREFERRED))
def test_a_reading_says_on_average_what_the_densities_differ_by(coherence):
    rng = stream(1, "intervals", str(coherence))
    evidence = interval_evidence(4000, 10, coherence, rng=rng, hypotheses=2)
    own = evidence.log_likelihood[np.arange(4000), :, evidence.truth]
    other = evidence.log_likelihood[np.arange(4000), :, 1 - evidence.truth]
    preferred, null = PREFERRED[coherence], NULL[coherence]
    for found, want in ((own, divergence(preferred, null)), (other, -divergence(null, preferred))):
        assert abs(found.mean() - want) < 4 * found.std() / np.sqrt(found.size)


@pytest.mark.parametrize("hypotheses", [2, 4])
def test_posteriors_are_calibrated(hypotheses):
    """The mean posterior at the decision is the accuracy (a martingale)."""
    rng = stream(2, "calibrated", str(hypotheses))
    evidence = interval_evidence(4000, 400, 0.128, rng=rng, hypotheses=hypotheses)
    decision = first_crossing(Msprt().run(evidence), -np.log(0.8))
    reading = (decision.time_ms / evidence.step_ms).astype(int)
    posterior = evidence.posterior[np.arange(4000), reading, decision.choice]
    right = decision.choice == evidence.truth
    assert abs(right.mean() - posterior.mean()) < 4 * np.sqrt(
        (posterior * (1 - posterior)).mean() / 4000
    )
    assert not decision.forced.any()


def test_a_coherence_that_was_not_recorded_is_refused():
    with pytest.raises(ValueError, match=r"coherence must be one of 0.032, .* got 0.5"):
        interval_evidence(2, 2, 0.5, rng=stream(1, "x"))
