"""Where a circuit begins to oscillate: closed forms, and the rate engine."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

from circuits import anatomy
from circuits.laws.stability import ringing
from tests.circuits.helpers import MEMBERS, creeping, onset, run_algebra, run_rate


def loop(stn_ms, gpe_ms, delay_ms):
    """Return the exact circuit with other time constants and delays to GPe and back."""
    circuit = anatomy.bogacz_gurney().set("STN.tau_ms", stn_ms).set("GPe.tau_ms", gpe_ms)
    circuit = circuit.set("STN->GPe.delay_ms", delay_ms[0])
    return circuit.set("GPe->STN.delay_ms", delay_ms[1])


def at_sum(circuit, total):
    """Return the circuit at rest where S, the sum over channels, is ``total`` nats."""
    return replace(circuit, reference_nats=total)


def limit(circuit):
    """Return the S above which the fixed point is unstable, nats, and the frequency, Hz."""
    return onset(partial(at_sum, circuit), 1.0, 10.0)


def closed_form(stn_ms, gpe_ms, delay_ms):
    """Where (1 + s a)(1 + s b) + (S - 1) exp(-s D) = 0 has a root on the imaginary axis: S, Hz."""
    around = sum(delay_ms)
    phase = lambda w: np.arctan(w * stn_ms) + np.arctan(w * gpe_ms) + w * around - np.pi  # noqa: E731
    w = brentq(phase, 1e-9, np.pi / around, xtol=1e-15)
    return 1 + np.hypot(1, w * stn_ms) * np.hypot(1, w * gpe_ms), 1000 * w / (2 * np.pi)


LOOPS = {
    "assumed": ((5, 10, (2, 2)), 5.5),
    "Lindahl": ((6, 14, (5, 5)), 3.8),
    "macaque": ((6, 14, (3, 10)), 3.3),
}
OSCILLATING = {name: loop(*times) for name, (times, _) in LOOPS.items()} | {
    "appendix_b": anatomy.appendix_b(3, w_gpe_stn=0.4),
    "linear_gpe": anatomy.linear_gpe(),
}


@pytest.mark.parametrize(("times", "printed"), LOOPS.values(), ids=list(LOOPS))
def test_the_computed_limit_is_the_closed_form(times, printed):
    found, found_hz = limit(loop(*times))
    total, hertz = closed_form(*times)
    assert found == pytest.approx(total, rel=1e-6)
    # Peaks of amplification are looked for in steps of 2e-6.
    assert found_hz == pytest.approx(hertz, rel=5e-6)
    assert round(found, 1) == printed


def test_the_limit_does_not_depend_on_the_number_of_alternatives():
    total, _ = closed_form(*LOOPS["assumed"][0])
    for channels in (2, 5, 12):
        below, beyond = (
            ringing(at_sum(anatomy.bogacz_gurney(channels), total + apart))[0]
            for apart in (-5e-6, 5e-6)
        )
        assert np.isfinite(below)
        assert np.isinf(beyond)


@pytest.mark.parametrize("name", [*MEMBERS, "linear_gpe"])
def test_stated_ranges_lie_within_the_computed_limit(name):
    circuit = MEMBERS.get(name, anatomy.linear_gpe)(2)
    for each in (circuit, anatomy.linear_gpe(slope=0.3), anatomy.linear_gpe(slope=4.0)):
        for total in np.linspace(0.25, each.range_nats[1], 20):
            assert np.isfinite(ringing(at_sum(each, total))[0])


def fluctuation(circuit, totals):
    """How STN's sum departs from the fixed point at each S, after a kick: (trials, 1 ms samples).

    Drives rise together in a ramp of 0.6 s; what is left of the ramp and the kick grows or decays.
    """
    lowest, readings, step_ms = 1.5, 60, 20
    circuit = at_sum(circuit, lowest)
    ramp = np.minimum(np.arange(readings) / 30, 1)
    drive = ((totals - lowest)[:, None] * ramp)[..., None] * np.ones(circuit.channels)
    drive[:, 31] += 0.002
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        activity = run_rate(circuit, drive, step_ms=step_ms, settle_ms=0)
    still = run_algebra(circuit, drive[:, -1:]).decoded_nats("STN").sum(axis=2)
    return activity.decoded_nats("STN").sum(axis=2)[:, 700:] - still


@pytest.mark.parametrize("circuit", OSCILLATING.values(), ids=list(OSCILLATING))
def test_the_measured_onset_is_the_computed_one(circuit):
    """Within 5 %; a tick of 0.1 ms shortens the loop by as much and stabilises it by some 2 %."""
    computed, computed_hz = limit(circuit)
    totals = computed * np.linspace(0.9, 1.1, 9)
    departs = fluctuation(circuit, totals)
    early, late = np.split(np.sqrt((departs**2).reshape(9, 2, -1).mean(axis=2)), 2, axis=1)
    grows = np.log(late / early)[:, 0] / (departs.shape[1] / 2 / 1000)
    # Sustained oscillations above the limit grow no further, so keep to the small ones.
    small = late[:, 0] < 0.3 * totals
    measured = float(np.interp(0, grows[small], totals[small]))
    assert grows[small].min() < 0 < grows[small].max()
    assert measured == pytest.approx(computed, rel=0.05)
    spectrum = np.abs(np.fft.rfft(departs[4] * np.hanning(departs.shape[1])))
    hertz = np.fft.rfftfreq(departs.shape[1], 1e-3)[spectrum.argmax()]
    assert hertz == pytest.approx(computed_hz, rel=0.05, abs=2)


def test_without_a_loop_or_with_a_common_mode_nothing_oscillates():
    no_loop = anatomy.bogacz_gurney().lesion("GPe")
    for total in (0.25, 3.0, 10.0):
        assert ringing(at_sum(no_loop, total))[0] == pytest.approx(1, abs=1e-6)
    # A common mode that holds STN's sum keeps the spiking circuit stable, also under evidence.
    spiking = anatomy.spiking_msprt()
    for total in np.linspace(0.25, spiking.range_nats[1], 20):
        assert np.isfinite(ringing(at_sum(spiking, total))[0])
    for difference in (0.0, 2.0, 6.0):
        assert np.isfinite(ringing(spiking, [-difference / 2, difference / 2])[0])
    # Without it the loop oscillates, in the beta band.
    total, hertz = limit(spiking.lesion("common"))
    assert 4.5 < total < 6
    assert 13 < hertz < 30


def test_amplification_grows_as_the_inverse_of_the_distance_to_the_onset():
    """One root nears the imaginary axis in proportion to the distance, however narrow its peak."""
    circuit = anatomy.spiking_msprt(2)
    total, onset_hz = onset(partial(at_sum, circuit), 20.0, 40.0)
    distance = np.array([1e-2, 1e-3, 1e-4])
    near = [ringing(at_sum(circuit, each)) for each in total * (1 - distance)]
    amplified, hertz = np.array(near).T
    assert amplified * distance == pytest.approx(amplified[-1] * distance[-1], rel=2e-3)
    assert hertz[-1] == pytest.approx(onset_hz, rel=1e-4)
    assert np.isinf(ringing(at_sum(circuit, total * (1 + 1e-4)))[0])


def test_what_grows_without_an_oscillation_is_unstable_too():
    """One real root, as near 0 as the lowest frequency at which turns are counted can show."""
    for growth_hz, unstable in ((0.136, True), (-0.136, False)):
        assert np.isinf(ringing(creeping(growth_hz))[0]) == unstable


@pytest.mark.parametrize("total", [1.5, 2.5, 3.5])
def test_one_loop_amplifies_as_its_closed_form(total):
    """L = -(S - 1) exp(-s D) / ((1 + s a)(1 + s b)), at the given frequency."""
    amplified, hertz = ringing(at_sum(loop(6, 14, (5, 5)), total))
    s = 2j * np.pi * hertz * 1e-3
    around = -(total - 1) * np.exp(-10 * s) / ((1 + 6 * s) * (1 + 14 * s))
    assert amplified == pytest.approx(1 / abs(1 - around), rel=1e-9)


def test_a_baseline_that_all_targets_subtract_changes_no_amplification():
    """Activity counts from the baseline on: with another baseline the circuit is the same."""
    table = anatomy.bogacz_gurney()
    other = table.with_population("STN", baseline_hz=13.0).with_population("GPe", baseline_hz=9.0)
    drive = (0.7, -0.4)
    assert ringing(other, drive) == pytest.approx(ringing(table, drive))
