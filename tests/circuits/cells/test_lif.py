"""The leaky integrate-and-fire cell: its tick and its sampled threshold."""

import numpy as np
import numpy.testing as npt
import pytest

from circuits import anatomy

BASE = anatomy.spiking_msprt(2).with_neurons(40)


def test_a_tick_of_a_lif_is_the_exact_solution_of_its_equation():
    cell = BASE.population("GPe").cell
    factors = np.random.default_rng(3).uniform(0.7, 1.3, (3, 50))
    tau, slope, top = factors
    c = cell.constants(factors, 0.1)
    npt.assert_allclose(
        c["threshold"] / c["unit"], cell.sampled_threshold_mv(0.1, tau, top) - 3, rtol=1e-6
    )
    alpha = np.exp(-0.1 / (cell.tau_ms * tau))
    for v, nats, ones in ((3.0, -0.5, 4), (9.0, 0.3, 0), (14.0, 0.0, 7)):
        mean = cell.rest_mv + cell.mv_per_nat * slope * nats
        step = cell.noise_mv * np.sqrt(1 - alpha**2)
        exact = mean + (v - mean) * alpha + step * (ones - 4) / np.sqrt(2)
        kept = c["decay"] * c["unit"] * (v - cell.reset_mv)
        moved = kept + (c["rest"] + c["slope"] * nats + c["noise_step"] * ones)
        npt.assert_allclose(cell.reset_mv + moved / c["unit"], exact, rtol=1e-6)


SPIKING = anatomy.spiking_msprt()


@pytest.mark.parametrize("dt_ms", [0.05, 0.1, 0.2])
def test_the_sampled_threshold_lies_below_by_the_overshoot(dt_ms):
    cell = SPIKING.population("GPe").cell
    step = cell.noise_mv * np.sqrt(2 * dt_ms / cell.tau_ms)
    below = cell.threshold_mv - cell.sampled_threshold_mv(dt_ms)
    assert below == pytest.approx(0.5826 * step, rel=0.02)


@pytest.mark.parametrize("dt_ms", [0.05, 0.2])
def test_a_ticks_noise_keeps_the_spread_of_the_membrane(dt_ms):
    """What decays in a tick is drawn anew: sd^2 = sd^2 exp(-2 dt/tau) + step^2."""
    cell = SPIKING.population("GPe").cell
    kept = cell.noise_mv * np.exp(-dt_ms / cell.tau_ms)
    assert np.hypot(cell.step_mv(dt_ms), kept) == pytest.approx(cell.noise_mv, rel=1e-12)


def test_a_varied_cell_has_the_constants_of_its_factors_and_factors_of_1_change_nothing():
    cell, factors = SPIKING.population("GPe").cell, np.array([1.2, 0.9, 1.1])
    assert cell.varied(np.ones(3)) == (cell, 1.0)
    other, times = cell.varied(factors)
    assert times == 1.0
    constants, made = cell.constants(factors, 0.1), other.constants(np.ones(3), 0.1)
    for name in ("decay", "rest", "slope", "noise_step"):
        # Own units are those in which all cells have one threshold.
        expected = constants[name] / (1 if name == "decay" else constants["unit"])
        npt.assert_allclose(made[name], expected, rtol=1e-6, err_msg=name)


def test_a_lif_starts_anywhere_between_reset_and_its_threshold_and_is_ready():
    """In the units of its population, where its own threshold is that of all."""
    cell = BASE.population("GPe").cell
    c = cell.constants(np.array([1.0, 1.0, 1.3]), 0.1)
    for uniform in (0.0, 0.25, 1.0):
        v, wait = cell.begin(np.float64(uniform), *c.values())
        assert v == pytest.approx(uniform * c["threshold"] * c["unit"], rel=1e-6)
        assert wait == 0
    assert c["unit"] < 0.8
