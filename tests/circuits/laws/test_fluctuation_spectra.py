"""Spectra of rates and the variance of OUT, against spikes."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells.phase import phase_spectrum
from circuits.laws.fluctuation import out_variance, rate_spectrum
from tests.circuits.helpers import run_ensemble, state
from tests.helpers import refused

TABLE = anatomy.spiking_msprt()
MANY = TABLE.with_neurons(1000)


@pytest.fixture(scope="module")
def at_rest():
    """Return 1 000 cells at rest: of 300, D1 near silence bends too much for small noise."""
    return run_ensemble(MANY, np.zeros((10, 3, 2)), step_ms=1000, seed=72)


@pytest.mark.parametrize("name", ["ctx", "D1", "STN", "GPe", "SNr"])
def test_power_of_rates_is_what_spikes_show(at_rest, name):
    """Of all populations, loops and all, from 4 to 300 Hz, in eight bands."""
    frequency, power = at_rest.spectrum(name, from_ms=500, segment_ms=500)
    inside = (frequency >= 4) & (frequency <= 300)
    ratio = power[inside] / rate_spectrum(MANY, name, frequency[inside])
    bands = [part.mean() for part in np.array_split(ratio, 8)]
    np.testing.assert_allclose(bands, 1, atol=0.1)


@pytest.mark.parametrize("level", [pytest.param(1.0, marks=pytest.mark.validate), 0.5])
def test_beta_of_cells_that_differ_is_what_spikes_show(level):
    """The macaque's, in which every cell has a different rate, from 13 to 30 Hz."""
    table = anatomy.macaque().dopamine(level)
    assert table.population("STN").heterogeneity
    activity = run_ensemble(table, np.zeros((20, 3, 2)), step_ms=1000, seed=75)
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
    """Means of 50 ms, 40 a trial."""
    table = TABLE.with_neurons(edit.get("neurons", 300))
    if "without" in edit:
        table = table.lesion(edit["without"], 0.1)
    drive = np.array([0.85, -0.85])
    held = np.tile(drive, (30, 1, 1))
    settings = {"step_ms": 5000, "seed": 74, "rates": False, "sample_ms": 5.0}
    out = run_ensemble(table, held, **settings).output_nats[:, 200:, 0]
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
    intact, half = (
        out_variance(table, [0.85, -0.85])["D2"][0] for table in (TABLE, TABLE.clamp("D2", 0.5))
    )
    assert half == pytest.approx(intact / 4, rel=0.1)


def test_a_drive_or_frequency_without_sense_is_refused():
    with refused("drive"):
        out_variance(TABLE, [1.0])
    with refused("frequency_hz"):
        rate_spectrum(TABLE, "STN", [0.0])
