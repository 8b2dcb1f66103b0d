"""A circuit on known evidence: its stored OUT is that of direct simulation."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.known.hazard import lowest_between
from bgmodel.fitting.known.known_circuit import KnownCircuit, on_grid
from bgmodel.fitting.known.known_likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.integrators.sprt import Msprt
from circuits.anatomy import load_circuit
from tests.helpers import refused
from tests.known_trials import few, simulated

MACAQUE = load_circuit("macaque", 2)
SPAN = {"leak_hz": 0.0}


@pytest.fixture(scope="module")
def trials():
    return simulated(30, 21, t_max=20)


def test_the_lowest_out_after_a_reading_lasts_until_the_next():
    out = np.array([[5, 4, 3, 6, 2, 9, 1.0]])[:, :, None]
    time_s = 0.1 * np.arange(1, 8)
    # The last reading comes after the last tick.
    starts, ends = np.array([[0.1, 0.3, 0.6, 0.9]]), np.array([[0.3, 0.6, 0.7, 1.0]])
    lowest = lowest_between(out, time_s, starts, ends, np.array([4]))
    np.testing.assert_array_equal(lowest[0, :, 0], [4, 2, 9, 1])


def test_an_exact_circuit_without_noise_is_the_test(trials):
    exact = KnownCircuit(load_circuit("spiking_msprt", 2), engine="algebra", runs=8)
    outputs = exact.on(trials, SPAN)
    gain = float(outputs.gains[2])
    expected = EXACT["msprt"].on(trials, SPAN).out({"gain": gain, "leak_hz": 0.0})
    # Above its rest and near 0, OUT of this circuit is flat.
    below = (expected[0] > 0.2) & (expected[0] < 0.6)
    assert below.sum() > 100
    out_nats = outputs.out({"gain": gain})[0]
    np.testing.assert_allclose(out_nats[below], expected[0][below], atol=2e-3)


@pytest.mark.parametrize("leak_hz", [0.0, 2.0])
def test_readings_on_a_grid_are_the_readings_and_leak(trials, leak_hz):
    evidence, step_s = on_grid(trials, leak_hz)
    assert step_s == pytest.approx(0.05)
    totals = Msprt().run(evidence).out_nats[trials.seen_places[0], 1 + trials.seen_places[1]]
    exact = EXACT["msprt"].on(trials, SPAN).out({"gain": 1.0, "leak_hz": leak_hz})[0]
    np.testing.assert_allclose(totals, exact, rtol=1e-7, atol=1e-8)


def test_times_without_a_common_step_are_rounded():
    uneven = replace(few(alternatives=2), time_s=np.tile([0.013, 0.1, 0.256], (20, 1)))
    evidence, step_s = on_grid(uneven)
    assert step_s == 0.01
    place = np.flatnonzero(evidence.log_likelihood[0].any(axis=1))
    np.testing.assert_array_equal(place, [0, 9, 25])


@pytest.fixture(scope="module")
def outputs(trials):
    return KnownCircuit(MACAQUE, runs=8).on(trials, SPAN)


def test_stored_out_is_that_of_a_simulation_and_between_gains_close_to_it(trials, outputs):
    model = KnownCircuit(MACAQUE, runs=8)
    between = float(np.sqrt(outputs.gains[2] * outputs.gains[3]))
    direct = model._simulated(trials, between, 0.0)
    stored = outputs.out({"gain": between})
    assert np.corrcoef(direct.ravel(), stored.ravel())[0, 1] > 0.99
    assert abs(direct - stored).mean() < 0.02
    halves = np.arange(trials.trials) < 15
    mixed = outputs.out({"gain": np.where(halves, between, outputs.gains[1])})
    first = halves[trials.seen_places[0]]
    other = outputs.out({"gain": outputs.gains[1]})
    np.testing.assert_allclose(mixed[:, first], stored[:, first])
    np.testing.assert_allclose(mixed[:, ~first], other[:, ~first])
    at_node = outputs.out({"gain": float(outputs.gains[2])})
    np.testing.assert_allclose(at_node, model._simulated(trials, outputs.gains[2], 0.0))


def test_the_log_likelihood_is_corrected_for_runs(trials):
    """Few runs have a bias, which the jackknife takes from the mean over parts of them."""
    likelihood = known_likelihood(KnownCircuit(MACAQUE, runs=8), trials)
    vector = likelihood.freedom.start
    uncorrected, parts = likelihood(vector), [each(vector) for each in likelihood.without_parts()]
    corrected = likelihood.unbiased(vector).sum()
    assert corrected == pytest.approx(8 * uncorrected - 7 * np.mean(parts))
    many = known_likelihood(KnownCircuit(MACAQUE, runs=200), trials)(vector)
    assert uncorrected < many
    assert abs(corrected - many) < abs(uncorrected - many)


def test_a_fit_has_the_error_of_its_runs(trials):
    fixed = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.02, "bias_1": 0.0, "gain": 0.45}
    fit = fit_likelihood(known_likelihood(KnownCircuit(MACAQUE, runs=8), trials, fixed=fixed))
    assert fit.simulation.log_likelihood > 0
    assert (fit.parameters()["simulation_error"] > 0).all()


def test_what_a_circuit_can_not_do_is_refused(trials):
    strong = replace(trials, log_likelihood=1e3 * trials.log_likelihood)
    cases = (
        (few(), {}, "circuit"),
        (trials, {"free": ["+leak_hz"]}, "free"),
        (strong, {}, "evidence"),
    )
    for some, options, field in cases:
        with refused(field):
            known_likelihood(KnownCircuit(MACAQUE), some, **options)


def test_runs_differ_in_their_noise_and_repeat_with_the_seed(trials, outputs):
    out = outputs.out({"gain": float(outputs.gains[0])})
    assert out.shape == (8, trials.seen.sum(), 2)
    assert out.std(axis=0).mean() > 0.005
    again = KnownCircuit(MACAQUE, runs=8).on(trials, SPAN)
    np.testing.assert_array_equal(again.stored, outputs.stored)
