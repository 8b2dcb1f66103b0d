"""A stop signal in the circuit: the closed form against full runs, pulses, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.deciding.decision import first_crossing
from bgmodel.stopping.inputs import (
    StopSignal,
    closed_form,
    decide_with_stop,
    step_response,
    with_observed_stop,
    with_stop,
)
from bgmodel.stopping.observer import StopMsprt, gaussian_stop_evidence
from bgmodel.stopping.trials import drawn_delays, stop_trials
from circuits import engines
from circuits.errors import NoiseWarning, RangeWarning
from tests.helpers import refused

TRIALS, POSTERIOR = 300, 0.82
MODEL = bg.BasalGanglia("macaque", seed=3)
LEVEL = MODEL.threshold(None, POSTERIOR)


@pytest.fixture(scope="module")
def evidence():
    return bg.gaussian_evidence(TRIALS, d_prime=0.35, t_max=100, step_ms=10, seed=5)


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
def test_the_closed_form_is_the_full_run_trial_by_trial(evidence, amount, ssd):
    """The same noise: outcomes agree in 99 of 100 trials, by populations."""
    signal = StopSignal(amount_nats=amount)
    added = step_response(MODEL, signal, time_ms=1010)[1]
    full = decide_with_stop(MODEL, evidence, delays(ssd), signal, threshold=LEVEL)
    trace = closed_form(MODEL.run(evidence), delays(ssd), signal, added)
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


def test_a_signal_where_common_input_is_cancelled_is_refused(evidence):
    for nucleus in ("ctx", "ctx_inh", "ctx_inh[0]", "GPe_ctx", "GPe_ctx[1]"):
        with refused(f"nucleus behind cortex, got {re.escape(repr(nucleus))}"):
            decide_with_stop(MODEL, evidence, delays(200), StopSignal(nucleus), threshold=LEVEL)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"ssd_ms": np.full(TRIALS, 5000.0)}, "ssd_ms before the end"),
        ({"ssd_ms": [100.0]}, "ssd_ms must be"),
        ({"every_ms": 3.0}, "every_ms fraction"),
    ],
)
def test_a_signal_that_does_not_fit_is_refused(evidence, changes, says):
    with refused(says):
        with_stop(evidence, **{"ssd_ms": delays(200), "signal": StopSignal()} | changes)


def test_with_the_observers_signal_in_stn_the_circuit_does_what_the_observer_does(evidence):
    """Same evidence for go and stop: same outcome, corrected for chance, in most trials."""
    ssd = drawn_delays(TRIALS, [200, 300, 400], 0.5, 11)
    signals = gaussian_stop_evidence(
        evidence, ssd, d_prime=0.6, share=0.3, delays_ms=[200, 300, 400], rng=12
    )
    test = StopMsprt(MODEL.gain).decide(signals, POSTERIOR, 1 - 1e-12)
    model = replace(MODEL, circuit=MODEL.circuit.with_inputs("STN"))
    circuit = model.decided(with_observed_stop(signals), LEVEL, forced=False)
    made = [stop_trials(each, ssd, 2).responded for each in (test, circuit)]
    same = (made[0] == made[1]).mean()
    chance = np.prod([each.mean() for each in made]) + np.prod([1 - each.mean() for each in made])
    assert (same - chance) / (1 - chance) > 0.8
    both = made[0] & made[1] & (test.choice == circuit.choice)
    assert np.corrcoef(test.time_ms[both], circuit.time_ms[both])[0, 1] > 0.85


def test_it_warns_as_a_decision_without_a_stop_does(evidence):
    """Noise of few cells crosses the threshold; a common fall leaves the circuit's range."""
    few = replace(MODEL, circuit=MODEL.circuit.with_neurons(4))
    fallen = replace(evidence[:20], baseline=0.1)
    noisy, beyond = (NoiseWarning, "noise takes OUT below"), (RangeWarning, "macaque works from")
    cases = ((few, evidence[:20], noisy), (MODEL, fallen, beyond))
    for model, drawn, (kind, says) in cases:
        for decide in (
            lambda m, e: m.decide(e, LEVEL),
            lambda m, e: decide_with_stop(m, e, delays(200)[:20], StopSignal(), threshold=LEVEL),
        ):
            with pytest.warns(kind, match=says):
                decide(model, drawn)


def test_a_signal_that_rings_is_warned_of():
    with pytest.warns(RangeWarning, match="20 Hz"):
        StopSignal(amount_nats=3.0)
