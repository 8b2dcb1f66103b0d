"""Rates of the cell types, in closed form and cell by cell, and the laws that the circuit needs."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest
from scipy.integrate import quad
from scipy.optimize import linprog
from scipy.special import erfc

from circuits import anatomy
from circuits.cells import Lif
from circuits.cells.membrane import fit_current, lif_mean_mv, lif_rate_hz
from circuits.dynamics import noise

SPIKING = anatomy.spiking_msprt()
# Population: the rates over which its current is fitted, and the largest departure from its line.
LINES = {"D1": (5, 60, 0.03), "D2": (3, 7, 0.06), "GPe": (20, 70, 0.01), "SNr": (5, 80, 0.04)}


def measured_hz(cell, mean_mv, neurons, dt_ms, run_ms, lowered=True):
    """Return the rate at each mean potential, and its standard error, after 150 ms."""
    c = cell.constants(np.ones(3), dt_ms)
    if not lowered:
        c["threshold"] += np.float32(cell.threshold_mv - cell.sampled_threshold_mv(dt_ms))
    group = np.repeat(np.arange(len(mean_mv)), neurons)
    nats = np.float32((np.array(mean_mv)[group] - cell.rest_mv) / cell.mv_per_nat)
    stream, state = noise.stream_key(11, 0, f"lif {dt_ms}"), cell.begin(0.0 * nats, *c.values())
    spikes, first = np.zeros(nats.size), round(150 / dt_ms)
    for k in range(first + round(run_ms / dt_ms)):
        ones = noise.counts_at(noise.byte_counts(noise.words(stream, k // 4, nats.size)), k)
        fired, *state = cell.tick(nats, ones, *state, *c.values())
        spikes += fired * (k >= first)
    parts = [spikes[group == i] * 1000 / run_ms for i in range(len(mean_mv))]
    return np.array([(hz.mean(), hz.std() / np.sqrt(hz.size)) for hz in parts]).T


def off_an_exponential(x, rate_hz):
    """Return by what fraction the rates miss the exponential of x that fits them best."""
    one, y = np.ones_like(x), np.log(rate_hz)
    below, above = np.stack([x, one, -one], axis=1), np.stack([-x, -one, -one], axis=1)
    limits = np.concatenate([below, above]), np.concatenate([y, -y])
    fit = linprog([0, 0, 1], *limits, bounds=[(None, None)] * 3)
    return float(np.expm1(fit.x[2]))


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


@pytest.mark.parametrize(("name", "dt_ms"), [("D1", 0.1), ("GPe", 0.1), ("GPe", 0.05)])
def test_cells_at_the_tick_fire_at_the_rate_of_continuous_time(name, dt_ms):
    """Within 1 %, with the noise of eight bits."""
    cell = SPIKING.population(name).cell
    mean = [lif_mean_mv(cell, rate) for rate in (8, 25, 60)]
    rate_hz, error = measured_hz(cell, mean, (5000, 1500, 1000), dt_ms, 1000.0)
    off = rate_hz / lif_rate_hz(cell, mean) - 1
    assert (error / rate_hz).max() < 0.005
    assert np.abs(off).max() < 0.01


def test_cells_at_the_tick_without_the_lowered_threshold_fire_too_little():
    """Negative control: a sampled path overshoots, which costs several per cent of the rate."""
    cell = SPIKING.population("GPe").cell
    mean = [lif_mean_mv(cell, 25)]
    rate_hz, _ = measured_hz(cell, mean, (1500,), 0.1, 500.0, lowered=False)
    assert rate_hz[0] / lif_rate_hz(cell, mean)[0] < 0.97


@pytest.mark.parametrize("name", LINES)
def test_fitted_currents_follow_the_line_and_are_those_of_the_table(name):
    row = SPIKING.population(name)
    *range_hz, off_nats = LINES[name]
    line = (row.baseline_hz, row.gain_hz_per_nat)
    rest_mv, mv_per_nat = fit_current(row.cell, *line, range_hz)
    assert row.cell.rest_mv == pytest.approx(rest_mv, abs=0.05)
    assert row.cell.mv_per_nat == pytest.approx(mv_per_nat, abs=0.05)
    wanted = np.linspace(*range_hz, 200)
    nats = (wanted - line[0]) / line[1]
    off = (lif_rate_hz(row.cell, rest_mv + mv_per_nat * nats) - wanted) / line[1]
    assert np.abs(off).max() < off_nats


# ---- the laws that the circuit needs


def test_integrate_and_fire_cells_are_no_exponential():
    """Negative control: noise makes them exponential over some two nats only."""
    cell = SPIKING.population("GPe").cell
    for nats, within in ((1.5, True), (3.0, False), (5.0, False)):
        rate = 1.0 * np.exp(np.linspace(0, nats, 40))
        mean = np.array([lif_mean_mv(cell, hz) for hz in rate])
        assert (off_an_exponential(mean, rate) < 0.05) == within


def test_gpe_is_s_minus_log_s_within_a_tenth_of_a_nat_near_its_set_point():
    """GPe of the spiking circuit is a line through S - ln S at s0: its error, in nats."""
    row, path = SPIKING.population("GPe"), SPIKING.projection("STN->GPe")
    assert isinstance(row.cell, Lif)
    s0 = -row.bias_nats / path.weight
    total = np.linspace(0.5, 5, 19)
    mean = row.cell.rest_mv + row.cell.mv_per_nat * (path.weight * total + row.bias_nats)
    out_nats = (lif_rate_hz(row.cell, mean) - row.baseline_hz) / row.gain_hz_per_nat
    wanted = (total - np.log(total)) - (s0 - np.log(s0))
    off = out_nats - wanted
    assert s0 == pytest.approx(2.2)
    assert np.abs(off[(total >= 1.25) & (total <= 3.25)]).max() < 0.1
    assert 0.5 < np.abs(off[-1]) < 0.8  # at S = 5: why a common mode must hold S near s0


def test_a_tick_of_a_lif_is_the_exact_solution_of_its_equation():
    cell = SPIKING.population("GPe").cell
    factors = np.random.default_rng(3).uniform(0.7, 1.3, (3, 50))
    tau, slope, top = factors
    c = cell.constants(factors, 0.1)
    lowest_mv = cell.sampled_threshold_mv(0.1, tau, top) - 3
    npt.assert_allclose(c["threshold"] / c["unit"], lowest_mv, rtol=1e-6)
    alpha = np.exp(-0.1 / (cell.tau_ms * tau))
    for v, nats, ones in ((3.0, -0.5, 4), (9.0, 0.3, 0), (14.0, 0.0, 7)):
        mean = cell.rest_mv + cell.mv_per_nat * slope * nats
        step = cell.noise_mv * np.sqrt(1 - alpha**2)
        exact = mean + (v - mean) * alpha + step * (ones - 4) / np.sqrt(2)
        kept = c["decay"] * c["unit"] * (v - cell.reset_mv)
        moved = kept + (c["rest"] + c["slope"] * nats + c["noise_step"] * ones)
        npt.assert_allclose(cell.reset_mv + moved / c["unit"], exact, rtol=1e-6)


@pytest.mark.parametrize("dt_ms", [0.05, 0.1, 0.2])
def test_the_sampled_threshold_lies_below_by_the_overshoot(dt_ms):
    cell = SPIKING.population("GPe").cell
    step = cell.noise_mv * np.sqrt(2 * dt_ms / cell.tau_ms)
    below = cell.threshold_mv - cell.sampled_threshold_mv(dt_ms)
    assert below == pytest.approx(0.5826 * step, rel=0.02)


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
    cell = SPIKING.population("GPe").cell
    c = cell.constants(np.array([1.0, 1.0, 1.3]), 0.1)
    for uniform in (0.0, 0.25, 1.0):
        v, wait = cell.begin(np.float64(uniform), *c.values())
        assert v == pytest.approx(uniform * c["threshold"] * c["unit"], rel=1e-6)
        assert wait == 0
    assert c["unit"] < 0.8
