"""The adaptive exponential cell: its equations, and the same spikes in all engines."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from circuits.cells import single
from tests.circuits.spiking import ADEX, BASE, SPIKING, spikes_of


def test_an_adex_without_upstroke_and_adaptation_is_the_exact_linear_membrane():
    cell = replace(ADEX, sharpness_mv=1e-3, knee_mv=1000, peak_mv=2000, adaptation=0, jump_mv=0)
    c = cell.constants(np.ones(3), 0.1)
    _, v, w, _ = cell.tick(
        np.float64(0.3), single.single(4), *map(single.single, (5, 0, 0)), *c.values()
    )
    mean = cell.rest_mv + 0.3 * cell.mv_per_nat - cell.reset_mv
    assert v == pytest.approx(mean + (5 - mean) * np.exp(-0.1 / cell.tau_ms), rel=1e-6)
    assert w == 0


def isi_ms(cell, nats, count=12):
    """Return the intervals of a noiseless cell under a constant input, by the tick."""
    c = list(replace(cell, noise_mv=1e-6).constants(np.ones(3), 0.01).values())
    state, times = tuple(map(single.single, (0, 0, 0))), []
    for k in range(400_000):
        fired, *state = cell.tick(np.float64(nats), single.single(4), *state, *c)
        if fired:
            times.append(k * 0.01)
        if len(times) > count:
            break
    return np.diff(times)


def solved_isi_ms(cell, nats, count=12):
    """Return the same intervals from the equations, by an adaptive solver."""
    from scipy.integrate import solve_ivp

    def flow(_, y):
        v, w = y
        upstroke = cell.sharpness_mv * np.exp((v - cell.knee_mv) / cell.sharpness_mv)
        mean = cell.rest_mv + cell.mv_per_nat * nats
        return [
            (mean - v + upstroke - w) / cell.tau_ms,
            (cell.adaptation * (v - cell.leak_mv) - w) / cell.tau_w_ms,
        ]

    def peak(_, y):
        return y[0] - cell.peak_mv

    peak.terminal = True
    t, y, times = 0.0, [cell.reset_mv, 0.0], []
    while len(times) <= count:
        solution = solve_ivp(flow, (t, t + 1000), y, events=peak, rtol=1e-8, atol=1e-8)
        t = solution.t[-1] + cell.refractory_ms
        times.append(solution.t[-1])
        w_leak = cell.adaptation * (cell.reset_mv - cell.leak_mv)
        w = solution.y[1, -1] + cell.jump_mv
        w = w_leak + (w - w_leak) * np.exp(-cell.refractory_ms / cell.tau_w_ms)
        y = [cell.reset_mv, w]
    return np.diff(times)


def test_intervals_of_a_noiseless_adex_are_those_of_its_equations():
    cell = replace(ADEX, rest_mv=-40.0)
    intervals, solved = isi_ms(cell, 0.5), solved_isi_ms(cell, 0.5)
    npt.assert_allclose(intervals, solved, rtol=0.01)
    assert intervals[-1] > 1.5 * intervals[0]  # it adapts


@pytest.mark.parametrize(
    "circuit",
    [
        pytest.param(BASE.with_population("GPe", cell=ADEX), id="GPe"),
        pytest.param(
            BASE.with_heterogeneity(0.1).with_population("GPe", cell=ADEX), id="heterogeneity"
        ),
        pytest.param(BASE.with_population("D1", cell=ADEX), id="D1", marks=pytest.mark.validate),
    ],
)
def test_adex_cells_spike_alike_in_all_engines(circuit):
    spikes = [spikes_of(circuit, engine) for engine in SPIKING]
    assert spikes[0] == spikes[1] == spikes[2]
    assert len(spikes[0]) > 600


def test_factors_of_an_adex_are_of_its_time_constant_its_slope_and_its_way_to_the_knee():
    factors = np.array([(1, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2)])
    one, tau, slope, top = (ADEX.constants(each, 0.1) for each in factors)
    assert tau["decay"] == pytest.approx(np.exp(-0.1 / (2 * ADEX.tau_ms)), rel=1e-6)
    assert slope["slope"] == pytest.approx(2 * one["slope"], rel=1e-6)
    assert top["knee"] == pytest.approx(2 * one["knee"], rel=1e-6)
    assert slope["knee"] == one["knee"]
    assert top["slope"] == one["slope"]


def test_an_adex_starts_anywhere_between_reset_and_knee_and_is_ready():
    c = ADEX.constants(np.ones(3), 0.1)
    for uniform in (0.0, 0.25, 1.0):
        v, w, wait = ADEX.begin(np.float64(uniform), *c.values())
        assert v == pytest.approx(uniform * (ADEX.knee_mv - ADEX.reset_mv), rel=1e-6)
        assert w == wait == 0
