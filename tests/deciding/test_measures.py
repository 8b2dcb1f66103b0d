"""Measures of behaviour against their oracles: weights, EZ diffusion, reward, calibration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import Sprt, first_crossing, stream
from bgmodel.deciding.calibration import against_evidence
from bgmodel.deciding.measures import DIFFUSION_S, OF_DIFFUSION, ez_diffusion, mean, median
from bgmodel.deciding.reward import reward, reward_of
from bgmodel.simulated_evidence import separated_evidence
from tests.helpers import behaving, refused
from tests.learning.helpers import SEPARATION, T_MAX


@given(st.integers(0, 2**31), st.integers(1, 12))
def test_weights_stand_for_repeated_trials(seed, trials):
    """Mean and median of weighted trials are NumPy's of trials written out."""
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 6, trials).astype(float)
    among = rng.random(trials) < 0.8
    weights = np.concatenate([np.ones((1, trials)), rng.integers(0, 3, (3, trials))])
    for row, m, mid in zip(
        weights, mean(values, among, weights), median(values, among, weights), strict=True
    ):
        written = np.repeat(values, (row * among).astype(int))
        if len(written):
            assert (m, mid) == (pytest.approx(written.mean()), np.median(written))
        else:
            assert np.isnan([m, mid]).all()


def test_ez_is_that_of_its_paper():
    """Wagenmakers, van der Maas & Grasman 2007: P 0.802, VRT 0.112, MRT 0.723."""
    parameters = ez_diffusion(0.802, 0.723, 0.112, 1000)
    np.testing.assert_allclose(parameters, (0.0999, 0.1400, 0.3000), atol=5e-5)


@given(st.floats(-0.4, 0.4), st.floats(0.05, 0.3), st.floats(0, 0.6))
def test_ez_inverts_the_exact_moments(drift, bound, other_s):
    """Accuracy, mean and variance of a diffusion in closed form give its parameters back."""
    if abs(drift) < 0.01:
        return
    y = -drift * bound / DIFFUSION_S**2
    accuracy = 1 / (1 + np.exp(y))
    mean_s = bound / (2 * drift) * (1 - np.exp(y)) / (1 + np.exp(y)) + other_s
    shape = 2 * y * np.exp(y) - np.exp(2 * y) + 1
    variance = bound * DIFFUSION_S**2 / (2 * drift**3) * shape / (np.exp(y) + 1) ** 2
    parameters = ez_diffusion(accuracy, mean_s, variance, 1e12)
    np.testing.assert_allclose(parameters, (drift, bound, other_s), rtol=1e-3, atol=1e-4)


def test_a_diffusion_is_withheld_where_the_deadline_cuts_off_more_than_a_few():
    """A hundredth of the trials is a few, one more is not; other measures stay."""
    truth = np.arange(1000) % 2
    choice = np.where(np.arange(1000) < 100, 1 - truth, truth)
    times = 300 + 10.0 * (np.arange(1000) % 37)
    for missed, few in ((1, True), (10, True), (11, False)):
        measures = behaving(choice, times, truth, missed).measures(np.ones((1, 1000)))
        known = [np.isfinite(measures[name]).all() for name in OF_DIFFUSION]
        assert known == [few] * 3
        assert np.isfinite(measures["accuracy"]).all()


def test_a_diffusion_is_that_of_the_times_of_right_decisions_in_seconds():
    """Times 400 ms later move its non-decision time alone; times twice as long scale all three."""
    truth, weights = np.arange(500) % 2, np.ones((1, 500))
    choice = np.where(np.arange(500) % 10 < 2, 1 - truth, truth)
    times = 900 + 200 * stream(3, "times").standard_gamma(2.0, 500)
    right = times[choice == truth] / 1000
    want = ez_diffusion(0.8, right.mean(), right.var(), 500)
    measures, later, slower, wrong_later = (
        behaving(choice, t, truth).measures(weights)
        for t in (times, times + 400, 2 * times, times + 400 * (choice != truth))
    )
    assert (measures["accuracy"], measures["decided"]) == (pytest.approx([0.8]), [500])
    assert (measures["drift"][0], measures["boundary_separation"][0]) == pytest.approx(want[:2])
    assert measures["non_decision_ms"][0] == pytest.approx(1000 * want[2])
    assert later["non_decision_ms"][0] == pytest.approx(measures["non_decision_ms"][0] + 400)
    assert slower["non_decision_ms"][0] == pytest.approx(2 * measures["non_decision_ms"][0])
    for name, other in (("drift", 0.5**0.5), ("boundary_separation", 2**0.5)):
        assert later[name] == pytest.approx(measures[name])
        assert wrong_later[name] == pytest.approx(measures[name])
        assert slower[name] == pytest.approx(other * measures[name])


def test_a_diffusion_with_a_time_below_0_is_withheld_whatever_the_resample():
    """RTs whose SD is as large as their mean, which no unbiased diffusion produces."""
    truth = np.arange(200) % 2
    choice = np.where(np.arange(200) % 5 == 0, 1 - truth, truth)
    scattered = np.where(np.arange(200) % 4 < 2, 50.0, 1500.0)
    weights = np.concatenate([np.ones((1, 200)), stream(2, "w").integers(0, 3, (50, 200))])
    measures = behaving(choice, scattered, truth).measures(weights)
    assert all(np.isnan(measures[name]).all() for name in OF_DIFFUSION)
    assert np.isfinite(measures["mean_ms"]).all()
    # Without the first row too: a sweep asks for its resamples in parts.
    assert np.isnan(behaving(choice, scattered, truth).measures(weights[1:])["drift"]).all()
    later = behaving(choice, scattered + 1000, truth).measures(weights)
    assert all(np.isfinite(later[name]).all() for name in OF_DIFFUSION)
    assert later["non_decision_ms"][0] > 0


def test_the_share_of_the_first_alternative_is_of_those_decided():
    truth = np.arange(200) % 2
    choice = np.where(np.arange(200) < 150, 0, 1)
    behaviour = behaving(choice, 300 + 10.0 * np.arange(200), truth, missed=40)
    assert behaviour.measures(np.ones((1, 200)))["choice_0"][0] == 150 / 160
    weights = np.where(np.arange(200) < 10, 1.0, 0.0)[None]
    assert behaviour.measures(weights)["choice_0"][0] == 1


@given(st.integers(0, 2**31), st.integers(0, 40))
def test_all_trials_count_with_what_missed_ones_can_make_of_them(seed, missed):
    """Errors at the least, correct at the most, and the time of the deadline."""
    rng = stream(seed, "all")
    truth, choice = np.arange(40) % 2, rng.integers(0, 2, 40)
    times = 300 + 10.0 * rng.integers(0, 90, 40)
    times[40 - missed :] = 1250.0
    weights = rng.integers(0, 3, (3, 40)).astype(float) + (np.arange(40) == 0)
    values = behaving(choice, times, truth, missed).measures(weights)
    decided = np.arange(40) < 40 - missed
    right, total = decided & (choice == truth), weights.sum(axis=1)
    np.testing.assert_allclose(values["accuracy_all"], weights @ right / total)
    np.testing.assert_allclose(values["accuracy_best"], weights @ (right | ~decided) / total)
    np.testing.assert_allclose(values["mean_all_ms"], weights @ times / total)
    np.testing.assert_allclose(values["accuracy_best"] - values["accuracy_all"], values["missed"])


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
