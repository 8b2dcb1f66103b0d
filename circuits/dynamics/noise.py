"""Counter-based noise: a pure function of seed, trial, population, channel, neuron and tick.

For the intervals of renewal cells, the number of spikes so far takes the place of the tick.

No number depends on an earlier draw, so the noise of a cell depends neither on lesions elsewhere
nor on the batch, and all engines draw the same. The word of a neuron is lowbias32 (Wellons 2018) of
its index under a 64-bit tick key from the SplitMix64 finaliser (Steele, Lea & Flood 2014).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.checks import is_whole
from circuits.errors import InputError

GOLDEN = 0x9E3779B97F4A7C15
GOLDEN_32, FIRST, SECOND = 0x9E3779B1, 0x21F0AAAD, 0x735A2D97
TICKS_A_WORD = 4
# Words for quantities fixed before a trial starts use ticks that no trial reaches.
START_TICK = 2**62
CONNECTIONS_TICK = START_TICK + 1
CELLS_TICK = START_TICK + 2
TRAIN_TICK = START_TICK + 5  # CELLS_TICK and the two ticks after it are those of factors

Words = npt.NDArray[np.uint32]

_MASK = 2**64 - 1


def mix(z: int) -> int:
    """Return the SplitMix64 finaliser of a 64-bit integer."""
    z &= _MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return z ^ (z >> 31)


def name_key(name: str) -> int:
    """Return the FNV-1a hash of a name, 64 bits."""
    key = 0xCBF29CE484222325
    for byte in name.encode():
        key = ((key ^ byte) * 0x100000001B3) & _MASK
    return key


def stream_key(seed: int, trial: int, name: str) -> int:
    """Return the 64-bit key of one population, such as ``"GPe/0"`` with its channel, in one trial.

    Seed and trial are from 0 to 2**64 - 1.
    """
    _check(seed=seed, trial=trial)
    key = mix(int(seed) + GOLDEN)
    key = mix((key ^ int(trial)) + GOLDEN)
    return mix((key ^ name_key(name)) + GOLDEN)


def tick_key(stream: int, tick: int) -> tuple[int, int]:
    """Return the two 32-bit halves (high, low) of a stream's key at a tick."""
    z = mix(stream + (tick + 1) * GOLDEN)
    return z >> 32, z & 0xFFFFFFFF


def words(stream: int, tick: int, neurons: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Return the random 32-bit word of each neuron at a tick; an int n means neurons 0 .. n - 1.

    The stream is from ``stream_key``. Noise that uses one word for four ticks passes ``tick // 4``.
    """
    index = np.arange(neurons) if np.ndim(neurons) == 0 else np.asarray(neurons)
    high, low = (np.uint32(half) for half in tick_key(stream, tick))
    return lowbias32(index.astype(np.uint32), high, low)


def train_words(stream: int, neurons: npt.ArrayLike, counts: npt.ArrayLike) -> Words:
    """Return the word for the interval that follows each neuron's first ``counts`` spikes.

    It does not depend on the tick: a cell has the same intervals, in expected spikes, at any rate.
    """
    index = np.asarray(neurons, dtype=np.uint32)
    index = index + np.asarray(counts).astype(np.uint32) * np.uint32(GOLDEN_32)
    high, low = (np.uint32(half) for half in tick_key(stream, TRAIN_TICK))
    return lowbias32(index, high, low)


def lowbias32(index: Words, high: Words | np.uint32, low: Words | np.uint32) -> Words:
    """Return the words of neurons under the two halves of their tick keys."""
    x = index * np.uint32(GOLDEN_32) + high
    x ^= x >> np.uint32(16)
    x = x * np.uint32(FIRST) + low
    x ^= x >> np.uint32(15)
    x *= np.uint32(SECOND)
    x ^= x >> np.uint32(15)
    return x


def byte_counts(word: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Return the number of ones in each byte of 32-bit words, in the place of that byte."""
    x = np.asarray(word, dtype=np.uint32)
    x = x - ((x >> np.uint32(1)) & np.uint32(0x55555555))
    x = (x & np.uint32(0x33333333)) + ((x >> np.uint32(2)) & np.uint32(0x33333333))
    return (x + (x >> np.uint32(4))) & np.uint32(0x0F0F0F0F)


def counts_at(counts: npt.NDArray[np.uint32], tick: int) -> npt.NDArray[np.float32]:
    """Return the counts for one tick from the result of ``byte_counts``.

    ``(count - 4) / sqrt 2`` is near-Gaussian noise of zero mean and unit variance; one word serves
    four ticks, one byte per tick.
    """
    count = (counts >> np.uint32(8 * (tick % TICKS_A_WORD))) & np.uint32(15)
    return count.astype(np.float32)


def uniform(stream: int, tick: int, neurons: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a number in [0, 1) for each neuron: its word / 2**32."""
    return words(stream, tick, neurons) / 2.0**32


def bits32(stream: int, tick: int, neurons: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return near-Gaussian noise of zero mean and unit variance, ``(ones of 32 bits - 16)/sqrt 8``.

    Bounded by 5.7 in magnitude; used for heterogeneity across cells.
    """
    counts = byte_counts(words(stream, tick, neurons))
    ones = sum((counts >> np.uint32(shift)) & np.uint32(15) for shift in (0, 8, 16, 24))
    return np.asarray((np.asarray(ones, dtype=np.float64) - 16) / np.sqrt(8))


def stream_keys(seed: int, trials: npt.ArrayLike, names: list[str]) -> npt.NDArray[np.uint64]:
    """Return ``stream_key`` of many trials and names at once, (trials, names)."""
    _check(seed=seed, trial=np.min(trials, initial=0))
    index = np.asarray(trials, dtype=np.uint64)
    golden = np.uint64(GOLDEN)
    first = mix_all((np.uint64(mix(int(seed) + GOLDEN)) ^ index) + golden)
    keys = np.array([name_key(name) for name in names], dtype=np.uint64)
    return mix_all((first[:, None] ^ keys[None, :]) + golden)


def _check(**values: float) -> None:
    for name, value in values.items():
        if not is_whole(value) or not 0 <= value <= _MASK:
            raise InputError.of(name, "must be a whole number 0 .. 2**64 - 1", value)


def mix_all(z: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Return ``mix`` of an array."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
