"""Circuits changed at random: each number once, and noise of a stated size."""

import numpy as np
import pytest

from circuits.anatomy import load_circuit
from circuits.cells.phase import phase_spectrum
from circuits.laws.controls import correlated, linear_stn, perturbed
from tests.circuits.helpers import run_algebra

TABLE = load_circuit("spiking_msprt", 4)


def test_every_number_is_varied_once_each_way():
    table = load_circuit("spiking_msprt", 2)
    made = perturbed(table, 0.2)
    assert len({str(each) for each in made.values()} | {str(table)}) == len(made) + 1
    assert perturbed(table) == made  # a fifth unless told otherwise
    assert made["STN cv +20%"].population("STN").cell.cv == pytest.approx(0.36)
    assert made["ctx->STN delay_ms -20%"].projection("ctx->STN").delay_ms == 2.0
    assert made["GPe tau_ms +20%"].population("GPe").cell.tau_ms == pytest.approx(12)
    assert made["read-out tau_ms -20%"].readout_tau_ms == pytest.approx(22.4)


def test_shared_noise_has_its_size_in_closed_form():
    noisy = correlated(TABLE, 0.2)
    row, path = noisy.population("shared"), noisy.projection("shared->ctx")
    assert (row.neurons, path.tau_ms, path.delay_ms) == (20, 20.0, 1)
    frequency = np.concatenate([[0.0], np.geomspace(1e-3, 1e5, 4000)]) + 1e-6
    power = phase_spectrum(row.cell, [row.baseline_hz], frequency)[0] / row.neurons
    power = power * (path.weight / row.gain_hz_per_nat) ** 2
    passed = power / (1 + (2 * np.pi * frequency * path.tau_ms / 1e3) ** 2)
    assert np.sqrt(2 * np.trapezoid(passed, frequency)) == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize("channels", [2, 3, 8])
def test_with_a_linear_stn_out_is_the_mean_over_channels_less_each(channels):
    """A tangent at rest: all but SNr, which gets 0.6 nats more, rests as it did, to rounding.

    STN's pathway to GPe bends, so a slope put into its weight would move GPe. Away from rest what
    is left is the leak of the inhibition that cancels what channels share.
    """
    table = load_circuit("macaque", channels)
    drive = np.zeros((2, 1, channels))
    drive[1, 0, :2] = 0.3, -0.2
    linear, intact = (run_algebra(each, drive) for each in (linear_stn(table), table))
    for name, rates in linear.rates_hz.items():
        if name != "SNr":
            np.testing.assert_allclose(rates[0], intact.rates_hz[name][0], rtol=1e-9)
    rest, moved = linear.output_nats[:, -1]
    np.testing.assert_allclose(rest, intact.output_nats[0, -1] + 0.6, rtol=1e-9)
    np.testing.assert_allclose(moved - rest, drive[1, 0].mean() - drive[1, 0], atol=1e-5)
