"""Comparison of two integrators: what is known exactly, what must fail, and what is said."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import norm

from bgmodel import Msprt, stream
from bgmodel.bootstrap import check_resamples, check_trials, interval, resampled
from bgmodel.comparison import matched
from bgmodel.deciding.calibration import calibration, miscalibrated, warn_of_calibration
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import Tradeoff, curve, decides_without_evidence, margin, tradeoff
from bgmodel.integrators.baselines import Lca, Race
from bgmodel.simulated_evidence import separated_evidence
from circuits.errors import CalibrationWarning, DeadlineWarning
from tests.helpers import refused, unwarned

EVIDENCE = separated_evidence(800, 60, 0.5, rng=stream(1, "comparison"), hypotheses=4, step_ms=50.0)
TRACE = Msprt().run(EVIDENCE)
TEST = tradeoff(TRACE, EVIDENCE)


def measured(other, **options):
    settings = {"rng": stream(2, "bootstrap"), "truth": EVIDENCE.truth, "resamples": 200} | options
    return matched.matched_measures(TEST, other, **settings)


def value(table, measure, accuracy=None, column="value"):
    rows = table[table["measure"] == measure]
    rows = rows[rows["accuracy"] == accuracy] if accuracy else rows
    return rows[column].iloc[0]


def test_a_test_agrees_with_itself():
    table = measured(TEST)
    for measure, wanted in {
        "agreement": 1, "error_agreement": 1, "pearson_r": 1, "within_50_ms": 1, "extra_ms": 0,
        "accuracy_gap": 0,
    }.items():  # fmt: skip
        for column in ("value", "low", "high"):
            values = table.loc[table["measure"] == measure, column]
            np.testing.assert_allclose(values, wanted, atol=1e-7, err_msg=measure)
    assert matched.equivalent(table).all()


def test_a_delay_is_extra_time_and_nothing_else():
    """Less than a reading, so that no more is known when it decides."""
    late = tradeoff(replace(TRACE, time_ms=TRACE.time_ms + 40.0), EVIDENCE, TEST.settings)
    table = measured(late)
    assert value(table, "extra_ms", 0.95) == pytest.approx(40, abs=1e-6)
    assert value(table, "pearson_r", 0.95) == pytest.approx(1)
    assert matched.equivalent(table).all()
    # Unless it is declared to be decision time.
    assert (measured(late, latency_ms=0.0).query("measure == 'accuracy_gap'")["high"] < 0).all()


def test_forced_is_the_share_of_trials_that_the_deadline_decides():
    some = np.broadcast_to(np.arange(800) < 200, TEST.forced.shape)
    table = measured(replace(TEST, forced=some), accuracies=(0.9,))
    error = np.sqrt(0.25 * 0.75 / 800)
    assert value(table, "forced") == pytest.approx(0.25)
    assert value(table, "forced", column="low") == pytest.approx(0.25 - 1.96 * error, abs=0.01)


@pytest.mark.parametrize("kind", ["sign", "shuffled"])
def test_wrong_evidence_reaches_no_accuracy_that_could_agree(kind):
    """Negative controls: an accuracy that is not reached gives no figure, and no interval."""
    values = EVIDENCE.log_likelihood
    wrong = replace(EVIDENCE, log_likelihood=-values if kind == "sign" else values[::-1].copy())
    swept = tradeoff(Msprt().run(wrong), EVIDENCE)
    assert swept.posterior.mean(axis=1).max() < 0.5
    table = measured(swept)
    assert table[["value", "low", "high"]].isna().all(axis=None)
    assert not matched.equivalent(table).any()


def test_the_interval_of_a_proportion_is_the_binomial_one():
    rng = stream(3, "noise")
    noisy = Trace(TRACE.out_nats + rng.normal(0, 0.5, TRACE.out_nats.shape), TRACE.time_ms, 0, 50.0)
    table = measured(tradeoff(noisy, EVIDENCE), resamples=2000)
    p = value(table, "agreement", 0.9)
    width = value(table, "agreement", 0.9, "high") - value(table, "agreement", 0.9, "low")
    assert width == pytest.approx(2 * 1.96 * np.sqrt(p * (1 - p) / 800), rel=0.15)


def test_a_difference_has_an_interval_of_its_own():
    race = tradeoff(Race().run(EVIDENCE), EVIDENCE)
    assert (measured(race, minus=race)["value"] == 0).all()
    table = measured(race, minus=TEST)
    assert value(table, "agreement", 0.95) == value(measured(race), "agreement", 0.95) - 1
    assert value(table, "extra_ms", 0.95, "low") > 0


def test_without_a_truth_all_but_the_errors_is_known():
    table = measured(TEST, truth=None)
    assert {"agreement", "accuracy_gap"} <= set(table["measure"])
    assert not {"accuracy", "error_agreement"} & set(table["measure"])


def test_parts_join_to_the_whole():
    parts = [tradeoff(Msprt().run(EVIDENCE[s]), EVIDENCE[s], TEST.settings)
             for s in (slice(0, 300), slice(300, 800))]  # fmt: skip
    joined = parts[0] + parts[1]
    for name in ("choice", "time_ms", "forced", "premature", "posterior"):
        assert np.array_equal(getattr(joined, name), getattr(TEST, name)), name
    with refused("thresholds over the same settings"):
        parts[0] + tradeoff(TRACE, EVIDENCE, [0.1, 0.2])


def test_bad_input_is_refused():
    few = tradeoff(Msprt().run(EVIDENCE[:50]), EVIDENCE[:50])
    with refused("other"):
        measured(few)
    with refused("trials"):
        matched.matched_measures(few, few, rng=stream(1, "x"))
    with refused("trials"):
        check_trials(99)
    check_trials(100)


def test_an_accuracy_is_reached_within_a_share_of_the_errors_that_it_leaves():
    assert margin(0.8) == 0.01
    assert margin(0.9) == pytest.approx(0.01)
    assert margin(0.98) == pytest.approx(0.002)
    reached = curve(TEST, np.ones((1, 800)))[0][0]
    # None of its thresholds gives more than 0.974: 0.98 is 0.006 away, and leaves 0.02 of errors.
    some = TEST.at(reached < 0.974)
    values = measured(some, accuracies=(0.9, 0.98)).set_index(["accuracy", "measure"])["value"]
    assert values[0.9, "agreement"] == 1
    assert np.isnan(values[0.98, "agreement"])


def staircase(reached, name):
    """Return 100 trials: the k-th setting has the k-th expected accuracy and a mean of 100 k ms."""
    shape = len(reached), 100
    noise = stream(4, name).normal(0, 10, shape)
    times = 100.0 * np.arange(shape[0])[:, None] + noise - noise.mean(axis=1, keepdims=True)
    none, settings = np.zeros(shape, dtype=bool), np.linspace(2, 1, shape[0])
    posterior = np.broadcast_to(np.asarray(reached)[:, None], shape)
    return Tradeoff(settings, np.zeros(shape, dtype=int), times, none, none, posterior)


def test_all_are_matched_at_the_accuracy_asked_for_between_their_settings():
    test = staircase([0.80, 0.87, 0.892, 0.96], "test")
    other = staircase([0.85, 0.893, 0.9001, 0.95], "other")
    measures = matched.matched_measures(
        test, other, rng=stream(1, "b"), accuracies=(0.9,), resamples=20
    )
    measures = measures.set_index("measure")["value"]
    share = (0.9 - 0.892) / (0.96 - 0.892), (0.9 - 0.893) / (0.9001 - 0.893)
    assert measures["test_ms"] == pytest.approx(100 * (2 + share[0]), abs=3)
    assert measures["extra_ms"] == pytest.approx(100 * (1 + share[1] - 2 - share[0]), abs=3)
    assert measures["threshold"] == pytest.approx(
        other.settings[1] + share[1] * (other.settings[2] - other.settings[1])
    )


@given(arrays(float, st.integers(1, 9), elements=st.floats(0.5, 1)), st.floats(0.4, 1), st.data())
def test_decisions_at_an_accuracy_have_it(reached, accuracy, data):
    """Or that of the nearest end; a setting between neighbours shares their trials."""
    swept = staircase(np.sort(reached), "any")
    decisions = swept.at_accuracy(accuracy)
    wanted = np.clip(accuracy, reached.min(), reached.max())
    # The division of 100 trials is even to within a few of them.
    assert decisions.posterior.mean() == pytest.approx(wanted, abs=0.04 * np.ptp(reached) + 1e-6)
    above = np.searchsorted(np.sort(reached), wanted - 1e-6)
    near = swept.settings[max(above - 1, 0) :]
    assert near.min() - 1e-9 <= decisions.settings[0] <= near.max() + 1e-9


def test_trials_that_are_alike_in_a_group_make_the_interval_wider():
    """Four copies of each trial tell no more than one: the interval doubles."""
    rng = stream(5, "noise")
    noisy = Trace(TRACE.out_nats + rng.normal(0, 0.5, TRACE.out_nats.shape), TRACE.time_ms, 0, 50.0)
    four = np.arange(800) // 4
    both = [tradeoff(one, EVIDENCE) for one in (TRACE, noisy)]
    names = ("choice", "time_ms", "forced", "premature", "posterior")
    alike = [replace(o, **{name: getattr(o, name)[:, 4 * four] for name in names}) for o in both]
    of = {"truth": EVIDENCE.truth[4 * four], "accuracies": (0.9,)}
    both = ((stream(2, "b"), groups) for groups in (four, None))
    wide, narrow = (matched.matched_measures(*alike, rng=r, groups=g, **of) for r, g in both)
    widths = [value(t, "agreement", 0.9, "high") - value(t, "agreement", 0.9, "low")
              for t in (wide, narrow)]  # fmt: skip
    assert widths[0] == pytest.approx(2 * widths[1], rel=0.2)
    assert value(wide, "agreement", 0.9) == value(narrow, "agreement", 0.9)


def test_a_group_of_one_trial_each_is_no_group():
    alone, each = (resampled(50, 20, stream(1, "g"), g) for g in (None, np.arange(50)))
    assert np.array_equal(alone, each)
    # Two groups are enough: each trial of one is drawn as often as the others of it.
    two = resampled(4, 30, stream(1, "g"), ["a", "a", "b", "b"])
    assert np.array_equal(two[:, [0, 2]], two[:, [1, 3]])
    assert set(two[1:, 0]) == {0, 1, 2}
    with refused("groups must be one per trial"):
        resampled(50, 20, stream(1, "g"), np.arange(40))
    with refused("groups must be two or more for an interval"):
        resampled(50, 20, stream(1, "g"), np.zeros(50))


def test_a_circuit_reads_nothing_if_most_responses_come_within_half_a_second_of_rest():
    """At a constant hazard half a second, twice over, is survived by (1 - p)^2 of the trials."""
    assert [decides_without_evidence(0, p, 500.0) for p in (0.49, 0.51)] == [False, True]
    for p in (0.48, 0.52):
        assert decides_without_evidence(0, 1 - (1 - p) ** 2, 1000.0) == (p > 0.5)
        assert decides_without_evidence(0, 1 - np.sqrt(1 - p), 250.0) == (p > 0.5)
    # Either share is enough, and half is not most.
    assert [decides_without_evidence(p, 0.0, 500.0) for p in (0.5, 0.51)] == [False, True]


@pytest.mark.parametrize(("share", "most"), [(0.45, False), (0.5, False), (0.55, True)])
def test_early_and_forced_decisions_count_in_more_than_half_of_the_trials(share, most):
    """There is no comparison if most are decided before the first reading or by the deadline."""
    some = np.broadcast_to(np.arange(800) < 800 * share, TEST.forced.shape)
    early = replace(TEST, premature=some)
    assert (early.without_evidence == most).all()
    for pair in ((TEST, replace(TEST, forced=some)), (replace(TEST, forced=some), TEST)):
        table = matched.matched_measures(*pair, rng=stream(1, "b"), accuracies=(0.9,), resamples=20)
        assert np.isnan(value(table, "agreement", 0.9)) == most


def test_an_interval_is_known_where_the_value_is_and_all_but_a_twentieth_of_its_resamples():
    values = np.concatenate([[7.0], np.linspace(0, 1, 1000)])
    for unknown, known in ((40, True), (60, False)):
        some = values.copy()
        some[1 : 1 + unknown] = np.nan
        assert interval(some)[0] == 7
        assert np.isfinite(interval(some)[1:]).tolist() == [known, known]
    values[0] = np.nan
    assert np.isnan(interval(values)).all()


def test_an_end_among_infinite_resamples_is_unknown():
    some = np.append(np.linspace(0, 1, 101), [np.inf] * 4)
    with unwarned():
        value, low, high = interval(some)
    assert (value, low) == (0, pytest.approx(0.03, abs=0.01))
    assert not np.isfinite(high)


@pytest.mark.parametrize(
    ("resamples", "groups", "warned"),
    [(99, None, 1), (100, None, 0), (1000, np.arange(40) % 9, 1), (1000, np.arange(40) % 10, 0)],
)
def test_intervals_from_few_resamples_or_groups_are_warned_of(resamples, groups, warned, recwarn):
    check_resamples(resamples, groups)
    assert len(recwarn) == warned


def drawn(trials, steps, seed=1, hypotheses=2):
    options = {"rng": stream(seed, "cautions"), "hypotheses": hypotheses, "step_ms": 50.0}
    return separated_evidence(trials, steps, 0.4, **options)


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
    top = f"{matched.accuracy_after(evidence):.3f}"
    warning = rf"no threshold reaches .* of 0.9, 0.99: all readings .*, 5 at most, allow {top};"
    with pytest.warns(DeadlineWarning, match=warning):
        assert matched.warn_of_readings(evidence, (0.7, 0.9, 0.99)) == [0.7]
    assert silent(matched.warn_of_readings, drawn(400, 120), (0.7, 0.9, 0.99)) == [0.7, 0.9, 0.99]


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
    with pytest.warns(CalibrationWarning, match=f"too {sure}"):
        Msprt().decide(scaled(drawn(1000, 60), factor), posterior=0.9)


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
    warning = r"LCA reaches no accuracy of 0.99: at the best .* 0\.[5-9]"
    with pytest.warns(DeadlineWarning, match=warning):
        matched.warn_of_missed("LCA", leaky, (0.7, 0.99))
    test = tradeoff(Msprt().run(evidence), evidence)
    silent(matched.warn_of_missed, "MSPRT", test, (0.7, 0.99))


def test_without_decisions_there_is_nothing_to_say():
    assert calibration(np.nan, np.nan, 0) == miscalibrated(np.nan, np.nan, 0) == ""
    silent(warn_of_calibration, np.array([]), np.array([], dtype=bool))
