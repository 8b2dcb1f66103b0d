"""The population engine without noise, by the table's lines: scheme, steady state and order."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.activity import total_nats
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock, Scheme
from circuits.errors import RangeWarning
from tests.circuits.helpers import MEMBERS, run_algebra, run_rate
from tests.helpers import unwarned

SINGLE = 5e-5
"""What single precision leaves, nats, or as a fraction of a rate."""


def evidence(trials, steps, channels, seed=0):
    drive = np.random.default_rng(seed).normal(0, 0.6, (trials, steps, channels)).cumsum(axis=1)
    return drive - drive.mean(axis=2, keepdims=True)


def low_pass(tau_ms, dt_ms):
    """Return the step (state, value now, value before) -> state, exact for straight lines."""
    tau_ms = np.asarray(tau_ms, dtype=np.float64)
    some = tau_ms > 0
    ratio = dt_ms / np.where(some, tau_ms, 1.0)
    decay = np.where(some, np.exp(-ratio), 0.0)
    mean = np.where(some, (1 - decay) / ratio, 0.0)  # of the decay over a tick
    return lambda state, now, before: decay * state + (1 - mean) * now + (mean - decay) * before


def by_the_scheme(circuit, drive, clock):
    """Return OUT and mean rates of a trial by the scheme of ticks, straight lines between them.

    A reading is no straight line: it jumps where it comes.
    """
    wiring = wired(circuit)
    scheme = Scheme(wiring, clock.dt_ms)
    units, x, start = scheme.start
    arrived_before, input_before = units, x
    readout = wiring.blocks_of(circuit.readout)
    paths = [wiring.projections[q] for q in range(wiring.units)]
    of_units = low_pass([p.tau_ms for p in paths], clock.dt_ms)
    of_blocks = low_pass(wiring.tau_ms, clock.dt_ms)
    of_readout = low_pass(circuit.readout_tau_ms, clock.dt_ms)
    out, rates, held = start[readout], [], np.zeros(wiring.blocks)
    decoded, means = [], []
    for k in range(clock.ticks):
        seen = [rates[k - d] if k >= d else start for d in scheme.unit_delay]
        arrived = np.array([wiring.deliver[u] @ hz for u, hz in enumerate(seen)])
        units = of_units(units, arrived, arrived_before)
        arrived_before = arrived
        step = clock.step_of(k)
        reading = wiring.drive(drive[step]) if step >= 0 else held
        inputs = wiring.inputs(units + wiring.constant) + reading
        x = of_blocks(x, inputs, input_before + reading - held)
        input_before, held = inputs, reading
        rates.append(wiring.rates(x))
        before = rates[k - 1] if k else start
        out = of_readout(out, rates[k][readout], before[readout])
        late = k + 1 - clock.settle_ticks
        if late > 0 and late % clock.sample_ticks == 0:
            decoded.append(wiring.activity(out, circuit.readout))
            means.append(np.mean(rates[-clock.sample_ticks :], axis=0))
    return np.array(decoded), np.array(means)


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
@pytest.mark.parametrize("fastest_ms", [0.0, 0.5, 2.0])
def test_every_tick_follows_the_scheme(name, fastest_ms):
    """However many ticks are computed together: that depends on the shortest delay."""
    circuit = anatomy.load_circuit(name, 3).with_projection("STN->SNr", delay_ms=fastest_ms)
    circuit = replace(circuit.clamp("GPe", 0.3), readout_tau_ms=10)
    drive = evidence(2, 3, 3)
    clock = Clock(3, 6.0, dt_ms=0.25, sample_ms=1.5, settle_ms=4.0)
    times = {"dt_ms": 0.25, "sample_ms": 1.5, "settle_ms": 4.0}
    activity = run_rate(circuit, drive, step_ms=6.0, **times)
    out, means = by_the_scheme(circuit, drive[1], clock)
    assert np.abs(activity.output_nats[1] - out).max() < SINGLE
    for row in circuit.populations:
        blocks = wired(circuit).blocks_of(row.name)
        near = SINGLE * np.abs(means[:, blocks]).max() + SINGLE
        assert np.abs(activity.rates_hz[row.name][1] - means[:, blocks]).max() < near
    assert activity.time_ms.tolist() == clock.time_ms.tolist()


@pytest.mark.parametrize("channels", [2, 10])
@pytest.mark.parametrize("name", MEMBERS)
def test_steady_state_is_the_fixed_point(name, channels):
    circuit = MEMBERS[name](channels)
    assert circuit.exact
    drive = evidence(12, 4, channels)[:, -1:]
    low, high = circuit.range_nats
    wanted = np.linspace(low + 0.2, high, len(drive))
    drive += (wanted - total_nats(circuit, drive)[:, 0])[:, None, None]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "S runs")  # the highest S is the limit but for rounding
        late = run_rate(circuit, drive, step_ms=3000, sample_ms=100).output_nats[:, -1]
    exact = run_algebra(circuit, drive).output_nats[:, 0]
    assert np.abs(late - exact).max() < SINGLE


@pytest.mark.parametrize("ran", [run_rate, run_algebra])
def test_a_drive_beyond_the_stated_range_warns_once_with_the_number(ran):
    circuit = anatomy.bogacz_gurney()
    with pytest.warns(RangeWarning, match=r"S runs from 3.00 to 7.00 nats, bogacz_gurney works"):
        ran(circuit, np.array([[[0.0, 0.0], [4.0, 4.0]]]), step_ms=2)
    with unwarned():
        ran(circuit, np.ones((1, 1, 2)), step_ms=2)
