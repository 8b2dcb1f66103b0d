"""The noise of Brian2, and that of every other engine."""

import numpy as np
import numpy.testing as npt

from circuits.dynamics import noise
from circuits.engines.brian2 import noise as brian_noise


def test_noise_of_brian2_is_that_of_every_engine():
    streams = noise.stream_keys(7, np.arange(3, 6), ["GPe", "GPe/0"])
    assert streams[0, 0] == 0x8E49DEDA421CF417
    for stream in streams.ravel():
        for tick in (0, 1, 6, 12345):
            key = brian_noise.keys_at(np.array([stream]).astype(np.int64), np.array([tick // 4]))
            cells = np.arange(50)
            words = brian_noise.random_word(cells, key)
            npt.assert_array_equal(words.view(np.uint32), noise.words(int(stream), tick // 4, 50))
            ones = brian_noise.ones_at(brian_noise.noise_bytes(cells, key), np.array([tick]))
            npt.assert_array_equal(ones, noise.ones8(int(stream), tick, 50))
