"""The rate engine: its scheme, its steady state, its order, and where it begins to oscillate."""

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from circuits import anatomy
from circuits.activity import total_nats
from circuits.engines import algebra, rate
from circuits.fixed_point import wired
from circuits.laws import stability
from circuits.ticks import Clock, Scheme

MEMBERS = {
    "bogacz_gurney": anatomy.bogacz_gurney,
    "appendix_b": anatomy.appendix_b,
    "appendix_b, strong D2": lambda n: anatomy.appendix_b(n, w_gpe_stn=0.9, w_d2_gpe=2),
    "appendix_b, weak GPe": lambda n: anatomy.appendix_b(n, w_gpe_stn=0.1, w_d2_gpe=1),
}


def evidence(trials, steps, channels, seed=0):
    drive = np.random.default_rng(seed).normal(0, 0.6, (trials, steps, channels)).cumsum(axis=1)
    return drive - drive.mean(axis=2, keepdims=True)


def by_the_scheme(circuit, drive, clock):
    """Follow circuits.ticks word for word: OUT and mean rates of one trial."""
    wiring = wired(circuit)
    scheme = Scheme(wiring, clock.dt_ms)
    units, x, start = scheme.start
    out = start[wiring.blocks_of(circuit.readout)]
    rates = []
    decoded, means = [], []
    for k in range(clock.ticks):
        seen = [rates[k - d] if k >= d else start for d in scheme.unit_delay]
        arrived = np.array([wiring.deliver[u] @ hz for u, hz in enumerate(seen)])
        units = scheme.unit_decay * units + (1 - scheme.unit_decay) * arrived
        step = clock.step_of(k)
        inputs = wiring.inputs(units + wiring.constant)
        if step >= 0:
            inputs = inputs + wiring.drive(drive[step])
        x = scheme.rate_decay * x + (1 - scheme.rate_decay) * inputs
        rates.append(wiring.rates(x))
        seen = rates[k][wiring.blocks_of(circuit.readout)]
        out = scheme.readout_decay * out + (1 - scheme.readout_decay) * seen
        late = k + 1 - clock.settle_ticks
        if late > 0 and late % clock.sample_ticks == 0:
            decoded.append(wiring.activity(out, circuit.readout))
            means.append(np.mean(rates[-clock.sample_ticks :], axis=0))
    return np.array(decoded), np.array(means)


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
@pytest.mark.parametrize("fastest_ms", [0.0, 0.5, 2.0])
def test_every_tick_follows_the_scheme(name, fastest_ms):
    """However many ticks are computed together: that depends on the shortest delay."""
    circuit = anatomy.circuit(name, 3).with_projection("STN", "SNr", delay_ms=fastest_ms)
    circuit = replace(circuit.without("GPe", 0.3, replaced=True), readout_tau_ms=10)
    drive = evidence(2, 3, 3)
    clock = Clock(3, 6.0, dt_ms=0.25, sample_ms=1.5, settle_ms=4.0)
    times = {"dt_ms": 0.25, "sample_ms": 1.5, "settle_ms": 4.0}
    found = rate.run(circuit, drive, step_ms=6.0, **times)
    out, means = by_the_scheme(circuit, drive[1], clock)
    assert np.abs(found.output_nats[1] - out).max() < 1e-9
    for row in circuit.populations:
        blocks = wired(circuit).blocks_of(row.name)
        assert np.abs(found.rates_hz[row.name][1] - means[:, blocks]).max() < 1e-8
    assert found.time_ms.tolist() == clock.time_ms.tolist()


@pytest.mark.parametrize("channels", [2, 10])
@pytest.mark.parametrize("name", MEMBERS)
def test_steady_state_is_the_fixed_point(name, channels):
    """Over the range that each exact table states: S from near 0 to 5 nats."""
    circuit = MEMBERS[name](channels)
    assert circuit.exact
    drive = evidence(12, 4, channels)[:, -1:]
    low, high = circuit.range_nats
    wanted = np.linspace(low + 0.2, high, len(drive))
    drive += (wanted - total_nats(circuit, drive)[:, 0])[:, None, None]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "S runs")  # the highest S is the limit but for rounding
        late = rate.run(circuit, drive, step_ms=3000, sample_ms=100).output_nats[:, -1]
    exact = algebra.run(circuit, drive).output_nats[:, 0]
    assert np.abs(late - exact).max() < 1e-6


def test_rest_is_kept():
    for name in anatomy.CIRCUITS:
        circuit = anatomy.circuit(name, 4)
        activity = rate.run(circuit, np.zeros((1, 1, 4)), step_ms=50, settle_ms=0)
        rest = algebra.run(circuit, np.zeros((1, 1, 4))).output_nats
        assert np.abs(activity.output_nats - rest).max() < 1e-9


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
def test_rates_are_never_negative_but_where_they_stand_for_a_difference(name):
    circuit = anatomy.circuit(name, 3)
    drive = evidence(20, 5, 3) * 3
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        activity = rate.run(circuit, drive, step_ms=40)
    for row in circuit.populations:
        rates = activity.rates_hz[row.name]
        assert np.isfinite(rates).all()
        if not getattr(row.cell, "signed", False):
            assert rates.min() >= 0, row.name
    assert activity.rates_hz["SNr"].min() == 0  # so the floor was met


@pytest.mark.parametrize("name", ["appendix_b", "spiking_msprt"])
def test_half_the_tick_halves_the_error(name):
    circuit = anatomy.circuit(name, 2)
    drive = evidence(4, 5, 2)
    dts = (0.5, 0.25, 0.125, 0.0625)
    out = [rate.run(circuit, drive, step_ms=40, dt_ms=dt).output_nats for dt in dts]
    errors = [np.abs(a - b).max() for a, b in pairwise(out)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(2, rel=0.15)


def test_delays_are_kept_to_the_tick():
    """The first sample that moves is that of the shortest way to the read-out."""
    drive = np.full((1, 1, 2), 0.5)

    def moves_ms(circuit):
        activity = rate.run(circuit, drive, step_ms=30, sample_ms=0.1)
        return activity.time_ms[np.abs(activity.output_nats[0, :, 0] - np.log(2)) > 1e-9][0]

    circuit = anatomy.bogacz_gurney().with_projection("ctx", "D1", delay_ms=7)
    # ctx-STN 3 ms, STN-SNr 2 ms; a sample's time is the end of its tick.
    assert moves_ms(circuit) == pytest.approx(5.1)
    assert moves_ms(circuit.with_projection("ctx", "STN", delay_ms=6)) == pytest.approx(8.1)
    # Through D1, 7 + 2 ms, once that is the shortest.
    assert moves_ms(circuit.with_projection("ctx", "STN", delay_ms=20)) == pytest.approx(9.1)


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
@pytest.mark.parametrize("channels", [2, 9])
def test_a_trial_alone_has_the_bytes_that_it_has_in_a_batch(name, channels):
    circuit = anatomy.circuit(name, channels)
    drive = evidence(7, 3, channels) / 2
    times = {"step_ms": 20, "settle_ms": 20}
    every = rate.run(circuit, drive, **times)
    for trials in (slice(3, 4), slice(0, 2), slice(2, 7)):
        some = rate.run(circuit, drive[trials], **times)
        assert some.output_nats.tobytes() == every.output_nats[trials].tobytes()
        for name_, rates in some.rates_hz.items():
            assert rates.tobytes() == every.rates_hz[name_][trials].tobytes()


def test_a_drive_beyond_the_stated_range_warns_once_with_the_number():
    circuit = anatomy.bogacz_gurney()
    with pytest.warns(UserWarning, match=r"S runs from 3\.00 to 7\.00 nats, bogacz_gurney works"):
        rate.run(circuit, np.array([[[0.0, 0.0], [4.0, 4.0]]]), step_ms=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rate.run(circuit, np.ones((1, 1, 2)), step_ms=2)


# ---- stability


def loop(stn_ms, gpe_ms, delay_ms):
    """Return the exact circuit with other time constants and delays to GPe and back."""
    circuit = (
        anatomy.bogacz_gurney()
        .with_population("STN", tau_ms=stn_ms)
        .with_population("GPe", tau_ms=gpe_ms)
    )
    circuit = circuit.with_projection("STN", "GPe", delay_ms=delay_ms[0])
    return circuit.with_projection("GPe", "STN", delay_ms=delay_ms[1])


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
def test_computed_limit_is_the_closed_form(times, printed):
    limit = stability.onset(loop(*times))
    total, hertz = closed_form(*times)
    assert limit.total_nats == pytest.approx(total, rel=1e-6)
    assert limit.frequency_hz == pytest.approx(hertz, rel=1e-6)
    assert round(limit.total_nats, 1) == printed
    assert stability.stability_limit_nats(loop(*times)) == limit.total_nats


def test_the_limit_does_not_depend_on_the_number_of_alternatives():
    limits = [stability.stability_limit_nats(anatomy.bogacz_gurney(n)) for n in (2, 5, 12)]
    assert np.ptp(limits) < 1e-5


@pytest.mark.parametrize("name", [*MEMBERS, "linear_gpe"])
def test_stated_ranges_lie_within_the_computed_limit(name):
    circuit = MEMBERS.get(name, anatomy.linear_gpe)(2)
    assert circuit.range_nats[1] < stability.stability_limit_nats(circuit)
    for slope in (0.3, 4.0):
        linear = anatomy.linear_gpe(slope=slope)
        assert linear.range_nats[1] < stability.stability_limit_nats(linear)


def fluctuation(circuit, totals):
    """How STN's sum departs from the fixed point at each S, after a kick: (trials, 1 ms samples).

    Drives rise together in a ramp of .6 s; what is left of the ramp and the kick grows or decays.
    """
    lowest, readings, step_ms = 1.5, 60, 20
    circuit = replace(circuit, reference_nats=lowest)
    ramp = np.minimum(np.arange(readings) / 30, 1)
    drive = ((totals - lowest)[:, None] * ramp)[..., None] * np.ones(circuit.channels)
    drive[:, 31] += 0.002
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        activity = rate.run(circuit, drive, step_ms=step_ms, settle_ms=0)
    still = algebra.run(circuit, drive[:, -1:]).decoded_nats("STN").sum(axis=2)
    return activity.decoded_nats("STN").sum(axis=2)[:, 700:] - still


@pytest.mark.parametrize("circuit", OSCILLATING.values(), ids=list(OSCILLATING))
def test_measured_onset_is_the_computed_one(circuit):
    """Within 5 %; a tick of .1 ms shortens the loop by as much and stabilises it by some 2 %."""
    limit = stability.onset(circuit)
    totals = limit.total_nats * np.linspace(0.9, 1.1, 9)
    departs = fluctuation(circuit, totals)
    early, late = np.split(np.sqrt((departs**2).reshape(9, 2, -1).mean(axis=2)), 2, axis=1)
    grows = np.log(late / early)[:, 0] / (departs.shape[1] / 2 / 1000)
    # Sustained oscillations above the limit grow no further, so keep to the small ones.
    small = late[:, 0] < 0.3 * totals
    measured = float(np.interp(0, grows[small], totals[small]))
    print(f"{circuit.name}: onset {measured:.3f}, computed {limit.total_nats:.3f}")
    assert grows[small].min() < 0 < grows[small].max()
    assert measured == pytest.approx(limit.total_nats, rel=0.05)
    spectrum = np.abs(np.fft.rfft(departs[4] * np.hanning(departs.shape[1])))
    hertz = np.fft.rfftfreq(departs.shape[1], 1e-3)[spectrum.argmax()]
    assert hertz == pytest.approx(limit.frequency_hz, rel=0.05, abs=2)


def test_growth_is_that_of_a_small_disturbance():
    circuit = loop(6, 14, (5, 5))
    for total in (2.5, 3.5):
        at = replace(circuit, reference_nats=total)
        root = stability.growth(at)
        kick = np.zeros((1, 41, 2))
        kick[:, 0] = 1e-3
        activity = rate.run(at, kick, step_ms=20, dt_ms=0.02, settle_ms=0)
        departs = activity.decoded_nats("STN").sum(axis=2)[0] - total
        period = round(1000 * 2 * np.pi / abs(root.imag))
        peaks = [np.abs(departs[k : k + 2 * period]).max() for k in (200, 200 + 4 * period)]
        found = np.log(peaks[1] / peaks[0]) / (4 * period / 1000)
        assert found == pytest.approx(root.real, rel=0.05)
        assert stability.is_stable(at)
    assert not stability.is_stable(replace(circuit, reference_nats=4.0))


def test_stability_where_there_is_no_loop_or_no_limit():
    no_loop = anatomy.bogacz_gurney().without("GPe")
    assert stability.growth(no_loop).real == -np.inf
    assert stability.onset(no_loop).total_nats == np.inf
    # A common mode that holds STN's sum keeps the spiking circuit stable, also under evidence.
    spiking = anatomy.spiking_msprt()
    assert stability.stability_limit_nats(spiking) > spiking.range_nats[1]
    for difference in (0.0, 2.0, 6.0):
        assert stability.is_stable(spiking, [-difference / 2, difference / 2])
    # Without it the loop oscillates, in the beta band.
    limit = stability.onset(spiking.without("common"))
    assert 4.5 < limit.total_nats < 6
    assert 13 < limit.frequency_hz < 30


def test_bad_input_to_stability():
    circuit = anatomy.bogacz_gurney()
    with pytest.raises(ValueError, match=r"drive must be \(2,\), got shape \(3,\)"):
        stability.growth(circuit, np.zeros(3))
    unstable = circuit.with_projection("STN", "GPe", transfer="linear", weight=400, delay_ms=50)
    with pytest.raises(ValueError, match=r"unstable already at S = 0\.25 nats"):
        stability.onset(unstable)
