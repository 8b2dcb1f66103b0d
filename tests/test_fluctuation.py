"""Cells that answer fluctuations, and what a finite number of cells does to a circuit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfcx

from bgmodel.circuit_edits import steady_out
from circuits import algebra, anatomy, ensemble
from circuits.cells import Escape, Phase, Rate
from circuits.firing import lif_rate_hz
from circuits.fluctuation import extra_rates
from circuits.mean_field import settled
from circuits.response import escape_spectrum, lif_response, phase_spectrum
from circuits.spec import Circuit, Population, Projection
from circuits.spectra import out_variance, rate_spectrum

TABLE = anatomy.spiking_msprt()
SLOW, FAST = [1e-3], [3000.0]


def state(circuit):
    """Return the wiring and the state at rest with the cells' own laws."""
    wiring = algebra.wired(circuit)
    silence = np.zeros((1, circuit.channels))
    return wiring, settled(wiring, silence, algebra.solve(wiring, silence))[0]


def fed(*, cells, gain=1.0, tau_ms=5.0):
    """Return a Poisson population that drives an exponential one through two filters."""
    rows = (
        Population("source", Escape(), 40.0, 20.0, neurons=cells),
        Population("target", Rate(), 0.0, 10.0, transfer="exp", tau_ms=tau_ms),
    )
    path = Projection("source", "target", gain, delay_ms=2, tau_ms=4.0)
    table = Circuit("fed", rows, (path,), 2, input="source", readout="target")
    return replace(table, reference_nats=np.log(2))


# ---- one cell


@pytest.mark.parametrize("name", ["D1", "D2", "GPe", "SNr"])
@pytest.mark.parametrize("above_mv", [-6.0, -2.0, 0.0, 4.0])
def test_slow_fluctuations_see_slope_and_curvature_of_siegerts_law(name, above_mv):
    cell = TABLE.population(name).cell
    mean, step = cell.threshold_mv + above_mv, 0.1
    low, here, high = lif_rate_hz(cell, mean + step * np.array([-1, 0, 1]))
    found = lif_response(cell, [mean], SLOW)
    assert found.gain[0, 0].real == pytest.approx((high - low) / (2 * step), rel=3e-3)
    assert abs(found.gain[0, 0].imag) < 1e-3 * found.gain[0, 0].real
    bend = (high - 2 * here + low) / (2 * step**2)
    assert found.bend[0, 0] == pytest.approx(bend, rel=1e-2, abs=2e-4)


@pytest.mark.parametrize("name", ["D1", "GPe"])
def test_fast_modulation_passes_as_one_over_the_root_of_its_frequency(name):
    """|gain| is r / (sd sqrt(omega tau)): Brunel, Chance, Fourcaud & Abbott 2001."""
    cell = TABLE.population(name).cell
    mean = cell.threshold_mv + 1.0
    law = lif_rate_hz(cell, mean) / np.sqrt(2 * np.pi * FAST[0] * cell.tau_ms / 1000)
    found = np.abs(lif_response(cell, [mean], FAST).gain[0, 0])
    assert found == pytest.approx(law / cell.noise_mv, rel=0.03)


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
    found = lif_response(cell, [mean], SLOW).spectrum[0, 0]
    assert found / rate == pytest.approx(cv2, rel=5e-3)


@pytest.mark.parametrize("name", ["D1", "GPe", "SNr"])
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
    poisson = escape_spectrum(Escape(), rate, [0.1, 10.0, 1000.0])
    np.testing.assert_allclose(poisson, np.repeat(rate[:, None], 3, axis=1))
    held = Escape(refractory_ms=5.0)
    slower = rate / (1 + 0.005 * rate)
    # An exponential waiting time after a fixed one.
    expected = slower * (slower / rate) ** 2
    np.testing.assert_allclose(escape_spectrum(held, rate, SLOW)[:, 0], expected, 1e-4)


# ---- a circuit


@pytest.mark.parametrize("tau_ms", [0.0, 5.0])
def test_poisson_noise_lifts_an_exponential_by_half_its_variance(tau_ms):
    """Shot noise through filters of 4 and tau ms: variance r / (2 (4 + tau) n) a squared gain."""
    cells = 200
    wiring, x = state(fed(cells=cells, tau_ms=tau_ms))
    extra = extra_rates(wiring, x[None])[0]
    variance = 40.0 / (2 * (4 + tau_ms) / 1000 * cells) / 20.0**2
    target = wiring.blocks_of("target")
    expected = wiring.rates(x)[target] * variance / 2
    np.testing.assert_allclose(extra[target], expected, rtol=0.01 if tau_ms else 0.04)
    assert not extra[wiring.blocks_of("source")].any()


def test_a_finite_number_counts_as_one_over_itself():
    one, ten = (
        extra_rates(*(part[None] if k else part for k, part in enumerate(state(table))))
        for table in (TABLE, TABLE.with_neurons(3000))
    )
    np.testing.assert_allclose(ten, one / 10, rtol=1e-9, atol=1e-12)
    assert np.abs(one).max() > 0.01


@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b", "linear_gpe"])
def test_rates_have_no_noise(name):
    table = anatomy.circuit(name, 3)
    drive = np.array([[[1.0, 0.0, -1.0]]])
    line, finite = (algebra.run(table, drive, laws=laws) for laws in ("table", "finite"))
    np.testing.assert_allclose(finite.output_nats, line.output_nats, atol=1e-9)


MANY = TABLE.with_neurons(1000)


@pytest.fixture(scope="module")
def at_rest():
    """Return 1 000 cells at rest: of 300, D1 near silence bends too much for small noise."""
    return ensemble.run(MANY, np.zeros((10, 3, 2)), step_ms=1000, seed=72)


@pytest.mark.parametrize("name", ["ctx", "D1", "STN", "GPe", "SNr"])
def test_power_of_rates_is_what_spikes_show(at_rest, name):
    """Of all populations, loops and all, from 4 to 300 Hz, in eight bands."""
    frequency, power = at_rest.spectrum(name, from_ms=500, segment_ms=500)
    inside = (frequency >= 4) & (frequency <= 300)
    ratio = power[inside] / rate_spectrum(MANY, name, frequency[inside])
    bands = [part.mean() for part in np.array_split(ratio, 8)]
    print(f"{name}: measured over computed {np.round(bands, 3)}")
    np.testing.assert_allclose(bands, 1, atol=0.1)


def test_cells_alone_have_another_power():
    """A control: the noise of STN's cells without what arrives is off by more than a tenth."""
    wiring, x = state(TABLE)
    frequency = np.array([5.0, 20.0])
    row = TABLE.population("STN")
    rate = wiring.rates(x)[wiring.blocks_of("STN")][:1]
    # Two channels are averaged; one-sided.
    alone = 2 * phase_spectrum(row.cell, rate, frequency)[0] / (2 * row.neurons)
    assert (np.abs(rate_spectrum(TABLE, "STN", frequency) / alone - 1) > 0.1).all()


@pytest.mark.parametrize(("neurons", "trials"), [(100, 150), (600, 80)])
def test_out_scatters_from_trial_to_trial_as_computed(neurons, trials):
    table = TABLE.with_neurons(neurons)
    odds = 1.7
    measured = steady_out(table, [odds], seed=74, trials=trials, mean_ms=50).std(ddof=1)
    whose = out_variance(table, [odds / 2, -odds / 2], mean_ms=50)
    law = np.sqrt(sum(part[0] for part in whose.values()))
    print(f"{neurons}: {measured:.4f}, computed {law:.4f}")
    assert measured == pytest.approx(law, rel=4 / np.sqrt(2 * trials))


def test_the_noise_of_few_cells_is_in_the_fixed_point():
    """OUT of 100 cells a population lies off that of many by what is computed."""
    table = anatomy.spiking_msprt(2).with_neurons(100)
    drive = np.zeros((60, 1, 2))
    drive[:, 0] = 1.0, -1.0
    spikes = ensemble.run(table, drive, step_ms=2000, seed=73, rates=False, sample_ms=5.0)
    measured = spikes.output_nats[:, 200:, 0].mean(axis=1)
    error = measured.std(ddof=1) / np.sqrt(len(measured))
    cells, finite = (
        algebra.run(table, drive[:1], laws=laws).output_nats[0, 0, 0]
        for laws in ("cells", "finite")
    )
    print(f"{measured.mean():.4f} +- {error:.4f}, cells {cells:.4f}, finite {finite:.4f}")
    assert abs(measured.mean() - cells) > 4 * error
    assert abs(measured.mean() - finite) < 0.4 * abs(measured.mean() - cells)


def test_the_noise_of_one_nucleus_falls_with_its_own_cells():
    drive = [0.85, -0.85]
    few, many = (out_variance(t, drive) for t in (TABLE, TABLE.changed("D2", neurons=3000)))
    assert many["D2"][0] == pytest.approx(few["D2"][0] / 10, rel=0.02)
    for name in ("ctx", "D1", "STN", "GPe", "SNr"):
        assert many[name][0] == pytest.approx(few[name][0], rel=0.02)


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (TABLE.with_spread(0.1), "those of ctx differ by 10%"),
        (TABLE.with_connections(0.25), "ctx->D1 connects 25%"),
        (TABLE.changed("STN->GPe", transfer="rectified"), "STN->GPe is rectified"),
    ],
)
def test_what_is_not_known_is_refused(table, what):
    with pytest.raises(ValueError, match=what):
        algebra.run(table, np.zeros((1, 1, 2)), laws="finite")


def test_laws_are_named():
    with pytest.raises(ValueError, match="laws must be one of table, cells, finite, got 'own'"):
        algebra.run(TABLE, np.zeros((1, 1, 2)), laws="own")
