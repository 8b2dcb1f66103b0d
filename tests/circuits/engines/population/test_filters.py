"""Second-order filters reproduce their fitted responses, tick by tick."""

import numpy as np
import pytest
from scipy import signal

from circuits.cells import Phase
from circuits.cells.phase import phase_spectrum
from circuits.engines.population import filters
from circuits.engines.population.filters import FREQUENCIES_HZ, PER_RAD_S


def test_how_a_rational_answer_follows_is_found_again():
    n1, n2, d1, d2 = 0.4, 0.02, 0.7, 0.06
    s = PER_RAD_S
    gain = 80 * (1 + n1 * s + n2 * s**2) / (1 + d1 * s + d2 * s**2)
    fitted = filters.following(np.stack([gain] * 3))
    assert fitted.misfit.max() < 0.01
    np.testing.assert_allclose(fitted.coefficients[-1], [n1, n2, d1, d2], rtol=0.2)


@pytest.mark.parametrize("dt_ms", [0.1, 0.5])
def test_a_tick_follows_as_the_filter_does_in_continuous_time(dt_ms):
    n1, n2, d1, d2 = coefficients = np.array([0.4, 0.02, 0.7, 0.06])
    p11, p12, p21, p22, c1, c2 = filters.propagated(coefficients[None], dt_ms)[:, 0]
    time = np.arange(0, 200, dt_ms) / 10  # in 10 ms, the unit of the coefficients
    wave = np.sin(2 * np.pi * time / 5)  # 20 Hz
    low = v = last = 0.0
    answers = []
    for u in wave:
        middle = (u + last) / 2
        old = low - middle
        low, v, last = middle + p11 * old + p12 * v, p21 * old + p22 * v, u
        answers.append(u + c1 * (low - u) + c2 * v)
    _, wanted, _ = signal.lsim(([n2, n1, 1], [d2, d1, 1]), wave, time)
    assert np.abs(np.array(answers) - wanted).max() < 0.02 * dt_ms**2 + 1e-6


def power_of(sections, dt_ms):
    """Return the power of the noise that the sections' ticks make, (F,)."""
    power = np.ones(len(FREQUENCIES_HZ))
    for c, q0, q1, a1, a2 in filters.sampled(sections.reshape(-1, 4), dt_ms).T:
        # c + (1 - z)(q0 + q1 z)/(1 + a1 z + a2 z^2), z a tick's delay.
        top = np.convolve([1, -1], [q0, q1]) + c * np.array([1, a1, a2])
        power *= np.abs(signal.freqz(top, [1, a1, a2], FREQUENCIES_HZ, fs=1000 / dt_ms)[1]) ** 2
    return power


@pytest.mark.parametrize("dt_ms", [0.1, 0.5])
@pytest.mark.parametrize("cv", [0.3, 0.5, 1.0])
def test_noise_has_the_colour_of_a_renewal_process(cv, dt_ms):
    rates = np.geomspace(0.5, 200, 16)
    power = phase_spectrum(Phase(cv), rates, FREQUENCIES_HZ)
    fitted = filters.colour(power / rates[:, None], rates)
    seen = FREQUENCIES_HZ <= 100
    for sections, hz, wanted in zip(fitted.coefficients, rates, power, strict=True):
        off = hz * power_of(sections, dt_ms) / wanted - 1
        assert np.abs(off[seen]).max() < 0.06, hz


def test_a_pacemaker_that_is_too_regular_for_two_sections_says_so():
    rates = np.array([20.0, 40.0])
    power = phase_spectrum(Phase(0.1), rates, FREQUENCIES_HZ)
    assert filters.colour(power / rates[:, None], rates).misfit.min() > 0.5
