"""The clock, and the rate of a tick."""

import numpy as np
import numpy.testing as npt
import pytest

from circuits import anatomy
from circuits.dynamics import noise
from circuits.dynamics.ticks import Clock, cell_factors, spike_hz


def test_the_clock_counts_what_it_says():
    clock = Clock(4, 5.0, dt_ms=0.5, sample_ms=2.5, settle_ms=10)
    assert (clock.ticks, clock.samples) == (20 + 40, 8)
    assert clock.time_ms[[0, -1]].tolist() == [2.5, 20.0]
    assert [clock.step_of(k) for k in (0, 19, 20, 29, 30, 59)] == [-1, -1, 0, 0, 1, 3]


@pytest.mark.parametrize("neurons", [1, 12, 300, 7000])
def test_the_rate_of_a_tick_is_exact_in_whatever_order_spikes_are_added(neurons):
    each = spike_hz(neurons, 0.1)
    npt.assert_allclose(each, 1e4 / neurons, rtol=1e-12)
    one_by_one = np.cumsum(np.full(neurons, each))
    npt.assert_array_equal(one_by_one, each * np.arange(1, neurons + 1))


def test_constants_of_cells_follow_their_draws_down_to_a_tenth():
    """More ones in a cell's word, larger constants; the mean of a channel is the row's."""
    circuit = anatomy.spiking_msprt().with_neurons(400)
    key = noise.stream_key(circuit.wiring_seed, 0, "GPe/1")
    for heterogeneity in (0.2, 1.0):
        by_channel = cell_factors(circuit.with_heterogeneity(heterogeneity), "GPe", 1)
        for i, factors in enumerate(by_channel):
            draws = noise.bits32(key, noise.CELLS_TICK + i, 400)
            assert (np.diff(factors[np.argsort(draws)]) >= 0).all()
        if heterogeneity == 1:
            assert by_channel.min() == 0.1
        else:
            assert by_channel.min() > 0.1
            npt.assert_allclose(by_channel.mean(axis=1), 1, rtol=1e-12)
            npt.assert_allclose(by_channel.std(axis=1), heterogeneity, rtol=0.1)
