"""Response and spectrum of a cell against limits that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfcx

from circuits import anatomy
from circuits.cells import Phase
from circuits.cells.membrane import lif_rate_hz
from circuits.cells.phase import phase_spectrum
from circuits.cells.response import NODES, lif_response

TABLE = anatomy.spiking_msprt()
SLOW, FAST = [1e-3], [3000.0]


@pytest.mark.parametrize("name", ["D1", "GPe"])
@pytest.mark.parametrize("above_mv", [-6.0, -2.0, 0.0, 4.0])
def test_slow_fluctuations_see_slope_and_curvature_of_siegerts_law(name, above_mv):
    cell = TABLE.population(name).cell
    mean, step = cell.threshold_mv + above_mv, 0.1
    low, here, high = lif_rate_hz(cell, mean + step * np.array([-1, 0, 1]))
    response = lif_response(cell, [mean], SLOW)
    assert response.gain[0, 0].real == pytest.approx((high - low) / (2 * step), rel=3e-3)
    assert abs(response.gain[0, 0].imag) < 1e-3 * response.gain[0, 0].real
    bend = (high - 2 * here + low) / (2 * step**2)
    assert response.bend[0, 0] == pytest.approx(bend, rel=1e-2, abs=2e-4)


@pytest.mark.parametrize("name", ["D1", "GPe"])
def test_fast_modulation_passes_as_one_over_the_root_of_its_frequency(name):
    """|gain| is r / (sd sqrt(omega tau)): Brunel, Chance, Fourcaud & Abbott 2001."""
    cell = TABLE.population(name).cell
    mean = cell.threshold_mv + 1.0
    law = lif_rate_hz(cell, mean) / np.sqrt(2 * np.pi * FAST[0] * cell.tau_ms / 1000)
    gains = np.abs(lif_response(cell, [mean], FAST).gain[0, 0])
    assert gains == pytest.approx(law / cell.noise_mv, rel=0.03)


@pytest.mark.parametrize("above_mv", [-4.0, 0.0, 5.0])
def test_slow_power_is_the_rate_times_the_squared_cv_of_intervals(above_mv):
    """CV^2 of a first passage from reset to threshold: Brunel 2000, equation A.7."""
    cell = replace(TABLE.population("SNr").cell, refractory_ms=0.0)
    mean = cell.threshold_mv + above_mv
    ends = (np.array([cell.reset_mv, cell.threshold_mv]) - mean) / (np.sqrt(2) * cell.noise_mv)
    rate = float(lif_rate_hz(cell, mean))

    def inner(x):
        # exp(x^2) int exp(v^2) (1 + erf v)^2 dv, with exp(v^2) (1 + erf v) = erfcx(-v).
        return quad(lambda v: np.exp(x * x - v * v) * erfcx(-v) ** 2, -9, x)[0]

    variance = quad(inner, *ends)[0]
    cv2 = 2 * np.pi * (rate * cell.tau_ms / 1000) ** 2 * variance
    spectrum = lif_response(cell, [mean], SLOW).spectrum[0, 0]
    assert spectrum / rate == pytest.approx(cv2, rel=5e-3)


@pytest.mark.parametrize("name", ["D1", "GPe"])
def test_fast_power_is_the_rate(name):
    cell = TABLE.population(name).cell
    mean = np.array([cell.threshold_mv - 3.0, cell.threshold_mv + 3.0])
    power = lif_response(cell, mean, FAST).spectrum[:, 0]
    np.testing.assert_allclose(power, lif_rate_hz(cell, mean), rtol=5e-3)


def test_power_of_the_other_cells_is_that_of_renewal_processes():
    rate = np.array([5.0, 40.0])
    for cv in (0.3, 0.5, 1.0):
        np.testing.assert_allclose(phase_spectrum(Phase(cv), rate, SLOW)[:, 0], cv**2 * rate, 1e-4)
        np.testing.assert_allclose(phase_spectrum(Phase(cv), rate, [1e4])[:, 0], rate, 0.02)
    assert not phase_spectrum(Phase(0.0), rate, [3.0]).any()


@pytest.mark.parametrize("name", ["D1", "GPe"])
@pytest.mark.parametrize("above_mv", [-3.0, 2.0])
def test_all_frequencies_together_are_more_noise_of_the_membrane(name, above_mv):
    """White input of power S adds S/(2 tau) to sd^2: Siegert's law says what the rate gains."""
    cell = replace(TABLE.population(name).cell, refractory_ms=0.0)
    mean = cell.threshold_mv + above_mv
    frequency = np.concatenate([[1e-3], np.geomspace(0.1, 20_000, 200)])
    bend = lif_response(cell, [mean], frequency).bend[0]
    # It falls as the frequency to the -3/2 in the end: the rest of the integral.
    gained = 2 * (np.trapezoid(bend, frequency) + 2 * bend[-1] * frequency[-1])
    step = 0.01
    noises_mv = np.sqrt(cell.noise_mv**2 + step * np.array([1, -1]))
    more, less = (lif_rate_hz(replace(cell, noise_mv=each), mean) for each in noises_mv)
    law = (more - less) / (2 * step) / (2 * cell.tau_ms / 1000)
    assert gained == pytest.approx(law, rel=0.03)


def test_nothing_special_is_where_the_mean_input_meets_a_node():
    """Drift is 0 there, and its exponential over itself is 1 in the limit."""
    cell = TABLE.population("D1").cell
    step = (cell.threshold_mv - cell.reset_mv) / NODES
    node = cell.threshold_mv - 10.5 * step
    response = lif_response(cell, [node, node + 1e-6], [10.0])
    for part in response:
        np.testing.assert_allclose(part[0], part[1], rtol=1e-4)


def test_a_mean_more_than_nine_sd_below_threshold_counts_as_nine():
    """Such a cell is silent: it has less than one spike per hour."""
    cell = TABLE.population("D1").cell
    mean = cell.threshold_mv - cell.noise_mv * np.array([9.0, 10.5, 50.0])
    for part in lif_response(cell, mean, [1.0, 50.0]):
        np.testing.assert_array_equal(part[1:], part[:1].repeat(2, axis=0))
    assert lif_rate_hz(cell, mean[0]) < 1 / 3600
    near = lif_response(cell, mean[:1] + cell.noise_mv, [1.0])
    assert near.spectrum > lif_response(cell, mean[:1], [1.0]).spectrum


def test_a_refractory_period_is_not_seen_where_it_is_a_whole_number_of_turns():
    """2 ms is one period of a 500 Hz modulation, so only the rate changes."""
    cell = TABLE.population("GPe").cell
    mean = cell.threshold_mv + np.array([-1.0, 2.0])
    held, free = (lif_response(replace(cell, refractory_ms=x), mean, [250, 500]) for x in (2, 0))
    slower = held.spectrum[:, 1] / free.spectrum[:, 1]
    assert (slower < 0.98).all()
    np.testing.assert_allclose(held.gain[:, 1] / free.gain[:, 1], slower, rtol=1e-9)
    assert (np.abs(held.gain[:, 0] / free.gain[:, 0] / slower - 1) > 1e-6).all()
