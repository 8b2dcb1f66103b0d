"""The SPRT and MSPRT: two hypotheses, streams, calibration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, Sprt, first_crossing, stream
from bgmodel.integrators.first_passage import Empirical
from bgmodel.integrators.sprt import tally_sprt, threshold_from_posterior
from bgmodel.integrators.sprt_theory import sprt
from bgmodel.simulated_evidence import separated_evidence
from tests.helpers import refusing, some_evidence


def test_a_posterior_and_a_gap_give_one_criterion_each():
    """-ln P, and ln(1 + exp(-gap / 2)): the gap 2 logit P stops where the posterior P does."""
    posterior = np.array([0.6, 0.9, 0.99])
    assert threshold_from_posterior(posterior) == pytest.approx(-np.log(posterior))
    gap = 2 * np.log(posterior / (1 - posterior))
    assert Msprt.threshold(gap) == pytest.approx(threshold_from_posterior(posterior))


def test_two_hypothesis_msprt_is_the_sprt_decision_by_decision():
    evidence = some_evidence(trials=20_000, steps=50, hypotheses=2)
    separations = np.linspace(0, 8, 17)
    a = first_crossing(Sprt().run(evidence), Sprt.threshold(separations))
    b = first_crossing(Msprt().run(evidence), Msprt.threshold(separations))
    assert (a.choice != b.choice).sum() == 0
    assert (a.time_ms != b.time_ms).sum() == 0
    # The control: without the mapping the tests are not the same.
    c = first_crossing(Msprt().run(evidence), np.log1p(np.exp(-separations)))
    assert (a.time_ms != c.time_ms).sum() > 1000


@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize("hypotheses", [2, 3, 8])
def test_streaming_gives_the_batch_decision(hypotheses, precision):
    evidence = some_evidence(trials=60, hypotheses=hypotheses)
    evidence = Evidence(evidence.log_likelihood.astype(precision), evidence.truth)
    for test, threshold in [(Msprt(), 0.3), *[(Sprt(), -1.0)] * (hypotheses == 2)]:
        batch = first_crossing(test.run(evidence), threshold)
        session = test.session(hypotheses, threshold, t_max=evidence.steps)
        for n in range(evidence.trials):
            readings = iter(evidence.log_likelihood[n])
            while session.decision is None:
                session.add(next(readings))
            assert session.decision.choice[0] == batch.choice[n]
            assert len(session.readings) == batch.steps[n]
            session.next()


@pytest.mark.parametrize("hypotheses", [2, 3, 8])
def test_mean_posterior_at_stopping_is_the_accuracy(hypotheses):
    """The martingale identity, exact for true likelihoods, in one z-test a threshold."""
    evidence = separated_evidence(
        20_000, 60, 0.5, hypotheses=hypotheses, rng=stream(11, "martingale", hypotheses)
    )
    trace = Msprt().run(evidence)
    decision = first_crossing(trace, -np.log([0.7, 0.9, 0.97]))
    tick = decision.steps.astype(int)
    for k in range(3):
        stated = np.exp(-trace.out_nats[np.arange(evidence.trials), tick[k], decision.choice[k]])
        gap = (decision.choice[k] == evidence.truth) - stated
        assert abs(gap.mean()) < 4 * gap.std() / np.sqrt(evidence.trials)
    wrong = first_crossing(Msprt(gain=1.5).run(evidence), -np.log(0.9))
    out = Msprt(gain=1.5).run(evidence).out_nats
    stated = np.exp(-out[np.arange(evidence.trials), wrong.steps.astype(int), wrong.choice])
    gap = (wrong.choice == evidence.truth) - stated
    assert abs(gap.mean()) > 10 * gap.std() / np.sqrt(evidence.trials)


def test_sums_equal_up_to_rounding_are_equal():
    """Evidence of +-0.1 nats: bounds and ties are hit exactly, though floats miss them."""
    rng = stream(9, "rounding")
    trials, steps = 40_000, 30
    truth = np.arange(trials) % 2
    x = np.where(rng.random((trials, steps)) < 0.6, 0.1, -0.1) * np.where(truth, 1, -1)[:, None]
    evidence = Evidence(np.stack([np.minimum(-x, 0), np.minimum(x, 0)], axis=-1), truth)
    separations = np.array([0.4, 1.6, 4.0])
    a = first_crossing(Sprt().run(evidence), Sprt.threshold(separations))
    b = first_crossing(Msprt().run(evidence), Msprt.threshold(separations))
    assert (a.choice != b.choice).sum() + (a.time_ms != b.time_ms).sum() == 0
    pair = Empirical([-0.1, 0.1], [0.6, 0.4]), Empirical([-0.1, 0.1], [0.4, 0.6])
    exact = sprt(*pair, separations, t_max=steps)
    error = (a.steps.mean(axis=1) - exact.mean_steps) / (a.steps.std(axis=1) / np.sqrt(trials))
    assert np.abs(error).max() < 4


test_tests_and_criteria_without_sense_are_refused = refusing(
    (lambda: threshold_from_posterior(1.0), "posterior and 1, got 1.0"),
    (lambda: threshold_from_posterior(0.3, 3), "posterior chance, 0.333 with 3 hypotheses"),
    (lambda: Sprt().run(some_evidence()), "evidence exactly 2 hypotheses"),
    (lambda: Msprt(gain=0.0), "gain must be > 0"),
    (lambda: tally_sprt(some_evidence(hypotheses=2), [[-1.0]]), "thresholds must be .K,."),
    (lambda: tally_sprt(some_evidence(hypotheses=2), []), "thresholds must be .K,."),
    (
        lambda: tally_sprt(some_evidence(hypotheses=2), [np.nan]),
        "thresholds finite nats, got .nan.",
    ),
    (lambda: threshold_from_posterior(0.9, 1), "hypotheses"),
)


@given(
    seed=st.integers(0, 2**32),
    rounded=st.booleans(),
    prior=st.floats(0.1, 0.9),
    gaps=st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.5, 4.0]), min_size=1, max_size=5),
)
@settings(max_examples=60)
def test_a_tally_without_the_trace_counts_the_same(seed, rounded, prior, gaps):
    rng = np.random.default_rng(seed)
    values = rng.normal(0, 1, (30, 8, 2))
    values = np.round(values) / 2 if rounded else values  # whole ones meet bars, and tie
    lengths = rng.integers(1, 9, 30)
    values[np.arange(8) >= lengths[:, None]] = 0
    evidence = Evidence(
        values,
        rng.integers(0, 2, 30),
        prior=np.array([1 - prior, prior]),
        lengths=lengths,
        numbers=rng.permutation(100)[:30],
    )
    thresholds = Sprt.threshold(gaps)
    decision = first_crossing(Sprt().run(evidence), thresholds, checked=False)
    counts, halves = tally_sprt(evidence, thresholds), (evidence[:15], evidence[15:])
    for counted in (counts, tally_sprt(halves[0], thresholds) + tally_sprt(halves[1], thresholds)):
        assert counted.trials == 30
        assert np.array_equal(counted.correct, (decision.choice == evidence.truth).sum(axis=1))
        assert np.array_equal(counted.steps, decision.steps.sum(axis=1))
        assert np.array_equal(counted.forced, decision.forced.sum(axis=1))


def test_a_deadline_may_be_one_reading():
    """The least that there is: the choice is forced by it, whatever the threshold."""
    for test in (Sprt(), Msprt()):
        session = test.session(2, -50.0 if test == Sprt() else 0.0, t_max=1)
        assert session.decision is None
        assert session.add([0.0, 0.2]).choice[0] == 1
        assert len(session.readings) == 1
