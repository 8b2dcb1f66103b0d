"""The population engine with cells' own laws and noise: held to closed forms and to theory."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.special import expit

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.cells.cell import Line
from circuits.cells.phase import phase_spectrum
from circuits.circuit import Circuit
from circuits.declaration import transfer
from circuits.declaration.rows import Population, Projection
from circuits.dynamics.ticks import cell_factors
from circuits.engines import run
from circuits.engines.population import run as engine
from circuits.engines.population.answers import Mixture
from circuits.errors import NoiseWarning
from circuits.laws.fluctuation import out_variance, rate_spectrum
from tests.circuits.helpers import run_algebra

SEED = 3
SINGLE = 2e-4
FULL = anatomy.spiking_msprt(2)


def populations(circuit, drive, *, step_ms=500.0, seed=SEED, **options):
    return run(circuit, drive, engine="population", step_ms=step_ms, seed=seed, **options)


def source(cell, hz, neurons=100, **fields):
    """Return a population at a steady rate, read by a unit of rate."""
    of = Population("ctx", cell, hz, 10.0, neurons=neurons, **fields)
    read = Population("SNr", Rate(signed=True), 0.0, 10.0, transmitter="GABA")
    path = Projection("ctx", "SNr", 1.0)
    return Circuit("source", (of, read), (path,), channels=2, reference_nats=np.log(2))


BANDS = ((3, 12), (18, 30), (60, 100))


def check_power(activity, law, bands=BANDS, rel=0.12):
    """Hold the power of 2 * 100 cells' rates to that of one by a law, in bands of Hz."""
    at, power = activity.spectrum("ctx", from_ms=300, segment_ms=500)
    for low, high in bands:
        band = (at >= low) & (at <= high)
        exact = 2 * np.mean(law(at[band])) / 200
        assert power[band].mean() == pytest.approx(exact, rel=rel), (low, high)


def clocks(cv, hz):
    """Return the power of pacemakers at rates as a law of the frequency."""
    return lambda at: phase_spectrum(Phase(cv), np.atleast_1d(hz), at)


@pytest.mark.parametrize(
    ("cv", "hz", "dt_ms"), [(0.3, 24.0, 0.1), (0.3, 60.0, 0.25), (0.5, 55.0, 0.5), (1.0, 30.0, 0.5)]
)
def test_own_noise_is_that_of_so_many_renewal_cells_at_any_tick(cv, hz, dt_ms):
    activity = populations(source(Phase(cv), hz), np.zeros((400, 6, 2)), dt_ms=dt_ms)
    assert activity.rates_hz["ctx"].mean() == pytest.approx(hz, rel=0.002)
    six = ((3, 9), (9, 17), (17, 29), (29, 45), (45, 70), (70, 100))
    check_power(activity, clocks(cv, hz), six, rel=0.1)


def test_the_whole_circuit_fluctuates_as_linear_theory_says():
    """At rest, where it holds best: each nucleus within 15 % from 4 to 100 Hz, OUT's sd in 5 %."""
    activity = populations(FULL, np.zeros((300, 5, 2)), settle_ms=1000)
    for name in ("ctx", "D2", "STN", "GPe", "SNr"):
        at, power = activity.spectrum(name, segment_ms=500)
        for low, high in ((4, 10), (10, 20), (20, 35), (35, 60), (60, 100)):
            band = (at >= low) & (at <= high)
            exact = rate_spectrum(FULL, name, at[band]).mean()
            assert power[band].mean() == pytest.approx(exact, rel=0.15), (name, low, high)
    out = activity.output_nats[:, ::50]
    sd = np.sqrt(sum(variance[0] for variance in out_variance(FULL).values()))
    assert out.std() == pytest.approx(sd, rel=0.05)


def test_mean_rates_are_those_of_a_finite_number_of_cells():
    """Noise moves means where cells bend; by theory to first order in 1/n."""
    held = np.array([0.5, -0.5])
    activity = populations(FULL, np.tile(held, (200, 5, 1)), settle_ms=1000)
    known = run_algebra(FULL, held[None, None], laws="finite")
    for name, rates in activity.rates_hz.items():
        late = rates[:, 1000:].mean(axis=(0, 1))
        np.testing.assert_allclose(late, known.rates_hz[name][0, 0], rtol=0.01, atol=0.15)


@pytest.mark.parametrize(("laws", "exact"), [("lines", "table"), ("cells", "cells")])
def test_without_noise_it_settles_at_the_fixed_point_of_its_laws(laws, exact):
    held = np.array([0.4, -0.4])
    activity = populations(FULL, np.tile(held, (1, 10, 1)), laws=laws, noise=False)
    known = run_algebra(FULL, held[None, None], laws=exact)
    np.testing.assert_allclose(activity.output_nats[0, -1], known.output_nats[0, 0], atol=SINGLE)


def test_cells_that_differ_answer_as_their_mean_does():
    """Siegert's rate averaged over all cells of a channel, and the power of all of them."""
    heterogeneity, x = 0.15, np.linspace(-0.5, 1.5, 9)
    row = FULL.with_heterogeneity(heterogeneity).population("GPe")
    alike = Mixture(row.cell, "linear", 45.0, 80.0)
    differ = replace(alike, heterogeneity=heterogeneity)
    table = FULL.with_heterogeneity(heterogeneity)
    factors = np.concatenate([cell_factors(table, "GPe", c) for c in (0, 1)], 1)
    every = np.mean([row.cell.varied(f)[0].rate_hz(x, x) for f in factors.T], axis=0)
    np.testing.assert_allclose(differ.rate_hz(x), every, rtol=0.02)
    off = [np.abs(mean.rate_hz(x) - every).max() for mean in (alike, differ)]
    assert off[1] < 0.35 * off[0]


def test_pacemakers_that_differ_have_their_mean_power():
    hz, cv = 30.0, 0.3
    activity = populations(source(Phase(cv), hz, heterogeneity=0.2), np.zeros((300, 6, 2)))
    assert activity.rates_hz["ctx"].mean() == pytest.approx(hz, rel=0.002)
    each = hz * np.maximum(1 + 0.2 * np.random.default_rng(1).normal(size=2000), 0.1)
    check_power(activity, clocks(cv, each), ((3, 12), (20, 40), (60, 90)))


def test_lines_without_noise_are_those_of_cells_that_differ_too():
    drive = np.random.default_rng(1).normal(0, 0.3, (3, 3, 2))
    apart = FULL.with_heterogeneity(0.1).with_connections(0.25)
    alike, differ = (run(table, drive, engine="rate", step_ms=50) for table in (FULL, apart))
    assert alike.output_nats.tobytes() == differ.output_nats.tobytes()


def test_a_transfer_of_ones_own_is_looked_up(monkeypatch):
    law, slope, bend = partial(np.logaddexp, 0), expit, lambda x: 1 / (2 + 2 * np.cosh(x))
    soft = transfer.Transfer(law, slope, bend, "log(1 + exp({x}))", "soft")
    monkeypatch.setitem(transfer.TRANSFERS, "softplus", soft)
    circuit = replace(source(Rate(), 0.0, transfer="softplus"), reference_nats=2.0)
    drive = np.array([[[0.5, -0.5]]])
    out_nats = run(circuit, drive, engine="rate", step_ms=500).output_nats[0, -1]
    np.testing.assert_allclose(out_nats, run_algebra(circuit, drive).output_nats[0, 0], atol=1e-3)


def test_the_colour_of_noise_follows_the_state():
    drive = np.full((400, 5, 2), 4.0)
    activity = populations(source(Phase(0.3), 20.0), drive)
    assert activity.rates_hz["ctx"][:, 300:].mean() == pytest.approx(60, rel=0.005)
    check_power(activity, clocks(0.3, 60.0), ((3, 12), (18, 30), (50, 70)))


def test_lines_with_noise_have_the_noise_of_the_cells():
    """An integrate-and-fire cell alone on its line: its power is that of its spikes."""
    cell = FULL.population("SNr").cell
    row = FULL.population("SNr")
    circuit = source(cell, row.baseline_hz).with_population("ctx", gain_hz_per_nat=95.0)
    held = np.full((300, 4, 2), 0.3)
    activity = populations(circuit, held, laws="lines")
    line = Line(*(np.ones(1) for _ in range(3)))
    scale = (row.baseline_hz + 0.3 * 95) / cell.rate_hz(np.array([0.3]), np.ones(1))[0]

    def law(at):
        return scale * cell.response(np.array([0.3]), line, at).spectrum[0]

    check_power(activity, law, ((3, 12), (18, 40), (60, 100)))


def test_rates_that_run_away_anywhere_are_said():
    """In a channel that is not the first, and where the read-out does not hear of it."""
    side = Population("side", Rate(signed=True), 0.0, 10.0)
    paths = (Projection("ctx", "side", 1.0), Projection("side", "side", 3.0, delay_ms=1))
    looped = source(Rate(), 1.0).with_rows(Projection("ctx", "ctx", 3.0, delay_ms=2))
    looped = looped.scale("ctx->ctx", 0.0, channel=0)
    for circuit in (source(Rate(), 1.0).with_rows(side, *paths), looped):
        with pytest.raises(ValueError, match=r"rates of source run away, \d+ ms after onset"):
            run(circuit, np.ones((1, 5, 2)), engine="rate", step_ms=500)


@pytest.mark.parametrize(
    "circuit", [FULL.with_neurons(10), source(Phase(0.0), 40.0), source(Phase(0.1), 40.0)]
)
def test_few_cells_clocks_and_noise_that_filters_miss_are_said_every_time(circuit):
    for _ in range(2):
        with pytest.warns(NoiseWarning):
            populations(circuit, np.zeros((1, 1, 2)))


@pytest.mark.parametrize(("amplified", "warned"), [(7.9, False), (8.1, True)])
def test_loops_that_amplify_more_than_eight_times_are_near_an_oscillation(
    amplified, warned, monkeypatch
):
    monkeypatch.setattr(engine, "_ringing", lambda circuit: (amplified, 20.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        noisy = populations(source(Phase(0.5), 40.0), np.zeros((1, 1, 2)), step_ms=10, settle_ms=0)
    assert any("near an oscillation" in str(one.message) for one in caught) == warned
    assert noisy.about["seed"] == SEED
