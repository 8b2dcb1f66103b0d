"""The stopping rule against a plain loop, and its stated rules for ties, onset and deadline."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, Trace, first_crossing, stream
from bgmodel.deciding.decision import any_crossing, crossing_of_each
from tests.helpers import refused, refusing, some_evidence


def plain_crossing(out, thresholds, first):
    """Decide one trial in the slowest and plainest way: the oracle of the compiled loop.

    Returns the tick, -1 for none, and the channels that are equally good.
    """
    for tick, row in enumerate(out):
        below = thresholds - row
        crossed = below >= 0 if tick >= first else below > 0
        if crossed.any():
            margin = np.where(crossed, below, -np.inf)
            return tick, np.flatnonzero(margin == margin.max())
    return -1, np.flatnonzero(out[-1] == out[-1].min())


@settings(max_examples=200)
@given(
    seed=st.integers(0, 2**31),
    ticks=st.integers(1, 12),
    channels=st.integers(2, 5),
    count=st.integers(1, 6),
    onset=st.integers(0, 4),
)
def test_one_pass_over_thresholds_equals_a_plain_loop(seed, ticks, channels, count, onset):
    rng = np.random.default_rng(seed)
    # Whole numbers make ties and exact hits common.
    out = rng.integers(-3, 6, (7, ticks, channels)).astype(float)
    thresholds = rng.integers(-3, 6, (count, channels)).astype(float)
    ends = rng.integers(1, ticks + 1, 7)
    time_ms = np.arange(ticks, dtype=float)
    decision = first_crossing(Trace(out, time_ms, float(onset), ends=ends), thresholds)
    free = first_crossing(Trace(out, time_ms, float(onset), ends=ends), thresholds, forced=False)
    for k in range(count):
        for n in range(7):
            tick, choices = plain_crossing(out[n, : ends[n]], thresholds[k], onset + 1)
            assert decision.choice[k, n] in choices
            assert decision.forced[k, n] == (tick < 0)
            assert decision.time_ms[k, n] == (tick if tick >= 0 else ends[n] - 1) - onset
            assert decision.premature[k, n] == (0 <= tick <= onset)
            assert decision.deadline_ms[n] == ends[n] - 1 - onset
            assert free.choice[k, n] == (decision.choice[k, n] if tick >= 0 else -1)
            assert np.isnan(free.time_ms[k, n]) == (tick < 0)


def test_each_trial_at_its_own_threshold_is_decided_as_at_that_threshold():
    """In a table of unequal lengths, where each trial ends at its own last reading."""
    full, thresholds = some_evidence(steps=12), np.linspace(0.02, 1.0, 9)
    lengths = stream(3, "lengths").integers(1, 13, full.trials)
    values = full.log_likelihood * (np.arange(12) < lengths[:, None])[..., None]
    evidence = Evidence(values, full.truth, lengths=lengths)
    trace = Msprt().run(evidence)
    decision = first_crossing(trace, thresholds)
    assert decision.deadline_ms.tolist() == lengths.tolist()
    levels = thresholds[np.arange(evidence.trials) % 9]
    each = crossing_of_each(trace, levels)
    rows = np.arange(evidence.trials) % 9, np.arange(evidence.trials)
    assert (each.choice == decision.choice[rows]).all()
    assert (each.time_ms == decision.time_ms[rows]).all()


@pytest.mark.parametrize("hypotheses", [2, 3, 5])
@pytest.mark.parametrize("threshold", [-np.log(0.99), 0.999 * np.log(2), "chance"])
def test_evidence_that_says_nothing_is_shared_out_equally(hypotheses, threshold):
    """Forced or met at once, each of N equal channels is chosen in 1 / N of trials."""
    trials = 30_000
    flat = Evidence(np.zeros((trials, 4, hypotheses)), np.arange(trials) % hypotheses)
    trace = Msprt().run(flat)
    level = np.log(hypotheses) if threshold == "chance" else threshold
    decision = first_crossing(trace, level)
    assert decision.forced.all() == (level < np.log(hypotheses))
    share = np.bincount(decision.choice, minlength=hypotheses) / trials
    sd = np.sqrt((1 - 1 / hypotheses) / hypotheses / trials)
    assert np.abs(share - 1 / hypotheses).max() < 4 * sd
    # The order of trials, which often is that of the truth, tells nothing either.
    correct = (decision.choice == flat.truth).mean()
    assert abs(correct - 1 / hypotheses) < 4 * sd
    neighbours = (decision.choice[1:] == decision.choice[:-1]).mean()
    assert abs(neighbours - 1 / hypotheses) < 4 * sd
    part = first_crossing(Msprt().run(flat[1000:1300]), level)
    assert np.array_equal(part.choice, decision.choice[1000:1300])


GAMMA = 0x9E3779B97F4A7C15


def splitmix(state):
    """Return the output of SplitMix64 after a state, in whole numbers (Steele et al. 2014)."""
    z = (state + GAMMA) % 2**64
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % 2**64
    z = (z ^ z >> 27) * 0x94D049BB133111EB % 2**64
    return z ^ z >> 31


def test_ties_are_drawn_by_the_published_hash_of_the_trials_number():
    """Draws appear in tables that are compared byte by byte."""
    assert splitmix(1234567) == 6457827717110365317
    numbers = np.array([*range(60), 10**9, 2**40 + 3])
    for hypotheses in (2, 5):
        flat = Trace(np.ones((len(numbers), 1, hypotheses)), np.zeros(1), numbers=numbers)
        choices = first_crossing(flat, 0.5).choice
        for number, choice in zip(numbers.tolist(), choices, strict=True):
            want = 0
            for equal in range(2, hypotheses + 1):
                drawn = splitmix(splitmix((number * GAMMA + equal) % 2**64))
                # The last of n, with a chance of 1 / n.
                want = want if (drawn >> 32) * equal >> 32 else equal - 1
            assert choice == want


def test_a_prior_beyond_its_threshold_is_a_premature_response():
    evidence = some_evidence(hypotheses=2, prior=[0.2, 0.8], onset_ms=100.0, step_ms=50.0)
    eager = first_crossing(Msprt().run(evidence), -np.log(0.7), checked=False)
    assert eager.premature.all()
    assert (eager.choice == 1).all()
    assert (eager.time_ms == -100).all()
    assert (eager.steps == 0).all()
    patient = first_crossing(Msprt().run(evidence), -np.log(0.9))
    assert not patient.premature.any()
    assert (patient.time_ms >= 50).all()


TRACE = Msprt().run(some_evidence())


test_thresholds_without_sense_are_refused = refusing(
    (lambda: first_crossing(TRACE, np.nan), "thresholds finite"),
    (lambda: first_crossing(TRACE, np.ones((2, 2))), r"thresholds \(K, 3\)"),
    (lambda: first_crossing(TRACE, []), r"thresholds \(K, 3\)"),
    (lambda: first_crossing(TRACE, np.ones((1, 1, 3))), r"thresholds \(K, 3\)"),
    (lambda: crossing_of_each(TRACE, [0.3]), "thresholds 300 finite nats"),
    (lambda: crossing_of_each(TRACE, [np.inf] * 300), "thresholds 300 finite"),
)


def test_more_hypotheses_than_a_byte_holds_are_told_apart():
    out = np.ones((1, 2, 200))
    out[0, 1, 190] = -1
    assert first_crossing(Trace(out, np.array([0.0, 1.0])), 0.0).choice[0] == 190


def test_a_crossing_between_onset_and_the_first_reading_is_premature():
    time_ms = np.arange(1, 101.0)
    out = np.ones((2, 100, 2))
    out[0, 30:, 0] = 0.1  # 31 ms: nothing has been read yet
    out[1, 49:, 1] = 0.1  # 50 ms: the first reading
    decision = first_crossing(Trace(out, time_ms, 0.0, 50.0), 0.2)
    assert decision.premature.tolist() == [True, False]
    assert decision.time_ms.tolist() == [31.0, 50.0]


def test_without_evidence_only_an_output_below_the_threshold_is_a_response():
    """The rule is that up to the onset of evidence: equality decides nothing."""
    out = np.array([[[0.5, 0.7], [0.4, 0.7]], [[0.5, 0.7], [0.3, 0.7]], [[0.9, 0.2], [0.9, 0.9]]])
    assert any_crossing(out, 0.4).tolist() == [False, True, True]
    assert any_crossing(out[:, :1], 0.4).tolist() == [False, False, True]


def test_an_undecided_trial_is_neither_right_nor_wrong_in_the_table():
    trace = Trace(
        np.array([[[0.1, 2.0]], [[2.0, 0.1]], [[2.0, 2.0]]]), np.array([1.0]), step_ms=1.0
    )
    decision = replace(first_crossing(trace, 1.0, forced=False), truth=np.zeros(3, int))
    correct = decision.to_dataframe()["correct"]
    assert correct.tolist()[:2] == [True, False]
    assert correct.isna().tolist() == [False, False, True]
    assert correct.mean() == decision.accuracy == 0.5


def test_a_trace_is_drawn_up_to_the_end_of_its_trial_from_the_onset_of_evidence():
    out = np.arange(24.0).reshape(2, 4, 3)
    trace = Trace(out, np.arange(4) * 10.0, onset_ms=20.0, ends=np.array([4, 3]))
    lines = trace.plot(1).axes[0].lines[:3]
    assert [line.get_xdata().tolist() for line in lines] == [[-20, -10, 0]] * 3
    assert [line.get_ydata().tolist() for line in lines] == out[1, :3].T.tolist()
    with refused("trial must be"):
        trace.plot(2)
