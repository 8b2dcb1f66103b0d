"""Rates of the cell types, in closed form and cell by cell, and the laws that the circuit needs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfc

from circuits import anatomy
from circuits.cells.membrane import fit_current, lif_mean_mv, lif_rate_hz
from tests.helpers import refused

SPIKING = anatomy.spiking_msprt()
# Population: the rates over which its current is fitted, and the largest departure from its line.
LINES = {
    "D1": ((5, 60), 0.03),
    "D2": ((3, 7), 0.06),
    "GPe": ((20, 70), 0.01),
    "SNr": ((5, 80), 0.04),
}


# ---- integrate and fire


def test_without_noise_the_rate_is_that_of_the_deterministic_cell():
    """1/r = refractory + tau ln((mean - reset)/(mean - threshold)), up to the noise squared."""
    mean = np.array([16.0, 18, 25, 40, 100])
    for noise_mv, off in ((0.3, 2e-2), (0.03, 2e-4), (0.01, 2e-5)):
        cell = replace(SPIKING.population("GPe").cell, noise_mv=noise_mv)
        interval = np.log((mean - cell.reset_mv) / (mean - cell.threshold_mv))
        sure = 1000 / (cell.refractory_ms + cell.tau_ms * interval)
        assert np.abs(lif_rate_hz(cell, mean) / sure - 1).max() < off
    assert lif_rate_hz(cell, [5.0, 14.0]).max() < 1e-12  # below threshold it is silent


@pytest.mark.parametrize("name", ["D1", "GPe", "SNr"])
def test_the_rate_is_siegerts_integral(name):
    cell = SPIKING.population(name).cell
    for mean in (2.0, 9.0, 14.0, 25.0):
        ends = (np.array([cell.reset_mv, cell.threshold_mv]) - mean) / (np.sqrt(2) * cell.noise_mv)
        passage = quad(lambda u: np.exp(u * u) * erfc(-u), *ends, epsabs=0, epsrel=1e-10)[0]
        expected = 1000 / (cell.refractory_ms + cell.tau_ms * np.sqrt(np.pi) * passage)
        assert lif_rate_hz(cell, mean) == pytest.approx(expected, rel=1e-9)


def test_far_from_threshold_rates_stay_finite():
    cell = SPIKING.population("D1").cell
    rates = lif_rate_hz(cell, [-1e4, -100.0, 0.0, 1e4])
    assert np.isfinite(rates).all()
    assert (np.diff(rates) >= 0).all()
    assert 0 < rates[0] < 1e-30  # above 0: its logarithm is finite
    assert rates[-1] == pytest.approx(1000 / cell.refractory_ms, rel=0.02)


def test_the_mean_potential_inverts_the_rate():
    cell = SPIKING.population("GPe").cell
    for rate in (1e-6, 0.5, 12.0, 200.0):
        assert lif_rate_hz(cell, lif_mean_mv(cell, rate)) == pytest.approx(rate, rel=1e-9)
    for rate in (0, -1, 500, np.nan):
        with refused("rate_hz"):
            lif_mean_mv(cell, rate)


@pytest.mark.parametrize("name", LINES)
def test_fitted_currents_follow_the_line_and_are_those_of_the_table(name):
    row = SPIKING.population(name)
    range_hz, off_nats = LINES[name]
    line = (row.baseline_hz, row.gain_hz_per_nat)
    rest_mv, mv_per_nat = fit_current(row.cell, *line, range_hz)
    assert row.cell.rest_mv == pytest.approx(rest_mv, abs=0.05)
    assert row.cell.mv_per_nat == pytest.approx(mv_per_nat, abs=0.05)
    wanted = np.linspace(*range_hz, 200)
    nats = (wanted - line[0]) / line[1]
    off = (lif_rate_hz(row.cell, rest_mv + mv_per_nat * nats) - wanted) / line[1]
    assert np.abs(off).max() < off_nats


# ---- the laws that the circuit needs
