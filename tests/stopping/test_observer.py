"""The ideal observer of the stop-signal task: calibration and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel.stopping.observer import (
    StopMsprt,
    first_reading,
    gaussian_stop_evidence,
    log_odds_of_stop,
)
from bgmodel.stopping.trials import drawn_delays, stop_trials
from tests.helpers import refusing

STEP_MS, STEPS, SHARE = 10.0, 80, 0.3
DELAYS = np.array([100.0, 200.0, 300.0])


def signals(go, ssd, d_prime=0.6, share=SHARE, **options):
    return gaussian_stop_evidence(go, ssd, d_prime=d_prime, share=share, **options)


def task(trials, seed, *, stop_d_prime=0.6, share=SHARE, channels=2):
    timed = {"t_max": STEPS, "step_ms": STEP_MS}
    go = bg.gaussian_evidence(trials, d_prime=0.35, seed=seed, channels=channels, **timed)
    rng = np.random.default_rng(seed + 1)
    ssd = drawn_delays(trials, DELAYS, share, rng)
    return signals(go, ssd, stop_d_prime, share, delays_ms=DELAYS, rng=rng)


def brute_force(evidence, trial, t):
    """Return P(stop) after t readings, by summing over every time at which it may begin."""
    ratios = evidence.log_ratio[trial, :t]
    odds = sum(f * np.exp(ratios[k:].sum()) for k, f in enumerate(evidence.begins))
    odds *= evidence.share / (1 - evidence.share)
    return odds / (1 + odds)


def test_the_recursion_is_the_sum_over_all_times_of_the_signal():
    evidence = task(5, 3)
    z = log_odds_of_stop(evidence)
    for trial in range(5):
        for t in (0, 1, 10, 11, 25, 40, STEPS):
            assert 1 / (1 + np.exp(-z[trial, t])) == pytest.approx(brute_force(evidence, trial, t))


@pytest.mark.parametrize("late", [15, 30, 60])
def test_it_is_calibrated(late):
    """Among trials with P(stop) = p, a proportion p has a stop signal; likewise for responses."""
    evidence = task(20_000, 5)
    p = np.exp(-StopMsprt().run(evidence).out_nats[:, late])
    stop = ~np.isnan(evidence.ssd_ms)
    for one, is_true in ((p[:, 2], stop), (p[:, 0], ~stop & (evidence.go.truth == 0))):
        bins = np.minimum((10 * one).astype(int), 9)
        for k in np.unique(bins):
            here = bins == k
            error = np.sqrt(0.25 / here.sum())
            assert is_true[here].mean() == pytest.approx(one[here].mean(), abs=4 * error)


def test_an_abrupt_signal_is_the_horse_race():
    """Strong stop evidence blocks responses from its first reading on (Logan & Cowan 1984)."""
    evidence = task(4000, 6, stop_d_prime=12.0, share=0.5)
    decision = StopMsprt().decide(evidence, 0.9, 0.999)
    trials = stop_trials(decision, evidence.ssd_ms, 2)
    z = log_odds_of_stop(evidence)
    # Without stop evidence, the chance of a signal to come alone delays the responses.
    silent = np.where(np.isnan(evidence.ssd_ms)[:, None], z, np.nan)
    before = np.nanmax(silent, axis=0)
    out = bg.Msprt().run(evidence.go).out_nats + np.logaddexp(0, before)[:, None]
    crossed = (out <= -np.log(0.9)).any(axis=2)
    go_ms = np.where(crossed.any(axis=1), crossed.argmax(axis=1), np.inf) * STEP_MS
    finish = STEP_MS * first_reading(DELAYS, STEP_MS)
    for delay, end in zip(DELAYS, finish, strict=True):
        here = evidence.ssd_ms == delay
        assert trials.responded[here].mean() == pytest.approx((go_ms[here] < end).mean(), abs=0.01)


def test_an_extra_channel_stops_less_the_more_evidence_there_is_in_all():
    """It adds ln(1 + exp(z - S)) to every OUT, the ideal observer ln(1 + exp z)."""
    evidence = task(50, 8, channels=4)
    z = log_odds_of_stop(evidence)
    go = bg.Msprt().run(evidence.go).out_nats
    ideal = StopMsprt().run(evidence).out_nats[..., :4] - go
    extra = StopMsprt(extra_channel=True).run(evidence).out_nats[..., :4] - go
    s = np.log(np.exp(evidence.go.own_totals).sum(axis=2))
    assert ideal == pytest.approx(np.repeat(np.logaddexp(0, z)[..., None], 4, axis=2))
    assert extra == pytest.approx(np.repeat(np.logaddexp(0, z - s)[..., None], 4, axis=2))


GO = bg.gaussian_evidence(2, d_prime=0.5, t_max=10, step_ms=10, seed=1)


test_evidence_that_does_not_fit_is_refused = refusing(
    (lambda: replace(task(2, 1), share=1.0), "share between"),
    (lambda: replace(task(2, 1), begins=np.ones(STEPS)), "begins sum to 1"),
    (lambda: replace(task(2, 1), log_ratio=np.zeros((3, STEPS))), "log_ratio shape"),
    (lambda: replace(task(2, 1), ssd_ms=np.zeros(3)), "ssd_ms shape"),
    (lambda: signals(GO, [np.nan, 50.0], delays_ms=[100.0], rng=1), "delays_ms before the end"),
)


@given(
    ssd_ms=st.floats(0.0, 500.0) | st.integers(0, 50).map(lambda k: 10.0 * k),
    step_ms=st.sampled_from([1.0, 5.0, 10.0, 12.5]),
)
def test_the_first_reading_with_the_signal_is_the_earliest_one_after_the_delay(ssd_ms, step_ms):
    times = step_ms * np.arange(1, 1000)
    assume((np.abs(times - ssd_ms) > 1e-6).all() or (times == ssd_ms).any())
    assert first_reading(np.array(ssd_ms), step_ms) == 1 + np.argmax(times > ssd_ms)
