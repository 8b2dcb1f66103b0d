"""Evidence: drawn alike for any number of trials, and refused where it makes no sense."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, Trace, first_crossing, stream
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.plausibility import are_sums, products
from bgmodel.simulated_evidence import expecting, separated_evidence
from circuits.errors import DataWarning
from tests.helpers import refused, refusing, some_evidence, told


@pytest.mark.parametrize("trials", [10, 11])
def test_gaussian_trials_do_not_depend_on_those_after_them(trials):
    drawn = lambda n: separated_evidence(n, 5, 0.5, hypotheses=3, rng=stream(12, "x"))  # noqa: E731
    few, many = drawn(trials), drawn(2 * trials)
    assert np.array_equal(few.log_likelihood, many.log_likelihood[:trials])


def test_time_is_counted_in_readings_unless_a_clock_is_given():
    drawn = separated_evidence(2, 3, 0.5, rng=stream(1, "clock"))
    assert drawn.step_ms == Evidence(np.zeros((1, 1, 2))).step_ms == Trace(np.ones(1), 0).step_ms
    assert first_crossing(Msprt().run(drawn), 1e-9).time_ms.tolist() == [3.0, 3.0]


READ = separated_evidence(3, 4, 0.5, rng=1).log_likelihood
MASK = np.arange(12).reshape(2, 3, 2) == 5
test_evidence_without_sense_is_refused = refusing(
    (lambda: some_evidence(prior=[0.5, 0.5, 0.1]), "prior must sum to 1"),
    (lambda: some_evidence(prior=[0.5, 0.5]), "prior hold 3"),
    (lambda: some_evidence(step_ms=0.0), "step_ms"),
    (lambda: Evidence(np.full((1, 1, 2), np.nan), np.array([0])), "log_likelihood finite"),
    (lambda: Evidence(np.full((1, 1, 2), np.inf), np.array([0])), "log_likelihood finite"),
    (lambda: Evidence(np.zeros((0, 1, 2))), "log_likelihood at least one trial"),
    (lambda: Evidence(np.zeros((1, 1, 1)), np.array([0])), "log_likelihood two hypotheses"),
    (lambda: Evidence(np.zeros((1, 1, 2)), np.array([2])), "truth"),
    (lambda: Evidence(np.zeros((1, 1, 2)), np.array([0.0])), "truth"),
    (lambda: some_evidence(lengths=np.full(300, 21)), "lengths must be within 1..20"),
    (
        lambda: some_evidence(lengths=np.full(300, 2)),
        "lengths after the last reading of a trial",
    ),
    (lambda: some_evidence(lengths=[1.5]), "lengths hold one whole number per trial"),
    (lambda: some_evidence(numbers=[1]), "numbers"),
    # Masked readings; nats that drown what tells hypotheses apart.
    (lambda: Evidence(np.ma.array(np.zeros((2, 3, 2)), mask=MASK)), "log_likelihood masked"),
    *(
        (lambda x=x: Evidence(READ + x), "log_likelihood must be within")
        for x in (1e7, -1e7, 1e300)
    ),
)


def small():
    """Return two trials, the first of one reading, the second of two, of two hypotheses."""
    values = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.5, 2.0], [0.0, 1.5]]])
    settings = {"prior": [0.25, 0.75], "lengths": [1, 2], "step_ms": 50.0, "onset_ms": 100.0}
    return Evidence(values, np.array([0, 1]), **settings)


def test_sums_of_what_readings_say():
    drawn = small()
    log = np.log([0.25, 0.75])
    want = log + np.array([[[0, 0], [1, 0], [1, 0]], [[0, 0], [0.5, 2], [0.5, 3.5]]])
    np.testing.assert_allclose(drawn.totals, want, rtol=1e-14)
    odds = np.exp(want[..., 1] - want[..., 0])
    np.testing.assert_allclose(drawn.posterior[..., 1], odds / (1 + odds), rtol=1e-14)
    assert drawn.mean_reading == pytest.approx(5 / 6)  # 3 readings of 2 hypotheses
    sums = replace(drawn, baseline=0.5).own_totals
    read = 0.5 * np.array([[0, 1, 1], [0, 1, 2]])[..., None]  # none after the last reading
    np.testing.assert_allclose(sums, want - log.mean() - read, rtol=1e-14)


def test_a_part_keeps_the_numbers_of_its_trials_and_what_belongs_to_all():
    drawn = small()
    part = drawn[1:]
    assert (part.trials, part.steps, part.hypotheses) == (1, 2, 2)
    assert [part.trial_numbers, part.truth, part.lengths] == [[1], [1], [2]]
    assert part[np.array([True])].trial_numbers.tolist() == [1]
    assert (part.step_ms, part.onset_ms, part.prior.tolist()) == (50.0, 100.0, [0.25, 0.75])


def test_nothing_masked_and_the_longest_times_are_taken():
    assert Evidence(np.ma.array(np.zeros((2, 3, 2)))).trials == 2
    assert replace(small(), step_ms=1e9, onset_ms=1e9).step_ms == 1e9


def test_expectancy_rises_over_the_foreperiod_and_tells_a_test_nothing():
    drawn = separated_evidence(400, 6, 0.5, rng=stream(3, "x"), step_ms=50.0)
    ahead = expecting(drawn, 3.0, 200.0, rng=stream(3, "r"))
    assert ahead.onset_ms == 200
    assert ahead.foreperiod_steps == 4
    assert drawn.foreperiod_steps == 0
    top = ahead.expectancy_nats[:, -1]
    np.testing.assert_allclose(ahead.expectancy_nats, top[:, None] * [0.25, 0.5, 0.75, 1])
    assert 0 <= top.min() < 0.05 < 2.95 < top.max() <= 3
    np.testing.assert_array_equal(ahead.posterior, drawn.posterior)
    assert ahead[10:20].expectancy_nats.shape == (10, 4)
    late = tradeoff(Msprt().run(ahead), ahead, [0.3])
    plain = tradeoff(Msprt().run(drawn), drawn, [0.3])
    for name in ("choice", "time_ms", "posterior", "premature"):
        np.testing.assert_array_equal(getattr(late, name), getattr(plain, name))


@pytest.mark.parametrize("foreperiod_ms", [0.0, 120.0, -50.0, np.nan, np.inf])
def test_expectancy_needs_a_foreperiod(foreperiod_ms):
    drawn = separated_evidence(4, 6, 0.5, rng=stream(3, "x"), step_ms=50.0)
    with refused("foreperiod_ms"):
        expecting(drawn, 3.0, foreperiod_ms, rng=stream(3, "r"))
    with refused("foreperiod_ms"):
        replace(drawn, expectancy_nats=np.zeros((4, 2)))
    with refused("expectancy_nats hold finite nats"):
        replace(drawn, onset_ms=100.0, expectancy_nats=np.zeros((3, 2)))
    with refused("most_nats"):
        expecting(drawn, -1.0, 100.0, rng=stream(3, "r"))


@given(st.integers(0, 2**31), st.integers(12, 40), st.integers(2, 4))
def test_running_sums_and_posteriors_are_doubted_and_single_readings_are_not(seed, steps, channels):
    drawn = separated_evidence(20, steps, 0.5, rng=seed, hypotheses=channels)
    single, sums = drawn.log_likelihood, drawn.log_likelihood.cumsum(axis=1)
    log_posterior = sums - np.logaddexp.reduce(sums, axis=2, keepdims=True)
    assert not told(Evidence, single)
    assert not told(lambda: Evidence(single + 5 * np.sin(np.arange(steps))[:, None]))
    assert len(told(Evidence, sums)) == 1
    assert len(told(Evidence, log_posterior)) == 1


@given(st.integers(0, 2**31))
def test_probabilities_in_place_of_logarithms_are_doubted(seed):
    drawn = separated_evidence(50, 5, 0.5, rng=seed).log_likelihood
    odds = np.exp(drawn)
    assert len(told(lambda: Evidence(odds / odds.sum(axis=2, keepdims=True)))) == 1
    assert not told(lambda: Evidence(np.log(odds)))
    # Counts of events that say little are no probabilities: some are 0.
    assert not told(lambda: Evidence(0.3 * stream(seed, "c").integers(0, 4, (50, 5, 2))))


@pytest.mark.parametrize(("shape", "doubted"), [((9, 2, 40), True), ((9, 40, 2), False)])
def test_more_hypotheses_than_readings_are_doubted(shape, doubted):
    texts = told(Evidence, np.random.default_rng(1).normal(size=shape))
    assert any("axes exchanged" in text for text in texts) == doubted


@pytest.mark.parametrize("lengths", [None, np.repeat([6, 9], 20)])
def test_a_column_that_is_a_copy_of_another_is_doubted(lengths):
    read = np.arange(9) < (np.full(40, 9) if lengths is None else lengths)[:, None]
    values = np.random.default_rng(3).normal(size=(40, 9, 3)) * read[..., None]
    assert not told(Evidence, values, lengths=lengths)
    values[..., 2] = values[..., 0]
    with pytest.warns(DataWarning, match="hypotheses 0 and 2 have the same"):
        Evidence(values, lengths=lengths)
    # Designed trials: those that lose are equal on purpose.
    values = read[..., None] * (np.arange(3) == 1.0)
    assert not told(Evidence, values, lengths=lengths)


def test_a_trial_is_drawn_as_its_posteriors_up_to_its_last_reading():
    evidence = some_evidence(trials=3, steps=6, hypotheses=3)
    lines = evidence.plot(1).axes[0].get_lines()
    assert [line.get_ydata().tolist() for line in lines] == evidence.posterior[1].T.tolist()
    assert lines[int(evidence.truth[1])].get_label().endswith("(true)")
    with refused("trial"):
        evidence.plot(3)


def test_independent_readings_have_no_serial_correlation_however_short_the_trials():
    """Deviations from a trial's mean correlate by -1 / steps, which is subtracted."""
    rng = stream(1, "readings")
    for steps in (4, 10):
        pooled = np.array([products(x) for x in rng.normal(size=(4000, steps, 2))])
        lagged, squares = pooled[:, 0], pooled[:, 1]
        error = lagged.std() / np.sqrt(len(lagged))
        assert abs(lagged.mean()) < 4 * error
        assert squares.mean() / steps > 8 * error  # without the correction it would be seen
        assert not are_sums(pooled.sum(axis=0))
    summed = np.cumsum(rng.normal(size=(50, 10, 2)), axis=1)
    assert are_sums(np.sum([products(x) for x in summed], axis=0))
