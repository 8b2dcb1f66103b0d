"""The recursive MSPRT against the MSPRT one reading later, and what a wrong window does to it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.methods.recursive import LOOP_READINGS, RecursiveMsprt
from bgmodel import Msprt, first_crossing, stream
from bgmodel.evidence import Evidence
from bgmodel.simulated_evidence import separated_evidence


def drawn(steps=30, hypotheses=4, seed=1):
    rng = stream(seed, "recursive")
    return separated_evidence(60, steps, 0.5, rng=rng, hypotheses=hypotheses, step_ms=10.0)


def msprt_one_later(evidence):
    """Return the MSPRT's OUT a reading later, flat before it has heard of the prior."""
    out = Msprt().run(evidence).out_nats
    first = np.full_like(out[:, :1], np.log(evidence.hypotheses))
    return np.concatenate([first, out[:, :-1]], axis=1)


@pytest.mark.parametrize("steps", [1, 2, 3, 30])
@pytest.mark.parametrize("hypotheses", [2, 4])
def test_all_readings_without_the_loop_are_the_msprt_one_later(hypotheses, steps):
    evidence = drawn(steps, hypotheses)
    found = RecursiveMsprt(window=None, loop=False).run(evidence).out_nats
    np.testing.assert_allclose(found, msprt_one_later(evidence), atol=1e-9)


@given(
    steps=st.integers(1, 12),
    hypotheses=st.integers(2, 5),
    baseline=st.floats(-20, 20),
    feedback=st.floats(-2, 2),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40)
def test_a_window_as_long_as_the_loop_is_the_msprt_one_later(
    steps, hypotheses, baseline, feedback, seed
):
    """Whatever is common: each reading counts once, and the prior is one of them."""
    rng = stream(seed, "prior")
    drawn_ = drawn(steps, hypotheses, seed)
    prior = rng.dirichlet(np.ones(hypotheses))
    evidence = Evidence(drawn_.log_likelihood, drawn_.truth, prior=prior, step_ms=10.0)
    model = RecursiveMsprt(baseline=baseline, feedback=feedback)
    found = model.run(evidence).out_nats
    np.testing.assert_allclose(found, msprt_one_later(evidence), atol=1e-8)


def test_decisions_are_the_msprts_one_reading_later():
    evidence = drawn(80)
    one, two = (first_crossing(m.run(evidence), 0.2) for m in (Msprt(), RecursiveMsprt()))
    done = ~one.forced & ~two.forced
    assert done.mean() > 0.9
    assert np.array_equal(one.choice[done], two.choice[done])
    assert np.array_equal(one.time_ms[done] + 10, two.time_ms[done])


@pytest.mark.parametrize(("window", "share"), [(2, 2 / 3), (4, 4 / 3), (6, 2.0)])
def test_another_window_counts_readings_more_or_less_than_once(window, share):
    """Of constant evidence in one channel, after many turns: the share of readings summed."""
    steps = 300
    readings = np.zeros((1, steps, 2))
    readings[:, :, 0] = 0.01
    evidence = Evidence(readings, np.array([0]), step_ms=10.0)
    out = RecursiveMsprt(window=window).run(evidence).out_nats[0]
    found = (out[:, 1] - out[:, 0])[-1]
    assert found == pytest.approx(share * 0.01 * steps, abs=0.01 * 3 * LOOP_READINGS)


def test_without_the_loop_a_short_window_forgets():
    evidence = drawn(60)
    out = RecursiveMsprt(window=3, loop=False).run(evidence).out_nats
    last = evidence.log_likelihood[:, -4:-1].sum(axis=1)
    np.testing.assert_allclose(out[:, -1], Msprt().output(last), atol=1e-9)


def test_a_window_of_nothing_is_refused():
    with pytest.raises(ValueError, match="window must be"):
        RecursiveMsprt(window=0)


def test_a_window_of_one_reading_without_the_loop_knows_that_one_alone():
    evidence = drawn(20)
    out = RecursiveMsprt(window=1, loop=False).run(evidence).out_nats
    np.testing.assert_allclose(out[:, 2:], Msprt().output(evidence.log_likelihood[:, :-1]))
