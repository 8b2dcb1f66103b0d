"""Thresholds are placed by accuracy: laws against all thresholds that there are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, gaussian_evidence, stream
from bgmodel.comparison.matched import matched_measures
from bgmodel.deciding.tradeoff import PLACED, _steps, margin, tradeoff
from bgmodel.integrators.baselines import BASELINES, MaxVsNext
from tests.helpers import cues


@settings(max_examples=40)
@given(
    st.sampled_from(["MSPRT", *BASELINES, "delayed", "cues"]),
    st.integers(1, 12),
    st.integers(2, 4),
    st.integers(0, 99),
)
def test_accuracy_at_each_step_is_that_of_decisions_there(kind, readings, channels, seed):
    """All thresholds at which a decision changes, and accuracy at each, against the decisions."""
    evidence = gaussian_evidence(30, d_prime=1.0, channels=channels, t_max=readings, seed=seed)
    evidence = cues(30, readings, 1.3, seed) if kind == "cues" else evidence
    made = BASELINES[kind]() if kind in BASELINES else Msprt()
    trace = made.run(evidence)
    if kind == "delayed":
        trace = replace(trace, time_ms=trace.time_ms + 20.0, onset_ms=20.0)
    at, accuracy = _steps(trace, evidence)
    assert (np.diff(at) < 0).all()
    np.testing.assert_allclose(tradeoff(trace, evidence, at).posterior.mean(axis=1), accuracy)
    # Between two of them nothing changes.
    between = tradeoff(trace, evidence, at[:-1] - np.diff(-at) / 2) if len(at) > 1 else None
    if between is not None:
        np.testing.assert_allclose(between.posterior.mean(axis=1), accuracy[1:])


@pytest.mark.parametrize("factor", [1, 4])
@pytest.mark.parametrize("d_prime", [0.5, 1.5, 3.0])
def test_each_accuracy_has_a_threshold_however_long_a_trial_may_last(d_prime, factor):
    """Within what a few decisions change, and not far above: all of them between the ends."""
    readings = factor * int(40 / d_prime**2 + 10)
    evidence = gaussian_evidence(400, d_prime=d_prime, t_max=readings, seed=3)
    for made in (Msprt(), Msprt(0.55), MaxVsNext()):
        decisions = tradeoff(made.run(evidence), evidence, accuracies=(0.9123,))
        low, high = decisions.reached[[0, -1]]
        for accuracy in [0.9123, *PLACED]:
            if low < accuracy < min(high, 0.99):
                assert np.abs(decisions.reached - accuracy).min() < 0.1 * margin(accuracy) + 5e-4


def test_times_at_an_accuracy_are_those_of_a_randomised_test_on_a_lattice():
    """Cues of 1.3 nats: leads of 1, 2 and 3 of them have posteriors of 0.79, 0.93 and 0.98.

    At 0.9 the test divides trials between the first two, and its mean time with them, which for
    leads of k cues is k tanh(k c / 2) / tanh(c / 2) readings (Wald's identity without overshoot).
    """
    c, readings, trials = 1.3, 80, 4000
    evidence = cues(trials, readings, c)
    decisions = tradeoff(Msprt().run(evidence), evidence).at_accuracy(0.9)
    posterior = 1 / (1 + np.exp(-c * np.array([1, 2])))
    steps = np.array([1, 2]) * np.tanh(np.array([1, 2]) * c / 2) / np.tanh(c / 2)
    share = (0.9 - posterior[0]) / np.diff(posterior)[0]
    assert decisions.posterior.mean() == pytest.approx(0.9, abs=2e-3)
    assert set(np.round(decisions.posterior[0], 6)) == set(np.round(posterior, 6))
    due = 1 + share * (steps[1] - steps[0])
    error = decisions.time_ms.std() / np.sqrt(trials) / evidence.step_ms
    assert decisions.time_ms.mean() / evidence.step_ms == pytest.approx(due, abs=4 * error)
    right = (decisions.choice[0] == evidence.truth).mean()
    assert right == pytest.approx(0.9, abs=4 * np.sqrt(0.09 / trials))
    # Integrators divide the same trials: the test agrees with a monotone function of itself.
    other = tradeoff(MaxVsNext().run(evidence), evidence)
    test = tradeoff(Msprt().run(evidence), evidence)
    table = matched_measures(test, other, rng=stream(1, "b"), accuracies=(0.9,), resamples=20)
    table = table.set_index("measure")["value"]
    assert table["agreement"] == table["pearson_r"] == pytest.approx(1)


def test_evidence_that_says_nothing_has_one_threshold():
    silent = Evidence(np.zeros((10, 5, 2)), np.arange(10) % 2)
    decisions = tradeoff(Msprt().run(silent), silent)
    assert decisions.posterior.mean() == 0.5
    assert len(decisions.settings) == 1


def test_settings_are_added_in_order():
    evidence = gaussian_evidence(50, d_prime=1.0, t_max=20, seed=2)
    trace = Msprt().run(evidence)
    in_one = tradeoff(trace, evidence, [0.5, 0.3, 0.2, 0.1])
    parts = tradeoff(trace, evidence, [0.3, 0.1]) | tradeoff(trace, evidence, [0.2, 0.5])
    for name in ("settings", "choice", "time_ms", "forced", "posterior"):
        assert np.array_equal(getattr(in_one, name), getattr(parts, name)), name
