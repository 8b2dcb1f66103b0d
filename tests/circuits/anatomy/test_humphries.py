"""Humphries, Stewart & Gurney 2006: what the authors print, and what their numbers make of cells.

Printed in the authors' code (ModelDB 83559): tonic rates "30-30-12 for GPe-GPi-STN" (pars.m), and a
threshold of 5 spikes per second below which a channel is selected (batch_selection_grid_DA.m).
"""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy.humphries import GPE, MSN, SNR, STN, psp_area
from circuits.cells.membrane import fit_current
from circuits.engines import run
from tests.helpers import refused

PRINTED_HZ = {"GPe": 30, "SNr": 30, "STN": 12}
SELECTED_HZ = 5
FITTED_HZ = {MSN: (1, 40), STN: (2, 100), GPE: (5, 80), SNR: (2, 60)}


def mean_hz(circuit, inputs_hz, seeds=2):
    """Return mean rates of each channel over 0.7 s and seeds: (seeds, channels) by name."""
    drive = np.tile((np.array(inputs_hz) - 3) / 40, (3, 10, 1))
    means = []
    for seed in range(seeds):
        wired = replace(circuit, wiring_seed=seed)
        activity = run(wired, drive, engine="ensemble", step_ms=100, seed=seed)
        means.append({n: hz[:, 300:].mean(axis=(0, 1)) for n, hz in activity.rates_hz.items()})
    return {name: np.array([one[name] for one in means]) for name in means[0]}


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_tonic_rates_are_those_that_the_authors_print_within_a_quarter(channels):
    """Spontaneous currents were set by the authors for their whole model, shunting and all."""
    rates_hz = mean_hz(anatomy.humphries(channels), [3] * channels)
    for name, printed_hz in PRINTED_HZ.items():
        assert rates_hz[name].mean() == pytest.approx(printed_hz, rel=0.25), name


def test_the_channel_of_the_larger_input_is_selected_and_the_others_rise():
    circuit = anatomy.humphries(3)
    rest = mean_hz(circuit, [3, 3, 3])["SNr"].mean()
    snr_hz = mean_hz(circuit, [3, 25, 3])["SNr"]
    assert (snr_hz[:, 1] < SELECTED_HZ).all()
    assert (snr_hz[:, [0, 2]] > rest + 5).all()


def test_two_of_four_large_inputs_are_told_apart():
    snr_hz = mean_hz(anatomy.humphries(4), [20, 10, 3, 3])["SNr"]
    assert (snr_hz[:, 0] < SELECTED_HZ).all()
    assert (snr_hz[:, 1:] > 2 * SELECTED_HZ).all()


def test_too_little_dopamine_selects_nothing_and_too_much_selects_both():
    """As the abstract says: selection deteriorates in depleted and in excessive dopamine."""
    inputs = [20, 15, 3]
    little, tonic, much = (
        mean_hz(anatomy.humphries(3, dopamine=level), inputs)["SNr"].mean(axis=0)
        for level in (0.0, 0.3, 0.8)
    )
    assert (little > SELECTED_HZ).all()
    assert (tonic < SELECTED_HZ).tolist() == [True, False, False]
    assert (much < SELECTED_HZ).tolist() == [True, True, False]


def test_rates_without_noise_select_the_same_channel():
    circuit = anatomy.humphries(3)
    drive = np.tile([0.5, 0.1, 0.0], (1, 10, 1))
    out = run(circuit, drive, engine="rate", step_ms=100).output_nats[0, -1]
    rest = run(circuit, 0 * drive, engine="rate", step_ms=100).output_nats[0, -1]
    assert out[0] < 0.05
    assert (out[1:] > rest[1:]).all()


@pytest.mark.parametrize("cell", FITTED_HZ, ids=["MSN", "STN", "GPe", "SNr"])
def test_lines_and_noise_follow_from_the_cells(cell):
    """Noise of the code: 0.3 mV in each step of 0.1 ms."""
    assert cell.noise_mv == pytest.approx(0.3 / np.sqrt(-np.expm1(-0.2 / cell.tau_ms)), abs=1e-3)
    fitted = fit_current(cell, 0, 100, FITTED_HZ[cell])
    assert (cell.rest_mv, cell.mv_per_nat) == pytest.approx(fitted, abs=5e-3)


@pytest.mark.parametrize(("synapse_ms", "membrane_ms"), [(2, 14), (3, 8), (2, 25), (100, 14)])
def test_a_psp_has_the_peak_that_its_area_was_asked_for(synapse_ms, membrane_ms):
    """Its area is that of the current; the authors look for the peak within a membrane's time."""
    dt_ms = 1e-3
    times = np.arange(0, membrane_ms, dt_ms)
    potential, highest = 0.0, 0.0
    for current in (
        psp_area(3.0, synapse_ms, membrane_ms) / synapse_ms * np.exp(-times / synapse_ms)
    ):
        potential += dt_ms / membrane_ms * (current - potential)
        highest = max(highest, potential)
    assert highest == pytest.approx(3.0, rel=1e-3)


def test_a_cell_hears_at_least_one_cell_of_each_channel():
    assert anatomy.humphries(16).projection("STN->SNr").probability * 64 == 1
    with refused("channels"):
        anatomy.humphries(17)
