"""What a comparison says of accuracies out of reach, and of posteriors that are not accuracies."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from bgmodel import Msprt, stream
from bgmodel.comparison.matched import accuracy_after, warn_of_missed, warn_of_readings
from bgmodel.deciding.calibration import calibration, miscalibrated, warn_of_calibration
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.integrators.baselines import Lca
from bgmodel.simulated_evidence import separated_evidence
from circuits.errors import CalibrationWarning, DeadlineWarning
from tests.helpers import unwarned


def drawn(trials, steps, seed=1, hypotheses=2):
    return separated_evidence(
        trials, steps, 0.4, rng=stream(seed, "cautions"), hypotheses=hypotheses, step_ms=50.0
    )


def at_criterion(evidence, posterior):
    """Return what is stated of choices at a posterior, and whether they are right."""
    decisions = tradeoff(Msprt().run(evidence), evidence, [-np.log(posterior)])
    return decisions.posterior[0], decisions.choice[0] == evidence.truth


def scaled(evidence, factor):
    return replace(evidence, log_likelihood=factor * evidence.log_likelihood)


def silent(call, *arguments):
    with unwarned():
        return call(*arguments)


def test_an_accuracy_beyond_the_readings_is_said_with_what_they_allow():
    evidence = drawn(400, 5)
    top = f"{accuracy_after(evidence):.3f}"
    warning = rf"no threshold reaches .* of 0.9, 0.99: all readings .*, 5 at most, allow {top};"
    with pytest.warns(DeadlineWarning, match=warning):
        assert warn_of_readings(evidence, (0.7, 0.9, 0.99)) == [0.7]
    assert silent(warn_of_readings, drawn(400, 120), (0.7, 0.9, 0.99)) == [0.7, 0.9, 0.99]


@pytest.mark.parametrize("hypotheses", [2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_posteriors_of_the_right_likelihoods_are_not_warned_of(hypotheses, seed):
    evidence = drawn(1000, 60, seed, hypotheses)
    for posterior in (0.7, 0.9, 0.97):
        silent(warn_of_calibration, *at_criterion(evidence, posterior))


@pytest.mark.parametrize(("factor", "sure"), [(1.6, "sure"), (0.6, "unsure")])
def test_wrong_likelihoods_are_warned_of_with_both_numbers(factor, sure):
    stated, right = at_criterion(scaled(drawn(1000, 60), factor), 0.9)
    warning = rf"too {sure}: .* is {stated.mean():.3f}, and {right.mean():.3f} of 1000 decisions"
    with pytest.warns(CalibrationWarning, match=warning) as caught:
        warn_of_calibration(stated, right)
    low, high = map(float, re.findall(r"interval (\S+) to ([^)]+)\)", str(caught[0].message))[0])
    assert low < (right - stated).mean() < high
    # 99.9 %; the variance of a calibrated choice is P (1 - P).
    variance = max((right - stated).var(), (stated * (1 - stated)).mean())
    assert high - low == pytest.approx(2 * norm.isf(0.0005) * np.sqrt(variance / 1000), abs=2e-3)
    assert low * high > 0


@given(st.floats(0, 1), st.floats(0, 1), st.integers(1, 10**6))
def test_the_sentence_is_said_where_zero_lies_outside_its_interval(posterior, accuracy, decisions):
    sentence = calibration(posterior, accuracy, decisions)
    variance = max(posterior * (1 - posterior), accuracy * (1 - accuracy))
    apart = abs(accuracy - posterior) > 3.29 * np.sqrt(variance / decisions)
    assert bool(sentence) == apart
    which = miscalibrated(posterior, accuracy, decisions)
    assert which == ("" if not apart else "sure" if posterior > accuracy else "unsure")


def test_a_baseline_that_stays_below_what_readings_allow_has_a_ceiling_of_its_own():
    evidence = drawn(400, 120)
    leaky = tradeoff(Lca(leak_hz=20.0, inhibition_hz=0.0).run(evidence), evidence)
    with pytest.warns(
        DeadlineWarning, match=r"LCA reaches no accuracy of 0.99: at the best .* 0\.[5-9]"
    ):
        warn_of_missed("LCA", leaky, (0.7, 0.99))
    test = tradeoff(Msprt().run(evidence), evidence)
    silent(warn_of_missed, "MSPRT", test, (0.7, 0.99))


def test_without_decisions_there_is_nothing_to_say():
    assert calibration(np.nan, np.nan, 0) == miscalibrated(np.nan, np.nan, 0) == ""
    silent(warn_of_calibration, np.array([]), np.array([], dtype=bool))
