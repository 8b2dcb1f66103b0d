"""Inputs with their own time in each trial: what is attached, refused and warned of."""

import math
import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel import plausibility
from bgmodel.deciding.decision import first_crossing
from bgmodel.stopping.inputs import (
    StopSignal,
    closed_form,
    decide_with_stop,
    step_response,
    with_input,
    with_observed_stop,
    with_stop,
)
from bgmodel.stopping.observer import StopMsprt, gaussian_stop_evidence
from bgmodel.stopping.trials import drawn_delays, stop_trials
from circuits import engines
from circuits.errors import ConfoundWarning, EditWarning, NoiseWarning, RangeWarning
from tests.helpers import refusing, told, unwarned

NEVER = math.nan


def evidence(trials, channels=2):
    return bg.gaussian_evidence(trials, channels=channels, t_max=4, step_ms=10, seed=5)


def on_some(some, onset_ms=20.0):
    return np.where(some, onset_ms, NEVER)


@given(st.integers(2, 5), st.integers(2, 6), st.integers(0, 5))
def test_every_mth_trial_is_confounded_if_its_truths_are_not_all_of_them(channels, m, first):
    """Truth follows k mod N: every m-th trial has all truths if m and N have no common divisor."""
    go = evidence(60 * channels, channels)
    light = on_some(np.arange(go.trials) % m == first % m)
    if math.gcd(channels, m) == 1:
        with unwarned():
            with_input(go, light)
        return
    with pytest.warns(ConfoundWarning) as caught:
        with_input(go, light)
    there = set(go.truth[~np.isnan(light)].tolist())
    missed = set(range(channels)) - there
    (one,) = caught
    assert one.filename == __file__
    assert one.message.input == 0
    assert missed <= set(one.message.truths)


@pytest.mark.parametrize("chance", [0.02, 0.2, 0.5])
def test_of_all_ways_to_choose_trials_no_more_than_that_share_warns(monkeypatch, chance):
    """All 252 ways to choose 5 of 10 trials, and those of 3, counted one by one."""
    monkeypatch.setattr(plausibility, "CHANCE", chance)
    truth = np.arange(10) % 2
    for number in (3, 5):
        ways = [np.isin(np.arange(10), some) for some in combinations(range(10), number)]
        warned = [
            told(plausibility.warn_of_confounds, way[:, None, None] * 1.0, truth) for way in ways
        ]
        assert sum(map(bool, warned)) <= chance * len(ways)


@pytest.mark.parametrize(("trials", "warns"), [(8, False), (16, False), (24, True), (100, True)])
def test_few_trials_may_be_aligned_by_chance(trials, warns):
    go = evidence(trials)
    texts = told(with_input, go, on_some(go.truth == 1))
    assert bool(texts) == warns


@pytest.mark.parametrize("name", ["onset_ms", "amount_nats", "duration_ms"])
def test_a_time_or_a_size_that_follows_the_truth_is_warned_of(name):
    go = evidence(60)
    same = {"onset_ms": 10.0, "amount_nats": 1.0, "duration_ms": 10.0}
    with unwarned():
        with_input(go, **same)
        with_input(go, **same | {name: np.where(np.arange(60) // 2 % 2, 10.0, 20.0)})
    with pytest.warns(ConfoundWarning) as caught:
        with_input(go, **same | {name: np.where(go.truth, 10.0, 20.0)})
    assert set(caught[0].message.truths) == {0, 1}


def test_the_input_that_is_confounded_is_named():
    go = evidence(60)
    fair = with_input(go, on_some(np.arange(60) < 30))
    with pytest.warns(ConfoundWarning) as caught:
        with_input(fair, on_some(go.truth == 0))
    assert [one.message.input for one in caught] == [1]
    values = np.zeros((60, 5, 1))
    values[go.truth == 1, 2:] = -1.0
    with pytest.warns(ConfoundWarning):
        replace(go, inputs_nats=values)


test_a_window_without_sense_is_refused = refusing(
    ({"onset_ms": -1.0}, "onset_ms must be >= 0 and finite, got -1"),
    ({"onset_ms": [10.0, math.inf, NEVER, 5.0]}, "onset_ms must be >= 0 and finite, got inf"),
    ({"onset_ms": -math.inf}, "onset_ms must be >= 0 and finite, got -inf"),
    ({"amount_nats": [1.0, math.nan, 1.0, 1.0]}, "amount_nats must be finite, got nan"),
    ({"amount_nats": math.inf}, "amount_nats must be finite, got inf"),
    ({"duration_ms": -5.0}, "duration_ms must be > 0, got -5"),
    ({"duration_ms": 0.0}, "duration_ms must be > 0, got 0"),
    ({"duration_ms": [1.0, 2.0, math.nan, 4.0]}, "duration_ms must be > 0, got nan"),
    ({"onset_ms": [1.0, 2.0]}, "onset_ms must be one number, or"),
    ({"onset_ms": np.arange(4) % 3 == 0}, "onset_ms"),
    ({"amount_nats": np.arange(4) % 3 == 0}, "amount_nats"),
    of=lambda wrong: with_input(evidence(4), **{"onset_ms": 10.0} | wrong),
)


@pytest.mark.parametrize("place", ["D2[0]", "STN"])
def test_an_input_alike_in_all_trials_is_a_course_of_the_circuit(place):
    go, circuit = evidence(20), bg.load_circuit("macaque")
    each = bg.BasalGanglia(circuit.with_inputs(place), seed=3).run(with_input(go, 10.0, -2.0, 20.0))
    course = circuit.edited(f"add {place} amount=-2 from_ms=10 to_ms=30")
    every = bg.BasalGanglia(course, seed=3).run(go)
    np.testing.assert_allclose(each.out_nats, every.out_nats, atol=2e-6)
    assert np.abs(every.out_nats - bg.BasalGanglia(circuit, seed=3).run(go).out_nats).max() > 0.01


def test_an_input_after_the_trials_changes_nothing_and_is_warned_of():
    go, circuit = evidence(20), bg.load_circuit("macaque").with_inputs("D2[0]")
    with pytest.warns(EditWarning):
        late = with_input(go, 50.0, -2.0)
    model = bg.BasalGanglia(circuit, seed=3)
    np.testing.assert_array_equal(model.run(late).out_nats, model.run(go).out_nats)
    with unwarned():
        with_input(go, NEVER, -2.0)
        with_input(go, 50.0, 0.0)


TRIALS, POSTERIOR = 300, 0.82
MODEL = bg.BasalGanglia("macaque", seed=3)
LEVEL = MODEL.threshold(None, POSTERIOR)


EVIDENCE = bg.gaussian_evidence(TRIALS, d_prime=0.35, t_max=100, step_ms=10, seed=5)


def delays(ms):
    """Return one delay for all trials but the first, which is a go trial."""
    return np.append(np.nan, np.full(TRIALS - 1, float(ms)))


@pytest.mark.parametrize("amount", [0.2, 0.3, 0.5])
def test_at_the_fixed_point_it_adds_its_nats_to_the_output_of_the_leader(amount):
    """OUT_i = -ln P_i + A, for any evidence; where OUT is high its rate saturates."""
    drive = np.log([[[0.8, 0.2], [0.9, 0.1], [0.1, 0.9]]])
    drive -= drive.mean(axis=2, keepdims=True)
    table = bg.load_circuit("macaque").with_inputs("STN")
    stop = np.concatenate([drive, np.full((1, 3, 1), amount)], axis=2)
    out, plain = (
        engines.run(table, each, engine="algebra", step_ms=10.0).output_nats.min(axis=2)
        for each in (stop, drive)
    )
    assert out - plain == pytest.approx(amount, abs=0.005)


def test_the_response_to_a_signal_settles_at_its_nats():
    time_ms, added = step_response(MODEL, StopSignal(amount_nats=1.0), time_ms=500)
    assert added[time_ms > 300] == pytest.approx(1.0, abs=0.02)
    assert 30 < time_ms[added >= 0.5][0] < 60


@pytest.mark.parametrize("amount", [0.5, 1.0])
@pytest.mark.parametrize("ssd", [200, 300])
def test_the_closed_form_is_the_full_run_trial_by_trial(amount, ssd):
    """The same noise: outcomes agree in 99 of 100 trials, by populations."""
    signal = StopSignal(amount_nats=amount)
    added = step_response(MODEL, signal, time_ms=1010)[1]
    full = decide_with_stop(MODEL, EVIDENCE, delays(ssd), signal, threshold=LEVEL)
    trace = closed_form(MODEL.run(EVIDENCE), delays(ssd), signal, added)
    made = first_crossing(trace, LEVEL, forced=False, checked=False)
    closed = stop_trials(made, delays(ssd), 2)
    assert (full.responded == closed.responded).mean() >= 0.99
    assert 0.05 < full.p_respond < 0.5


def test_an_onset_between_two_steps_counts_in_proportion():
    evidence = bg.gaussian_evidence(2, d_prime=0.5, t_max=3, step_ms=10, seed=1)
    coarse = with_stop(evidence, [np.nan, 15.0], StopSignal()).inputs_nats
    assert coarse[..., 0].tolist() == [[0, 0, 0, 0], [0, 0.5, 1, 1]]
    fine = with_stop(evidence, [np.nan, 15.0], StopSignal(), every_ms=5).inputs_nats
    assert fine[1, :, 0].tolist() == [0, 0, 0, 1, 1, 1, 1, 1]


def stopping(nucleus):
    return lambda: decide_with_stop(
        MODEL, EVIDENCE, delays(200), StopSignal(nucleus), threshold=LEVEL
    )


def stopped_by(**changes):
    asked = {"ssd_ms": delays(200), "signal": StopSignal()} | changes
    return lambda: with_stop(EVIDENCE, **asked)


test_a_signal_that_does_not_fit_or_is_cancelled_is_refused = refusing(
    *(
        (stopping(nucleus), f"nucleus behind cortex, got {re.escape(repr(nucleus))}")
        for nucleus in ("ctx", "ctx_inh", "ctx_inh[0]", "GPe_ctx", "GPe_ctx[1]")
    ),
    (stopped_by(ssd_ms=np.full(TRIALS, 5000.0)), "ssd_ms before the end"),
    (stopped_by(ssd_ms=[100.0]), "ssd_ms must be"),
    (stopped_by(every_ms=3.0), "every_ms fraction"),
)


def test_with_the_observers_signal_in_stn_the_circuit_does_what_the_observer_does():
    """Same evidence for go and stop: same outcome, corrected for chance, in most trials."""
    some_ms = [200, 300, 400]
    ssd, told = drawn_delays(TRIALS, some_ms, 0.5, 11), {"share": 0.3, "delays_ms": some_ms}
    signals = gaussian_stop_evidence(EVIDENCE, ssd, d_prime=0.6, rng=12, **told)
    test = StopMsprt(MODEL.gain).decide(signals, POSTERIOR, 1 - 1e-12)
    model = replace(MODEL, circuit=MODEL.circuit.with_inputs("STN"))
    circuit = model.decided(with_observed_stop(signals), LEVEL, forced=False)
    made = [stop_trials(each, ssd, 2).responded for each in (test, circuit)]
    same = (made[0] == made[1]).mean()
    chance = np.prod([each.mean() for each in made]) + np.prod([1 - each.mean() for each in made])
    assert (same - chance) / (1 - chance) > 0.8
    both = made[0] & made[1] & (test.choice == circuit.choice)
    assert np.corrcoef(test.time_ms[both], circuit.time_ms[both])[0, 1] > 0.85


def test_it_warns_as_a_decision_without_a_stop_does():
    """Noise of few cells crosses the threshold; a common fall leaves the circuit's range."""
    few, some = replace(MODEL, circuit=MODEL.circuit.with_neurons(4)), EVIDENCE[:20]
    for model, drawn, kind, says in (
        (few, some, NoiseWarning, "noise takes OUT below"),
        (MODEL, replace(some, baseline=0.1), RangeWarning, "macaque works from"),
    ):
        with pytest.warns(kind, match=says):
            model.decide(drawn, LEVEL)
        with pytest.warns(kind, match=says):
            decide_with_stop(model, drawn, delays(200)[:20], StopSignal(), threshold=LEVEL)


def test_a_signal_that_rings_is_warned_of():
    with pytest.warns(RangeWarning, match="20 Hz"):
        StopSignal(amount_nats=3.0)
