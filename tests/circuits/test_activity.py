"""Activity: totals, decoded rates, spectra, and drives that do not fit."""

import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.special import logsumexp

from circuits import anatomy, plots
from circuits.activity import RateMeans, checked_drive, total_nats, warn_beyond_range
from circuits.cells import Phase
from circuits.cells.phase import phase_spectrum
from circuits.circuit import Circuit
from circuits.declaration.rows import Population
from circuits.engines import run
from circuits.errors import RangeWarning
from tests.circuits.helpers import CLOSE, REFERENCE, evidence, run_algebra, run_rate, run_spikes
from tests.helpers import refused, unwarned


def test_total_is_the_log_of_the_sum():
    drive = evidence(4)
    expected = logsumexp(drive + REFERENCE - np.log(4), axis=1)
    assert np.allclose(total_nats(anatomy.bogacz_gurney(4), drive), expected, atol=1e-12)


def test_rates_decode_to_the_activity_they_stand_for():
    circuit = anatomy.bogacz_gurney(4)
    drive = evidence(4)
    activity = run_algebra(circuit, drive[:, None])
    s = total_nats(circuit, drive)
    assert np.abs(activity.decoded_nats("STN").sum(axis=2)[:, 0] - s).max() < CLOSE
    assert np.abs(activity.decoded_nats("GPe")[:, 0, 0] - (s - np.log(s))).max() < CLOSE
    assert np.array_equal(activity.decoded_nats("SNr"), activity.output_nats)
    means = RateMeans()
    means.add(activity)
    table = means.table()
    assert len(table) == 4 * 4 + 1
    mean_hz = table[table.population == "GPe"].rate_hz.iloc[0]
    assert mean_hz == pytest.approx(activity.rates_hz["GPe"].mean())


def test_independent_spikes_have_twice_their_rate_over_their_number():
    """The one-sided density of n cells is twice the power of one over n, at every frequency."""
    hz, cells = 40.0, 300
    row = Population("source", Phase(1.0), hz, 1.0, neurons=cells)
    alone = Circuit("alone", (row,), (), 2, input="source", readout="source")
    alone = replace(alone, reference_nats=np.log(2))
    recorded = run_spikes(alone, np.zeros((20, 4, 2)), step_ms=1000, seed=71)
    frequency, power = recorded.spectrum("source", from_ms=500)
    assert frequency[1] == 1  # Hz: a segment is a second unless told otherwise
    inside = (frequency > 5) & (frequency < 480)
    # Two channels are averaged: their number is that of both.
    law = 2 * phase_spectrum(Phase(1.0), [hz], frequency[inside])[0] / (2 * cells)
    assert power[inside].mean() == pytest.approx(law.mean(), rel=0.03)
    half = frequency[inside] < 50
    assert power[inside][half].mean() == pytest.approx(law[half].mean(), rel=0.1)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (np.zeros((2, 3)), r"drive \(trials, steps, channels\)"),
        (np.zeros((0, 3, 2)), "drive"),
        (np.zeros((2, 3, 4)), r"drive has 4 hypotheses.*load_circuit\(\.\.\., 4\)"),
        (np.full((1, 1, 2), np.nan), "drive finite"),
        (np.full((1, 1, 2), -np.inf), "drive finite"),
        ("abc", "drive numbers"),
    ],
)
def test_a_drive_that_does_not_fit_is_refused(circuit, drive, message):
    for engine in (checked_drive, run_algebra, lambda *a: run_rate(*a, step_ms=1)):
        with refused(message):
            engine(circuit, drive)


def test_a_circuit_in_saliences_says_between_which_inputs_it_works():
    """A channel is driven by what it rests at and its own evidence."""
    circuit = replace(anatomy.gpr(), range_nats=(0.0, 0.9))
    rest = circuit.rest_drive
    with unwarned():
        warn_beyond_range(circuit, np.array([-rest, 0.9 - rest]))
    for drive in ([-rest - 0.25, 0.5], [0.2, 1.3 - rest]):
        warning = f"the input runs from {rest + drive[0]:.2f} to {rest + drive[1]:.2f} salience"
        with pytest.warns(RangeWarning, match=warning):
            warn_beyond_range(circuit, np.array(drive))


@pytest.fixture
def activity():
    drive = np.zeros((2, 3, 2))
    return run(anatomy.spiking_msprt(), drive, engine="rate", step_ms=20.0)


def test_rates_are_drawn_a_panel_per_nucleus_and_a_line_per_channel(activity):
    figure = activity.plot(1, smooth_ms=0)
    assert len(figure.axes) == len(activity.circuit.populations) + 1
    drawn = {ax.get_ylabel(): ax for ax in figure.axes}
    assert len(drawn["STN"].lines) == 2
    assert (drawn["STN"].lines[1].get_ydata() == activity.rates_hz["STN"][1, :, 1]).all()
    assert (drawn["OUT\n(nats)"].lines[0].get_ydata() == activity.output_nats[1, :, 0]).all()
    plt.close(figure)


def test_activity_in_words_and_as_a_page_holds_its_size_and_mean_rates(activity):
    assert f"2 trials x {len(activity.time_ms)} ticks x 2 channels" in repr(activity)
    page = activity._repr_html_()
    for name, rates in activity.rates_hz.items():
        assert re.search(rf"<th>{name}</th>\s*<td>{rates[:, :, 0].mean():.4g}</td>", page)


def test_smoothing_keeps_a_constant_and_what_is_unknown():
    values = np.full((50, 1), 7.0)
    values[40:] = np.nan
    smooth = plots.smoothed(values, 1.0, 5.0)
    assert smooth[:40] == pytest.approx(7.0)
    assert np.isnan(smooth[40:]).all()


def test_labelled_arrays_hold_what_the_activity_holds():
    circuit = anatomy.spiking_msprt(3)
    activity = run_rate(circuit, evidence(3)[:2, None], step_ms=20.0)
    dataset = activity.to_xarray()
    assert np.array_equal(dataset.output, activity.output_nats)
    one = dataset.rate_hz.sel(nucleus="STN", channel=2, trial=1)
    assert np.array_equal(one, activity.rates_hz["STN"][1, :, 2])
    pooled = next(row.name for row in circuit.populations if row.pooled)
    for channel in range(3):
        rate = dataset.rate_hz.sel(nucleus=pooled, channel=channel)
        assert np.array_equal(rate, activity.rates_hz[pooled][:, :, 0])
    assert "rate_hz" not in replace(activity, rates_hz={}).to_xarray()


def test_a_rate_at_its_baseline_stands_for_no_nats():
    """OUT is read from SNr, whose cells fire at 0 nats too."""
    circuit = anatomy.macaque(2)
    assert circuit.population("SNr").baseline_hz > 0
    activity = run_algebra(circuit, np.zeros((1, 1, 2)))
    np.testing.assert_allclose(activity.decoded_nats("SNr"), activity.output_nats, atol=1e-9)
