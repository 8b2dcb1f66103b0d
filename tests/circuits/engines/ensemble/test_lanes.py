"""The loops over cells, against plain NumPy."""

import numba
import numpy as np
import numpy.testing as npt
import pytest

from circuits.dynamics import noise
from circuits.engines.ensemble import lanes
from tests.circuits.helpers import call


def filled(cells, value=0.0):
    return np.full(cells, value, np.float32)


def whole_key(stream, tick):
    high, low = noise.tick_key(stream, tick)
    return np.uint64(high << 32 | low)


def four(*values):
    return tuple(np.float32(value) for value in values)


def bits(fired):
    return np.unpackbits(fired.view(np.uint8), bitorder="little").reshape(len(fired), -1)


def test_words_of_the_loops_are_those_of_noise():
    stream = noise.stream_key(7, 3, "GPe")
    key, expected = whole_key(stream, 5), noise.byte_counts(noise.words(stream, 5, 128))
    counts = np.zeros(128, np.uint32)
    for byte in range(4):
        call(lanes.refresh, counts, 0, 128, (key, byte))
        npt.assert_array_equal(counts, expected >> np.uint32(8 * byte))
    v = filled(128)
    call(lanes.begin, v, 0, 100, 128, key, np.float32(0), np.float32(1))
    npt.assert_allclose(v[:100], noise.uniform(stream, 5, 100), atol=1e-7)
    assert (v[100:] == -np.inf).all()


def test_exp32_is_the_exponential():
    @numba.njit
    def table(x):
        return np.array([lanes.exp32(value) for value in x])

    x = np.linspace(-20, 20, 4001).astype(np.float32)
    npt.assert_allclose(table(x), np.exp(x.astype(float)), rtol=4e-7)


def test_the_loop_of_lif_cells_does_what_numpy_does():
    rng = np.random.default_rng(1)
    v = rng.uniform(-5, 11, 128).astype(np.float32)
    v[3], v[4], v[5] = -lanes.WAIT, -2 * lanes.WAIT, -np.inf
    stream = noise.stream_key(1, 2, "STN")
    counts = noise.byte_counts(noise.words(stream, 9, 128))
    mean_step, noise_step = (0.2, 0.1, 0.4, 0.3), np.float32(0.3)
    expected, spikes = v.copy(), np.zeros((4, 128), bool)
    for t in range(4):
        waiting = expected < lanes.WAITING
        moved = 0.99 * expected + mean_step[t] + 0.3 * (counts >> 8 * t & 15)
        expected = np.where(waiting, expected + lanes.WAIT, moved)
        spikes[t] = expected >= 11
        expected[spikes[t]] = -20 * lanes.WAIT
    constants = (noise_step, np.float32(11), np.float32(-20 * lanes.WAIT))
    fired, decay, noise_of = np.zeros((4, 2), np.uint64), np.float32(0.99), whole_key(stream, 9)
    again, one_by_one, steps = v.copy(), np.zeros((4, 2), np.uint64), four(*mean_step)
    call(lanes.lif_identical, v, fired, 0, 128, (noise_of, 0), lanes.FOUR, decay, steps, *constants)
    for t in range(4):
        step, noise_at = four(mean_step[t], 0, 0, 0), (noise_of, t)
        tick = (one_by_one[t:], 0, 128, noise_at, lanes.SINGLE, decay, step, *constants)
        call(lanes.lif_identical, again, *tick)
    npt.assert_array_equal(bits(fired), spikes)
    npt.assert_array_equal(one_by_one, fired)
    npt.assert_array_equal(again, v)
    npt.assert_allclose(v, expected, rtol=1e-5, atol=1e-5)
    assert v[3] < 11
    assert spikes.any(axis=1).all()


def test_cells_that_fired_are_counted_and_listed():
    fired = np.array([0b1001, 1 << 63], np.uint64)
    places = np.zeros(128, np.int32)
    assert call(lanes.how_many, fired, 128) == call(lanes.listed, fired, 128, places) == 3
    npt.assert_array_equal(places[:3], [0, 3, 127])
    assert call(lanes.how_many, fired, 64) == 2


def test_marks_of_cells_are_gathered():
    marks = np.random.default_rng(3).integers(0, 16, 128).astype(np.uint8)
    fired = np.zeros((4, 2), np.uint64)
    call(lanes.noted, marks, fired, 128, 4)
    npt.assert_array_equal(bits(fired), marks >> np.arange(4)[:, None] & 1)


def test_the_loop_of_phase_cells_does_what_numpy_does():
    rng = np.random.default_rng(2)
    v = rng.uniform(0, 1.05, 128).astype(np.float32)
    stream = noise.stream_key(1, 2, "D1")
    counts = noise.byte_counts(noise.words(stream, 4, 128))
    expected, spikes = v.copy(), np.zeros((4, 128), bool)
    mean_step, noise_step = (0.01, 0.02, 0.03, 0), (0.02, 0.01, 0.005, 0.002)
    for t in range(4):
        ones = counts >> 8 * t & 15
        expected = expected - (expected >= 1) + mean_step[t] + noise_step[t] * ones
        spikes[t] = expected >= 1
    fired, steps = np.zeros((4, 2), np.uint64), (four(*mean_step), four(*noise_step))
    call(lanes.phase_identical, v, fired, 0, 128, (whole_key(stream, 4), 0), lanes.FOUR, *steps)
    npt.assert_allclose(v, expected, rtol=1e-5, atol=1e-6)
    npt.assert_array_equal(bits(fired), spikes)
    assert spikes.any(axis=1).all()


@pytest.mark.parametrize("held", [1, 3, 20, 300])
def test_a_cell_waits_its_number_of_ticks_and_ends_exactly_at_its_reset(held):
    """A wait is a multiple of a power of two: float32 counts it down without rounding."""
    v, ticks = np.float32(-held) * lanes.WAIT, 0
    while v < lanes.WAITING:
        v, ticks = np.float32(v + lanes.WAIT), ticks + 1
    assert (ticks, v) == (held, 0)
    # No potential in mV, however negative, looks like a wait.
    assert lanes.WAITING < -1e5
