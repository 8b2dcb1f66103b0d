"""The loops over cells, against plain NumPy."""

import numpy as np
import numpy.testing as npt

from circuits import noise
from circuits.engines.ensemble import lanes


def filled(cells, value=0.0):
    return np.full(cells, value, np.float32)


def whole_key(stream, tick):
    high, low = noise.tick_key(stream, tick)
    return np.uint64(high << 32 | low)


def four(*values):
    return tuple(np.float32(value) for value in values)


def test_words_of_the_loops_are_those_of_noise():
    stream = noise.stream_key(7, 3, "GPe")
    counts = np.zeros(128, np.uint32)
    lanes.refresh(counts, 0, 128, whole_key(stream, 5))
    npt.assert_array_equal(counts, noise.byte_counts(noise.words(stream, 5, 128)))
    v = filled(128)
    lanes.begin(v, 0, 100, 128, whole_key(stream, 5), np.float32(0), np.float32(1))
    npt.assert_allclose(v[:100], noise.uniform(stream, 5, 100), atol=1e-7)
    assert (v[100:] == -np.inf).all()


def test_exp32_is_the_exponential():
    @lanes.numba.njit
    def table(x):
        return np.array([lanes.exp32(value) for value in x])

    x = np.linspace(-20, 20, 4001).astype(np.float32)
    npt.assert_allclose(table(x), np.exp(x.astype(float)), rtol=4e-7)


def test_the_loop_of_lif_cells_does_what_numpy_does():
    rng = np.random.default_rng(1)
    v = rng.uniform(-5, 11, 128).astype(np.float32)
    v[3], v[4], v[5] = -lanes.WAIT, -2 * lanes.WAIT, -np.inf
    counts = rng.integers(0, 9, (128, 4)).astype(np.uint8).view(np.uint32).ravel()
    mean_step, noise_step = (0.2, 0.1, 0.4, 0.3), np.float32(0.3)
    expected, marks, spikes = v.copy(), np.zeros(128, np.uint8), np.zeros((4, 128), bool)
    for t in range(4):
        waiting = expected < lanes.WAITING
        moved = 0.99 * expected + mean_step[t] + 0.3 * (counts >> 8 * t & 15)
        expected = np.where(waiting, expected + lanes.WAIT, moved)
        spikes[t] = expected >= 11
        expected[spikes[t]] = -20 * lanes.WAIT
    constants = (
        np.float32(0.99),
        four(*mean_step),
        noise_step,
        np.float32(11),
        np.float32(-20 * lanes.WAIT),
    )
    again = v.copy()
    fired = lanes.lif_identical(v, counts, 0, 128, lanes.FOUR, *constants, None)
    lanes.lif_identical(again, counts, 0, 128, lanes.FOUR, *constants, marks)
    assert fired == tuple(spikes.sum(axis=1))
    assert min(fired) > 0
    npt.assert_array_equal(marks, spikes.T @ [1, 2, 4, 8])
    npt.assert_array_equal(again, v)
    npt.assert_allclose(v, expected, rtol=1e-5, atol=1e-5)
    assert v[3] < 11


def test_the_loop_of_phase_cells_does_what_numpy_does():
    rng = np.random.default_rng(2)
    v = rng.uniform(0, 1.05, 128).astype(np.float32)
    counts = rng.integers(0, 9, 128).astype(np.uint32)
    expected = v - (v >= 1) + 0.01 + 0.02 * counts
    mean_step, noise_step = four(0.01, 0, 0, 0), four(0.02, 0, 0, 0)
    for marks in (None, np.zeros(128, np.uint8)):
        x = v.copy()
        fired = lanes.phase_identical(x, counts, 0, 128, lanes.SINGLE, mean_step, noise_step, marks)
        npt.assert_allclose(x, expected, rtol=1e-5)
        assert (fired[0] if marks is None else marks.sum()) == (expected >= 1).sum() > 0
