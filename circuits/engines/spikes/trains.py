"""Renewal cells in the compiled engine, computed spike by spike.

The cells of a block share a number of *expected* spikes, which grows with their rate, and it is
known at which number each cell will fire next. Cells wait in *buckets*, linked lists of those whose
next spikes are neighbours in expected spikes. The buckets are used in turn, like the hours of a
clock face: a tick passes a few of them, and the cells found there fire, unless they are due in a
later turn. The cost thus depends on the number of spikes, some 15 ns each, not on that of cells.
Where cells differ in their inputs, each has its own number, which grows in every tick.

The NumPy twin is ``circuits.cells.renewal`` with ``noise.train_words``.
"""

from __future__ import annotations

import numba
import numpy as np

from circuits.cells.renewal import LOW_BITS
from circuits.dynamics import noise
from circuits.engines.compiling import part
from circuits.engines.spikes import lanes

NONE = np.int32(-1)
"""End of a list of cells."""
CELLS_PER_BUCKET = 4
"""Mean number of cells in a bucket that are due when it is passed."""
TURN = 4
"""Least number of mean intervals in which all buckets are passed once."""
FARTHEST = 2.0**62
"""Largest number of buckets passed: a runaway loop, with rates without bound, would overflow it."""
_LOW = (1 << LOW_BITS) - 1
_SCALE = 2.0**-LOW_BITS


@numba.njit(inline="always")
def _wait(table, cell, fired, key):
    """Return the interval of a cell after its spikes so far, before its factor ``slow``."""
    word = lanes.word32(cell + fired * noise.GOLDEN_32, key)
    index = np.uint64(word >> np.uint32(LOW_BITS))
    share = np.float64(np.int32(word & np.uint32(_LOW))) * _SCALE
    low = np.float64(table[index])
    return low + (np.float64(table[index + np.uint64(1)]) - low) * share


@numba.njit(inline="always")
def _passed(block, expected):
    """Return how many buckets have been passed after a number of expected spikes."""
    return np.int64(min(expected * block.buckets_per_spike, FARTHEST))


@numba.njit(inline="always")
def _queue(work, block, i):
    """Put a cell into the bucket of its next spike."""
    cell = work.trains[np.uint64(block.start + i)]
    bucket = block.bucket + (_passed(block, cell.due) & (block.buckets - 1))
    cell.link = work.buckets[np.uint64(bucket)]
    work.buckets[np.uint64(bucket)] = i


@part
def begin(p, work, block, b, stream):
    """Draw the first spike of each cell of a block."""
    key = lanes.tick_key(stream, noise.TRAIN_TICK)
    work.expected[b] = 0.0
    work.buckets[block.bucket : block.bucket + block.buckets] = NONE
    for i in range(block.cells):
        cell = work.trains[np.uint64(block.start + i)]
        cell.slow = p.slow[block.start + i]
        cell.fired = 0
        if len(work.own_expected):
            work.own_expected[np.uint64(block.start + i)] = 0.0
        cell.due = np.float64(cell.slow) * _wait(p.first_spikes[block.table], i, 0, key)
        _queue(work, block, np.int32(i))


@numba.njit(inline="always")
def _spike(work, block, i, t, table, key, listing):
    """Let a cell fire in a tick, and draw its next interval."""
    cell = work.trains[np.uint64(block.start + i)]
    cell.fired += 1
    cell.due += np.float64(cell.slow) * _wait(table, np.int64(i), np.int64(cell.fired), key)
    work.fired[np.uint64(t)] += 1
    if listing:
        work.marks[np.uint64(i)] |= np.uint8(1) << np.uint8(t)


@part
def fire(p, work, block, b, first, own_inputs, stream):
    """Advance a block by some ticks, from the ``first`` of its window; count those that fire."""
    key = lanes.tick_key(stream, noise.TRAIN_TICK)
    work.fired[:] = 0
    table, listing = p.intervals[block.table], p.clock[0].listing != 0
    if listing:
        work.marks[: block.filled] = 0
    if own_inputs:
        _each(p.ticks, work, block, table, key, listing)
    else:
        _together(p.ticks, work, block, b, first, table, key, listing)


@part
def _each(ticks, work, block, table, key, listing):
    """Advance cells that have their own inputs."""
    for t in range(len(ticks)):
        for i in range(block.cells):
            cell = work.trains[np.uint64(block.start + i)]
            work.own_expected[np.uint64(block.start + i)] += np.float64(work.x[t, i])
            if work.own_expected[np.uint64(block.start + i)] >= cell.due:
                _spike(work, block, i, t, table, key, listing)


@part
def _together(ticks, work, block, b, first, table, key, listing):
    """Advance cells that share their inputs: look only into the buckets that are passed."""
    expected, after = work.expected[b], work.after
    begun = _passed(block, expected)
    for t in range(len(ticks)):
        expected += work.common[first + t]
        after[np.uint64(t)] = expected
    work.expected[b] = expected
    last = _passed(block, expected)
    late = NONE
    for q in range(max(begun, last - block.buckets + 1), last + 1):
        bucket = block.bucket + (q & (block.buckets - 1))
        i = work.buckets[np.uint64(bucket)]
        work.buckets[np.uint64(bucket)] = NONE
        while i != NONE:
            cell = work.trains[np.uint64(block.start + i)]
            following = cell.link
            t = 0
            while cell.due <= expected and t < len(ticks):
                # The tick is found by counting, because the branches of a search would be
                # mispredicted.
                before = 0
                for later in range(len(ticks)):
                    before += cell.due > after[np.uint64(later)]
                t = max(t, before)
                _spike(work, block, i, t, table, key, listing)
                t += 1
            if cell.due <= expected:  # it fired in the last tick, and fires again in the next one
                cell.link, late = late, i
            else:
                _queue(work, block, i)
            i = following
    while late != NONE:
        cell = work.trains[np.uint64(block.start + late)]
        following = cell.link
        bucket = block.bucket + (last & (block.buckets - 1))
        cell.link = work.buckets[np.uint64(bucket)]
        work.buckets[np.uint64(bucket)] = late
        late = following
