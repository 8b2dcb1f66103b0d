"""The rate engine: its scheme, its steady state and its order."""

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from circuits import anatomy
from circuits.activity import total_nats
from circuits.engines import algebra, rate
from circuits.fixed_point import wired
from circuits.ticks import Clock, Scheme
from tests.circuits.helpers import MEMBERS


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


def test_a_circuit_at_rest_stays_there():
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
