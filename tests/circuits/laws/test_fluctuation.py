"""What a finite number of cells does to the fixed point, to spectra and to the variance of OUT."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.cells.phase import phase_spectrum
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.laws.fluctuation import (
    FREQUENCIES_HZ,
    KINK_NATS,
    _jumps,
    extra,
    out_variance,
    rate_spectrum,
    swept,
)
from tests.circuits.helpers import creeping, run_algebra, run_spikes, state

TABLE = anatomy.spiking_msprt()


def fed(*, cells, gain=1.0, tau_ms=5.0):
    """Return an irregular population that drives an exponential one through two filters."""
    rows = (
        Population("source", Phase(1.0), 40.0, 20.0, neurons=cells),
        Population("target", Rate(), 0.0, 10.0, transfer="exp", tau_ms=tau_ms),
    )
    path = Projection("source", "target", gain, delay_ms=2, tau_ms=4.0)
    ends = {"input": "source", "readout": "target"}
    return Circuit("fed", rows, (path,), 2, **ends, reference_nats=np.log(2))


def shot_covariance(cell, hz, a, b):
    """Return that of a cell's spikes through exp(-a t) and exp(-b t), rates in Hz (Cox 1962)."""

    def later(s):
        """Return the transform of the rate after a spike."""
        passed = np.exp((1 - np.sqrt(1 + 2 * s * cell.cv**2 / hz)) / cell.cv**2)
        return passed / (1 - passed)

    return hz / (a + b) * (1 + later(a) + later(b)) - hz**2 / (a * b)


@pytest.mark.parametrize("tau_ms", [0.0, 5.0])
def test_noise_of_spikes_lifts_an_exponential_by_half_its_variance(tau_ms):
    cells = 200
    wiring, x = state(fed(cells=cells, tau_ms=tau_ms))
    added = extra(wiring, x[None]).rates_hz[0]
    a, of = 1000 / 4, lambda x, y: shot_covariance(Phase(1.0), 40.0, x, y)
    variance = of(a, a) * a**2
    if tau_ms:
        b = 1000 / tau_ms
        variance = (of(a, a) - 2 * of(a, b) + of(b, b)) * (a * b / (a - b)) ** 2
    variance /= cells * 20.0**2
    target = wiring.blocks_of("target")
    expected = wiring.rates(x)[target] * variance / 2
    np.testing.assert_allclose(added[target], expected, rtol=0.01 if tau_ms else 0.04)
    assert not added[wiring.blocks_of("source")].any()


@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b", "linear_gpe"])
def test_a_circuit_of_rates_has_no_noise(name):
    table = anatomy.load_circuit(name, 3)
    drive = np.array([[[1.0, 0.0, -1.0]]])
    line, finite = (run_algebra(table, drive, laws=laws) for laws in ("table", "finite"))
    np.testing.assert_allclose(finite.output_nats, line.output_nats, atol=1e-9)


def test_the_noise_of_few_cells_is_in_the_fixed_point():
    table = anatomy.spiking_msprt(2).with_neurons(100)
    # So many that the error of the mean is a fortieth of what is computed.
    drive = np.zeros((200, 1, 2))
    drive[:, 0] = 1.0, -1.0
    spikes = run_spikes(table, drive, step_ms=4000, seed=73, rates=False, sample_ms=5.0)
    measured = spikes.output_nats[:, 200:, 0].mean(axis=1)
    error = measured.std(ddof=1) / np.sqrt(len(measured))
    known = [run_algebra(table, drive[:1], laws=laws) for laws in ("cells", "finite")]
    cells, finite = (each.output_nats[0, 0, 0] for each in known)
    assert abs(measured.mean() - cells) > 4 * error
    assert abs(measured.mean() - finite) < 0.15 * abs(measured.mean() - cells)


def test_frequencies_are_added_near_a_resonance_until_no_step_turns_too_far():
    table = anatomy.spiking_msprt()
    most = []
    for times, more in ((1.0, False), (1.8, True)):
        wiring, x = state(table.scale("STN->GPe", times))
        frequency, response = swept(wiring, x[None])
        turns = np.abs(np.log(response.det[:, 1:] / response.det[:, :-1]))
        assert (np.diff(frequency) > 0).all()
        assert turns.max() <= 0.5
        assert (len(frequency) > len(FREQUENCIES_HZ)) == more
        most.append(len(frequency))
    assert max(most) < 2 * len(FREQUENCIES_HZ)


def test_noise_is_refused_where_a_state_grows_without_an_oscillation():
    with pytest.raises(ValueError, match="the fixed point of creeping is unstable"):
        out_variance(creeping(0.0074))
    assert np.isfinite(out_variance(creeping(-0.0074))["source"]).all()


@pytest.mark.parametrize(("steep", "share"), [(0.3, 0.01), (1.0, 0.01), (8.0, 0.08)])
def test_a_slope_that_changes_by_a_hundredth_has_a_kink(steep, share):
    """Of itself where it is steep, of 1 where it is flat; within a hundred-millionth of a nat."""
    at = np.array([-3 * KINK_NATS, -KINK_NATS / 2, 0.0, KINK_NATS / 2, 3 * KINK_NATS])
    for change, seen in ((1.1 * share, [0, 1, 1, 1, 0]), (0.9 * share, [0] * 5)):
        for start, sign in ((steep, 1), (-steep, 1), (steep + change, -1)):
            jumps = _jumps(lambda x: start + sign * change * (x > 0), at)  # noqa: B023
            assert jumps.tolist() == seen


MANY = TABLE.with_neurons(1000)


@pytest.fixture(scope="module")
def at_rest():
    """Return 1 000 cells at rest: of 300, D1 near silence bends too much for small noise."""
    return run_spikes(MANY, np.zeros((20, 3, 2)), step_ms=1000, seed=72)


@pytest.mark.parametrize("name", ["ctx", "D1", "STN", "GPe", "SNr"])
def test_power_of_rates_is_what_spikes_show(at_rest, name):
    frequency, power = at_rest.spectrum(name, from_ms=500, segment_ms=500)
    inside = (frequency >= 4) & (frequency <= 300)
    ratio = power[inside] / rate_spectrum(MANY, name, frequency[inside])
    bands = [part.mean() for part in np.array_split(ratio, 4)]  # each known to 2 %
    np.testing.assert_allclose(bands, 1, atol=0.1)


@pytest.mark.parametrize("level", [pytest.param(1.0, marks=pytest.mark.validate), 0.5])
def test_beta_of_cells_that_differ_is_what_spikes_show(level):
    """With four times the cells: the law is for small noise, and few cells have less power."""
    table = anatomy.macaque().dopamine(level)
    assert table.population("STN").heterogeneity
    for row in table.populations:
        if row.spiking:
            table = table.with_population(row.name, neurons=4 * row.neurons)
    activity = run_spikes(table, np.zeros((40, 3, 2)), step_ms=1000, seed=75)
    for name in ("ctx", "STN", "GPe", "SNr"):
        frequency, power = activity.spectrum(name, from_ms=1000, segment_ms=500)
        band = (frequency >= 13) & (frequency <= 30)
        law = rate_spectrum(table, name, frequency[band]).mean()
        assert power[band].mean() == pytest.approx(law, rel=0.15), name


def test_power_of_cells_without_what_arrives_is_another():
    """A control: the noise of STN's cells without what arrives is off by more than a tenth."""
    wiring, x = state(TABLE)
    frequency = np.array([5.0, 20.0])
    row = TABLE.population("STN")
    rate = wiring.rates(x)[wiring.blocks_of("STN")][:1]
    # Two channels are averaged; one-sided.
    alone = 2 * phase_spectrum(row.cell, rate, frequency)[0] / (2 * row.neurons)
    assert (np.abs(rate_spectrum(TABLE, "STN", frequency) / alone - 1) > 0.1).all()


@pytest.mark.parametrize(
    "edit", [{}, pytest.param({"neurons": 900}, marks=pytest.mark.validate), {"without": "STN"}]
)
def test_out_scatters_as_computed(edit):
    table = TABLE.with_neurons(edit.get("neurons", 300))
    if "without" in edit:
        table = table.lesion(edit["without"], 0.1)
    drive = np.array([0.85, -0.85])
    held = np.tile(drive, (30, 1, 1))
    settings = {"step_ms": 5000, "seed": 74, "rates": False, "sample_ms": 5.0}
    out = run_spikes(table, held, **settings).output_nats[:, 200:, 0]
    measured = out.reshape(30, -1, 10).mean(axis=2)[:, ::2].std()
    whose = out_variance(table, drive, mean_ms=50)
    law = np.sqrt(sum(part[0] for part in whose.values()))
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
    both = (out_variance(table, [0.85, -0.85]) for table in (TABLE, TABLE.clamp("D2", 0.5)))
    intact, half = (whose["D2"][0] for whose in both)
    assert half == pytest.approx(intact / 4, rel=0.1)
