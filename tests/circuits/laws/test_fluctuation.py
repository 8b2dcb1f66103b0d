"""Cells that answer fluctuations, and what a finite number of cells does to a circuit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfcx

from circuits import anatomy, fixed_point
from circuits.cells import Phase, Rate
from circuits.engines import algebra
from circuits.engines.ensemble import run as ensemble
from circuits.laws.firing import lif_rate_hz
from circuits.laws.fluctuation import extra_rates
from circuits.laws.mean_field import settled
from circuits.laws.response import lif_response, phase_spectrum
from circuits.laws.spectra import out_variance, rate_spectrum
from circuits.spec import Circuit, Population, Projection

TABLE = anatomy.spiking_msprt()
SLOW, FAST = [1e-3], [3000.0]


def state(circuit):
    """Return the wiring and the state at rest with the cells' own laws."""
    wiring = fixed_point.wired(circuit)
    silence = np.zeros((1, circuit.channels))
    return wiring, settled(wiring, silence, fixed_point.solve(wiring, silence))[0]


def fed(*, cells, gain=1.0, tau_ms=5.0):
    """Return an irregular population that drives an exponential one through two filters."""
    rows = (
        Population("source", Phase(1.0), 40.0, 20.0, neurons=cells),
        Population("target", Rate(), 0.0, 10.0, transfer="exp", tau_ms=tau_ms),
    )
    path = Projection("source", "target", gain, delay_ms=2, tau_ms=4.0)
    table = Circuit("fed", rows, (path,), 2, input="source", readout="target")
    return replace(table, reference_nats=np.log(2))


# ---- one cell


@pytest.mark.parametrize("name", ["D1", "GPe"])
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


@pytest.mark.parametrize("name", ["D1", "GPe"])
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


@pytest.mark.parametrize("name", ["D1", "GPe"])
@pytest.mark.parametrize("above_mv", [-3.0, 2.0])
def test_all_frequencies_together_are_more_noise_of_the_membrane(name, above_mv):
    """White input of power S adds S/(2 tau) to sd^2: Siegert's law says what the rate gains."""
    cell = replace(TABLE.population(name).cell, refractory_ms=0.0)
    mean = cell.threshold_mv + above_mv
    frequency = np.concatenate([[1e-3], np.geomspace(0.1, 20_000, 200)])
    bend = lif_response(cell, [mean], frequency).bend[0]
    # It falls as the frequency to the -3/2 in the end: the rest of the integral.
    gained = 2 * (np.trapezoid(bend, frequency) + 2 * bend[-1] * frequency[-1])
    step = 0.01
    more, less = (
        lif_rate_hz(replace(cell, noise_mv=np.sqrt(cell.noise_mv**2 + by)), mean)
        for by in (step, -step)
    )
    law = (more - less) / (2 * step) / (2 * cell.tau_ms / 1000)
    print(f"{name} {above_mv}: {gained:.4f}, law {law:.4f}")
    assert gained == pytest.approx(law, rel=0.03)


# ---- a circuit


def shot_covariance(cell, hz, a, b):
    """Return that of a cell's spikes through exp(-a t) and exp(-b t), rates in Hz (Cox 1962)."""

    def later(s):
        """Return the transform of the rate after a spike."""
        passed = np.exp((1 - np.sqrt(1 + 2 * s * cell.cv**2 / hz)) / cell.cv**2)
        return passed / (1 - passed)

    return hz / (a + b) * (1 + later(a) + later(b)) - hz**2 / (a * b)


@pytest.mark.parametrize("tau_ms", [0.0, 5.0])
def test_noise_of_spikes_lifts_an_exponential_by_half_its_variance(tau_ms):
    """Renewal shot noise through filters of 4 and tau ms, in closed form."""
    cells = 200
    wiring, x = state(fed(cells=cells, tau_ms=tau_ms))
    extra = extra_rates(wiring, x[None])[0]
    a, of = 1000 / 4, lambda x, y: shot_covariance(Phase(1.0), 40.0, x, y)
    variance = of(a, a) * a**2
    if tau_ms:
        b = 1000 / tau_ms
        variance = (of(a, a) - 2 * of(a, b) + of(b, b)) * (a * b / (a - b)) ** 2
    variance /= cells * 20.0**2
    target = wiring.blocks_of("target")
    expected = wiring.rates(x)[target] * variance / 2
    np.testing.assert_allclose(extra[target], expected, rtol=0.01 if tau_ms else 0.04)
    assert not extra[wiring.blocks_of("source")].any()


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


@pytest.mark.parametrize("edit", [{}, {"neurons": 900}, {"without": "STN"}])
def test_out_scatters_as_computed(edit):
    """Means of 50 ms, 40 a trial."""
    table = TABLE.with_neurons(edit.get("neurons", 300))
    if "without" in edit:
        table = table.without(edit["without"], 0.1)
    drive = np.array([0.85, -0.85])
    held = np.tile(drive, (30, 1, 1))
    given = {"step_ms": 5000, "seed": 74, "rates": False, "sample_ms": 5.0}
    out = ensemble.run(table, held, **given).output_nats[:, 200:, 0]
    measured = out.reshape(30, -1, 10).mean(axis=2)[:, ::2].std()
    whose = out_variance(table, drive, mean_ms=50)
    law = np.sqrt(sum(part[0] for part in whose.values()))
    print(f"{edit}: {measured:.4f}, computed {law:.4f}")
    assert measured == pytest.approx(law, rel=0.06)


@pytest.mark.parametrize("channels", [8, 12])
def test_silent_losers_add_no_noise(channels):
    odds = np.log(0.9 * (channels - 1) / 0.1)
    drive = np.zeros(channels)
    drive[0] = odds
    whose = out_variance(anatomy.spiking_msprt(channels), drive - drive.mean())
    parts = [part[0] for part in whose.values()]
    assert min(parts) >= 0
    assert 0.01 < np.sqrt(sum(parts)) < 0.06


def test_a_lesion_takes_the_noise_with_what_it_takes():
    whole, half = (
        out_variance(table, [0.85, -0.85])["D2"][0]
        for table in (TABLE, TABLE.without("D2", 0.5, replaced=True))
    )
    assert half == pytest.approx(whole / 4, rel=0.1)


def test_the_noise_of_few_cells_is_in_the_fixed_point():
    """OUT of 100 cells a population lies off that of many by what is computed."""
    table = anatomy.spiking_msprt(2).with_neurons(100)
    # So many that the error of the mean is a fortieth of what is computed.
    drive = np.zeros((200, 1, 2))
    drive[:, 0] = 1.0, -1.0
    spikes = ensemble.run(table, drive, step_ms=4000, seed=73, rates=False, sample_ms=5.0)
    measured = spikes.output_nats[:, 200:, 0].mean(axis=1)
    error = measured.std(ddof=1) / np.sqrt(len(measured))
    cells, finite = (
        algebra.run(table, drive[:1], laws=laws).output_nats[0, 0, 0]
        for laws in ("cells", "finite")
    )
    print(f"{measured.mean():.4f} +- {error:.4f}, cells {cells:.4f}, finite {finite:.4f}")
    assert abs(measured.mean() - cells) > 4 * error
    assert abs(measured.mean() - finite) < 0.15 * abs(measured.mean() - cells)


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (TABLE.with_spread(0.1), "those of ctx differ by 10%"),
        (TABLE.with_connections(0.25), "ctx->D1 connects 25%"),
        (TABLE.with_projection("STN", "GPe", transfer="rectified"), "STN->GPe is rectified"),
        (
            TABLE.with_projection("STN", "GPe", delay_ms=20).with_projection(
                "GPe", "STN", delay_ms=20
            ),
            "is unstable",
        ),
    ],
)
def test_what_is_not_known_is_refused(table, what):
    with pytest.raises(ValueError, match=what):
        algebra.run(table, np.zeros((1, 1, 2)), laws="finite")


def test_bad_questions_are_refused():
    with pytest.raises(ValueError, match=r"drive must be 2 finite numbers, got \[1\.0\]"):
        out_variance(TABLE, [1.0])
    with pytest.raises(ValueError, match=r"frequency_hz must be 0\.001 or more, got 0\.0"):
        rate_spectrum(TABLE, "STN", [0.0])


def test_laws_are_named():
    with pytest.raises(ValueError, match="laws must be one of table, cells, finite, got 'own'"):
        algebra.run(TABLE, np.zeros((1, 1, 2)), laws="own")
