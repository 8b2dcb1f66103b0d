"""Where a circuit begins to oscillate: closed forms, and the rate engine."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from circuits import anatomy
from circuits.laws.stability import growth, onset, ringing
from tests.circuits.helpers import MEMBERS, creeping, run_algebra, run_rate


def loop(stn_ms, gpe_ms, delay_ms):
    """Return the exact circuit with other time constants and delays to GPe and back."""
    circuit = anatomy.bogacz_gurney().set("STN.tau_ms", stn_ms).set("GPe.tau_ms", gpe_ms)
    circuit = circuit.set("STN->GPe.delay_ms", delay_ms[0])
    return circuit.set("GPe->STN.delay_ms", delay_ms[1])


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
    limit = onset(loop(*times))
    total, hertz = closed_form(*times)
    assert limit.total_nats == pytest.approx(total, rel=1e-6)
    assert limit.frequency_hz == pytest.approx(hertz, rel=1e-6)
    assert round(limit.total_nats, 1) == printed


def test_the_limit_does_not_depend_on_the_number_of_alternatives():
    limits = [onset(anatomy.bogacz_gurney(n)).total_nats for n in (2, 5, 12)]
    assert np.ptp(limits) < 1e-5


@pytest.mark.parametrize("name", [*MEMBERS, "linear_gpe"])
def test_stated_ranges_lie_within_the_computed_limit(name):
    circuit = MEMBERS.get(name, anatomy.linear_gpe)(2)
    assert circuit.range_nats[1] < onset(circuit).total_nats
    for slope in (0.3, 4.0):
        linear = anatomy.linear_gpe(slope=slope)
        assert linear.range_nats[1] < onset(linear).total_nats


def fluctuation(circuit, totals):
    """How STN's sum departs from the fixed point at each S, after a kick: (trials, 1 ms samples).

    Drives rise together in a ramp of 0.6 s; what is left of the ramp and the kick grows or decays.
    """
    lowest, readings, step_ms = 1.5, 60, 20
    circuit = replace(circuit, reference_nats=lowest)
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
    limit = onset(circuit)
    totals = limit.total_nats * np.linspace(0.9, 1.1, 9)
    departs = fluctuation(circuit, totals)
    early, late = np.split(np.sqrt((departs**2).reshape(9, 2, -1).mean(axis=2)), 2, axis=1)
    grows = np.log(late / early)[:, 0] / (departs.shape[1] / 2 / 1000)
    # Sustained oscillations above the limit grow no further, so keep to the small ones.
    small = late[:, 0] < 0.3 * totals
    measured = float(np.interp(0, grows[small], totals[small]))
    assert grows[small].min() < 0 < grows[small].max()
    assert measured == pytest.approx(limit.total_nats, rel=0.05)
    spectrum = np.abs(np.fft.rfft(departs[4] * np.hanning(departs.shape[1])))
    hertz = np.fft.rfftfreq(departs.shape[1], 1e-3)[spectrum.argmax()]
    assert hertz == pytest.approx(limit.frequency_hz, rel=0.05, abs=2)


def test_growth_is_that_of_a_small_disturbance():
    circuit = loop(6, 14, (5, 5))
    # Cycles until it is measured again: single precision still sees what is left then.
    for total, cycles in ((2.5, 1), (3.5, 4)):
        at = replace(circuit, reference_nats=total)
        root = growth(at)
        kick = np.zeros((1, 41, 2))
        kick[:, 0] = 0.05
        activity = run_rate(at, kick, step_ms=20, dt_ms=0.1, settle_ms=0)
        departs = activity.decoded_nats("STN").sum(axis=2)[0] - total
        period = round(1000 * 2 * np.pi / abs(root.imag))
        peaks = [np.abs(departs[k : k + 2 * period]).max() for k in (200, 200 + cycles * period)]
        growth_rate = np.log(peaks[1] / peaks[0]) / (cycles * period / 1000)
        assert growth_rate == pytest.approx(root.real, rel=0.05)
        assert growth(at).real < 0
    assert growth(replace(circuit, reference_nats=4.0)).real > 0


def test_without_a_loop_or_with_a_common_mode_nothing_oscillates():
    no_loop = anatomy.bogacz_gurney().lesion("GPe")
    assert growth(no_loop).real == -np.inf
    assert ringing(no_loop)[0] == pytest.approx(1, abs=1e-6)
    assert onset(no_loop).total_nats == np.inf
    # A common mode that holds STN's sum keeps the spiking circuit stable, also under evidence.
    spiking = anatomy.spiking_msprt()
    assert onset(spiking).total_nats > spiking.range_nats[1]
    for difference in (0.0, 2.0, 6.0):
        assert growth(spiking, [-difference / 2, difference / 2]).real < 0
    # Without it the loop oscillates, in the beta band.
    limit = onset(spiking.lesion("common"))
    assert 4.5 < limit.total_nats < 6
    assert 13 < limit.frequency_hz < 30


def test_amplification_grows_as_the_inverse_of_the_distance_to_the_onset():
    """One root nears the imaginary axis in proportion to the distance, however narrow its peak."""
    circuit = anatomy.spiking_msprt(2)
    limit = onset(circuit)
    distance = np.array([1e-2, 1e-3, 1e-4])
    totals = limit.total_nats * (1 - distance)
    near = [ringing(replace(circuit, reference_nats=each)) for each in totals]
    amplified, hertz = np.array(near).T
    assert amplified * distance == pytest.approx(amplified[-1] * distance[-1], rel=2e-3)
    assert hertz[-1] == pytest.approx(limit.frequency_hz, rel=1e-4)
    beyond = replace(circuit, reference_nats=limit.total_nats * (1 + 1e-4))
    assert np.isinf(ringing(beyond)[0])


def test_what_grows_without_an_oscillation_is_unstable_too():
    """One real root, as near 0 as the lowest frequency at which turns are counted can show."""
    for growth_hz, unstable in ((0.136, True), (-0.136, False)):
        table = creeping(growth_hz)
        assert growth(table) == pytest.approx(growth_hz, rel=1e-6)
        assert np.isinf(ringing(table)[0]) == unstable


@pytest.mark.parametrize(("total", "nats"), [(43.7, 43.7), (47.0, np.inf)])
def test_an_onset_is_looked_for_up_to_the_first_step_beyond_forty_nats(total, nats):
    """Steps of 15 % from a quarter of a nat on go to 38.3 and 44.05."""
    delay_ms = brentq(lambda d: closed_form(5, 10, (d, d))[0] - total, 0.05, 2)
    assert onset(loop(5, 10, (delay_ms, delay_ms))).total_nats == pytest.approx(nats, rel=1e-6)


@pytest.mark.parametrize("total", [1.5, 2.5, 3.5])
def test_one_loop_amplifies_as_its_closed_form(total):
    """L = -(S - 1) exp(-s D) / ((1 + s a)(1 + s b)), at the given frequency."""
    amplified, hertz = ringing(replace(loop(6, 14, (5, 5)), reference_nats=total))
    s = 2j * np.pi * hertz * 1e-3
    around = -(total - 1) * np.exp(-10 * s) / ((1 + 6 * s) * (1 + 14 * s))
    assert amplified == pytest.approx(1 / abs(1 - around), rel=1e-9)


def test_a_baseline_that_all_targets_subtract_changes_no_root():
    """Activity counts from the baseline on: with another baseline the circuit is the same."""
    table = anatomy.bogacz_gurney()
    other = table.with_population("STN", baseline_hz=13.0).with_population("GPe", baseline_hz=9.0)
    drive = (0.7, -0.4)
    assert growth(other, drive) == pytest.approx(growth(table, drive), rel=1e-6)
    assert ringing(other, drive) == pytest.approx(ringing(table, drive))
