"""Arkypallidal cells: they change nothing at rest, and stop for as long as their input lasts."""

from dataclasses import replace

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.integrators.criterion import rest_out
from bgmodel.stopping.arkypallidal import NAME, with_arkypallidal
from bgmodel.stopping.circuit import decide_with_stop
from bgmodel.stopping.inputs import StopSignal, with_onsets
from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.errors import EditWarning
from tests.helpers import refused

TRIALS, SSD, LEVEL = 400, 250.0, 0.2
PLAIN = load_circuit("macaque")
CIRCUIT = with_arkypallidal(PLAIN)
MODEL = bg.BasalGanglia(CIRCUIT, seed=3)


@pytest.fixture(scope="module")
def evidence():
    return bg.gaussian_evidence(TRIALS, d_prime=0.35, t_max=100, step_ms=10, seed=5)


def p_of(evidence, *signals):
    """Return p(respond) with several signals in every trial."""
    names = [signal.nucleus for signal in signals]
    for signal in signals:
        onset = np.full(TRIALS, SSD + signal.delay_ms)
        evidence = with_onsets(evidence, onset, signal)
    model = replace(MODEL, circuit=CIRCUIT.with_inputs(*names))
    return float((model.decided(evidence, LEVEL, forced=False).choice >= 0).mean())


def pulse(nucleus, amount, duration, delay=0.0):
    with pytest.warns(EditWarning, match="does not cancel"):
        return StopSignal(nucleus, amount, delay, duration)


def test_they_change_no_resting_rate_and_no_output_at_rest():
    assert rest_out(CIRCUIT) == pytest.approx(rest_out(PLAIN))
    assert {**resting_hz(PLAIN), NAME: 9.8} == pytest.approx(resting_hz(CIRCUIT))


def test_they_can_be_given_a_stop_signal_that_stops_later_than_that_to_stn(evidence):
    delays = np.append(np.nan, np.full(TRIALS - 1, SSD))
    stn, arky = (
        decide_with_stop(MODEL, evidence, delays, StopSignal(name, nats), threshold=LEVEL)
        for name, nats in (("STN", 1.0), (NAME, 2.0))
    )
    assert stn.p_respond < arky.p_respond < stn.p_respond + 0.15


def test_an_input_that_ends_only_postpones_even_after_a_pause_by_stn(evidence):
    went = (MODEL.decided(evidence, LEVEL, forced=False).choice >= 0).mean()
    arky = pulse(NAME, 2.0, 150.0, 40.0)
    for signals in ((arky,), (pulse("STN", 1.0, 100.0), arky)):
        assert p_of(evidence, *signals) > went - 0.1


def test_a_pause_by_stn_makes_a_held_input_stop_as_early_as_one_held_to_stn(evidence):
    both = p_of(evidence, pulse("STN", 1.0, 100.0), StopSignal(NAME, 2.0, 40.0))
    held = p_of(evidence, StopSignal())
    alone = p_of(evidence, StopSignal(NAME, 2.0, 40.0))
    assert held <= both + 0.01 < alone


def test_a_circuit_that_has_them_already_or_no_d2_is_refused():
    with refused("populations same name"):
        with_arkypallidal(CIRCUIT)
    with refused("nucleus D2"):
        with_arkypallidal(load_circuit("bogacz_gurney"))
