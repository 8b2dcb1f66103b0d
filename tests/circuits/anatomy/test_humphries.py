"""Humphries, Stewart & Gurney 2006: what the authors print, and what their numbers make of cells.

Printed in the authors' code (ModelDB 83559): tonic rates "30-30-12 for GPe-GPi-STN" (pars.m), and a
threshold of 5 spikes per second below which a channel is selected (batch_selection_grid_DA.m).
"""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy.humphries import GPE, MSN, SNR, STN
from circuits.cells.membrane import fit_current
from circuits.engines import run

PRINTED_HZ = {"GPe": 30, "SNr": 30, "STN": 12}
SELECTED_HZ = 5
FITTED_HZ = {MSN: (1, 40), STN: (2, 100), GPE: (5, 80), SNR: (2, 60)}


def mean_hz(circuit, inputs_hz, seeds=2):
    """Return mean rates of each channel over 0.7 s and seeds: (seeds, channels) by name."""
    drive = np.tile((np.array(inputs_hz) - 3) / 40, (3, 10, 1))
    means = []
    for seed in range(seeds):
        wired = replace(circuit, wiring_seed=seed)
        activity = run(wired, drive, engine="spikes", step_ms=100, seed=seed)
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


def test_too_little_dopamine_selects_nothing_and_too_much_selects_both():
    """As the abstract says: selection deteriorates in depleted and in excessive dopamine."""
    tables = (anatomy.humphries(3, dopamine=level) for level in (0.0, 0.3, 0.8))
    little, tonic, much = (mean_hz(each, [20, 15, 3])["SNr"].mean(axis=0) for each in tables)
    assert (little > SELECTED_HZ).all()
    assert (tonic < SELECTED_HZ).tolist() == [True, False, False]
    assert (much < SELECTED_HZ).tolist() == [True, True, False]


@pytest.mark.parametrize("cell", FITTED_HZ, ids=["MSN", "STN", "GPe", "SNr"])
def test_lines_and_noise_follow_from_the_cells(cell):
    """Noise of the code: 0.3 mV in each step of 0.1 ms."""
    assert cell.noise_mv == pytest.approx(0.3 / np.sqrt(-np.expm1(-0.2 / cell.tau_ms)), abs=1e-3)
    fitted = fit_current(cell, 0, 100, FITTED_HZ[cell])
    assert (cell.rest_mv, cell.mv_per_nat) == pytest.approx(fitted, abs=5e-3)
