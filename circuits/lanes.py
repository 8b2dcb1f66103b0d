"""What makes the ensemble engine fast, in one place: loops over cells that the compiler vectorises.

One trial at a time; neighbouring cells lie in neighbouring lanes of a register. Four things are
needed for that, and each is used below:

* 32-bit integer arithmetic. Numba widens to 64 bits, for which older machines have no vector
  multiplication; the few functions at the top emit 32-bit instructions. Their NumPy twins are
  ``noise.words`` and ``noise.byte_counts``.
* An unsigned index, so that no negative one has to be wrapped.
* Choosing between two values instead of branching, and storing what was chosen every time: a
  store under a mask costs ten times as much on some machines.
* No second array for refractory cells. A cell that waits holds ``-WAIT * (ticks left)`` instead of
  a potential (measured from its reset), adds WAIT at each tick and is back at exactly 0 in time.
  Cells that only fill a register up wait for ever, at minus infinity.

The state of a cell is float32, sums over cells are int32. The tests hold each loop to plain NumPy.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from circuits import noise
from circuits.compiling import compiled

LANES = 64
"""Populations are filled up to a multiple of this many cells."""
WAIT = np.float32(2.0**20)
WAITING = np.float32(-(2.0**19))
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
HALF_BITS = np.float32(4.0)

_I32 = ir.IntType(32)
_F32 = ir.FloatType()


def _const(value: int) -> ir.Constant:
    return ir.Constant(_I32, value)


def _narrow(builder, value):
    return builder.trunc(value, _I32) if value.type.width > 32 else value


@intrinsic
def word32(typing, index, high, low):
    """Return ``noise.words`` of one cell from the halves of the tick key."""

    def build(context, builder, signature, arguments):
        x, high, low = (_narrow(builder, value) for value in arguments)
        x = builder.add(builder.mul(x, _const(noise.SPREAD)), high)
        x = builder.xor(x, builder.lshr(x, _const(16)))
        x = builder.add(builder.mul(x, _const(noise.FIRST)), low)
        x = builder.xor(x, builder.lshr(x, _const(15)))
        x = builder.mul(x, _const(noise.SECOND))
        return builder.xor(x, builder.lshr(x, _const(15)))

    return types.uint32(index, high, low), build


@intrinsic
def ones32(typing, word):
    """Return ``noise.byte_counts`` of one word."""

    def build(context, builder, signature, arguments):
        (x,) = arguments
        x = builder.sub(x, builder.and_(builder.lshr(x, _const(1)), _const(0x55555555)))
        pairs = builder.and_(builder.lshr(x, _const(2)), _const(0x33333333))
        x = builder.add(builder.and_(x, _const(0x33333333)), pairs)
        x = builder.add(x, builder.lshr(x, _const(4)))
        return builder.and_(x, _const(0x0F0F0F0F))

    return types.uint32(word), build


@intrinsic
def ones_at(typing, counts, shift):
    """Return the count of the byte at a shift, as float32."""

    def build(context, builder, signature, arguments):
        counts, shift = arguments
        byte = builder.and_(builder.lshr(counts, _narrow(builder, shift)), _const(15))
        return builder.sitofp(byte, _F32)

    return types.float32(counts, shift), build


@intrinsic
def choose(typing, condition, yes, no):
    """Return yes or no without a branch."""

    def build(context, builder, signature, arguments):
        return builder.select(*arguments)

    return yes(types.boolean, yes, yes), build


@intrinsic
def count(typing, total, fired):
    """Return total + fired in 32 bits."""

    def build(context, builder, signature, arguments):
        total, fired = arguments
        return builder.add(total, builder.zext(fired, _I32))

    return types.int32(types.int32, types.boolean), build


@intrinsic
def add16(typing, total, byte):
    """Return total + byte in 16 bits."""

    def build(context, builder, signature, arguments):
        total, byte = arguments
        return builder.add(total, builder.zext(byte, ir.IntType(16)))

    return types.uint16(types.uint16, types.uint8), build


@intrinsic
def below32(typing, word, limit):
    """Return whether an unsigned word lies below a limit."""

    def build(context, builder, signature, arguments):
        return builder.icmp_unsigned("<", *arguments)

    return types.boolean(types.uint32, types.uint32), build


@intrinsic
def two_to(typing, whole):
    """Return 2**whole for a whole float32 from -126 to 127."""

    def build(context, builder, signature, arguments):
        exponent = builder.add(builder.fptosi(arguments[0], _I32), _const(127))
        return builder.bitcast(builder.shl(exponent, _const(23)), _F32)

    return types.float32(types.float32), build


@numba.njit(inline="always")
def exp32(x):
    """Return exp(x) for float32 from -87 to 60, to about 1e-7 of its value; less is 1e-38."""
    x = min(max(x, np.float32(-87.0)), np.float32(60.0))
    whole = np.floor(x * np.float32(1.44269504) + np.float32(0.5))
    # ln 2 in two parts, so that the remainder keeps its bits.
    r = (x - whole * np.float32(0.693359375)) + whole * np.float32(2.12194440e-4)
    # Taylor about 0 on |r| <= ln 2 / 2: the next term is below 1e-7.
    p = np.float32(1 / 5040)
    p = p * r + np.float32(1 / 720)
    p = p * r + np.float32(1 / 120)
    p = p * r + np.float32(1 / 24)
    p = p * r + np.float32(1 / 6)
    p = p * r + np.float32(0.5)
    p = p * r + ONE
    p = p * r + ONE
    return p * two_to(whole)


@compiled
def begin(v, start, cells, filled, high, low, least, span):
    """Put each cell at ``least + span * word / 2**32``; what only fills up waits for ever."""
    for i in range(filled):
        place = least + span * (np.float32(word32(i, high, low)) * np.float32(2.0**-32))
        v[np.uint64(start + i)] = place if i < cells else -np.float32(np.inf)


@compiled
def refresh(counts, start, cells, high, low):
    """Draw the words that serve the next four ticks, as ones a byte."""
    for i in range(cells):
        counts[np.uint64(start + i)] = ones32(word32(i, high, low))


@compiled
def lif_alike(v, counts, start, cells, shift, decay, push, kick, threshold, hold):
    """Advance integrate-and-fire cells that differ in noise alone; return how many fired.

    v is measured from the reset: ``v decay + push + kick * ones``, waiting cells apart.
    """
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        new = old * decay + (push + kick * ones_at(counts[j], shift))
        new = choose(old < WAITING, old + WAIT, new)
        spike = new >= threshold
        v[j] = choose(spike, hold, new)
        fired = count(fired, spike)
    return fired


@compiled
def lif_spread(v, counts, start, cells, shift, nats, decay, rest, slope, kick, threshold, hold):
    """Advance integrate-and-fire cells that share an input in nats but not their constants.

    v is in units in which all cells have one threshold.
    """
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        noise_ = kick[j] * (ones_at(counts[j], shift) - HALF_BITS)
        new = old * decay[j] + (rest[j] + slope[j] * nats) + noise_
        new = choose(old < WAITING, old + WAIT, new)
        spike = new >= threshold
        v[j] = choose(spike, hold, new)
        fired = count(fired, spike)
    return fired


@compiled
def lif_apart(v, counts, start, cells, shift, x, decay, rest, slope, kick, threshold, hold):
    """Advance integrate-and-fire cells with an input x and constants each."""
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        noise_ = kick[j] * (ones_at(counts[j], shift) - HALF_BITS)
        new = old * decay[j] + (rest[j] + slope[j] * x[j]) + noise_
        new = choose(old < WAITING, old + WAIT, new)
        spike = new >= threshold
        v[j] = choose(spike, hold, new)
        fired = count(fired, spike)
    return fired


@compiled
def phase_alike(v, counts, start, cells, shift, push, kick):
    """Advance phases; a phase that reached 1 shows its spike until the next tick takes 1 off."""
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        new = (old - choose(old >= ONE, ONE, ZERO)) + (push + kick * ones_at(counts[j], shift))
        v[j] = new
        fired = count(fired, new >= ONE)
    return fired


@compiled
def phase_apart(v, counts, start, cells, shift, mean, kick):
    """Advance phases with an expected advance ``mean`` each; kick is cv / sqrt 2."""
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        ones = ones_at(counts[j], shift) - HALF_BITS
        push = mean[j] + kick * np.sqrt(mean[j]) * ones
        new = (old - choose(old >= ONE, ONE, ZERO)) + push
        v[j] = new
        fired = count(fired, new >= ONE)
    return fired


@compiled
def escape_alike(v, start, cells, high, low, limit, hold):
    """Advance escape cells that share a hazard; v counts waiting ticks up to 0."""
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        spike = below32(word32(i, high, low), limit) & (old >= ZERO)
        v[j] = choose(spike, hold, min(old + ONE, ZERO))
        fired = count(fired, spike)
    return fired


@compiled
def escape_apart(v, start, cells, high, low, mean, hold):
    """Advance escape cells with an expected number of spikes a tick, ``mean``, each."""
    fired = np.int32(0)
    for i in range(cells):
        j = np.uint64(start + i)
        old = v[j]
        word = np.float32(word32(i, high, low)) * np.float32(2.0**-32)
        # 1 - exp(-m) by its series: the difference would lose the small rates' bits.
        m = min(mean[j], ONE)
        chance = m * (
            ONE - m * (np.float32(1 / 2) - m * (np.float32(1 / 6) - m * np.float32(1 / 24)))
        )
        spike = (word < chance) & (old >= ZERO)
        v[j] = choose(spike, hold, min(old + ONE, ZERO))
        fired = count(fired, spike)
    return fired


@compiled
def filtered(x, start, cells, decay, gain, wanted):
    """Filter the inputs of cells in place: ``x = decay x + gain wanted``."""
    for i in range(cells):
        j = np.uint64(start + i)
        x[j] = decay * x[j] + gain * wanted[j]


@compiled
def count_equal(v, first, cells, mark):
    """Return how many of some cells hold the mark."""
    hits = np.int32(0)
    for i in range(cells):
        hits = count(hits, v[np.uint64(first + i)] == mark)
    return hits


@compiled
def count_above(v, first, cells, mark):
    """Return how many of some cells hold the mark or more."""
    hits = np.int32(0)
    for i in range(cells):
        hits = count(hits, v[np.uint64(first + i)] >= mark)
    return hits


@compiled
def spikers(v, start, cells, mark, above, found, place):
    """Write down which cells just fired: v is the mark, or for a phase at least that."""
    total = 0
    # Whole registers are counted first: few of them hold a spike.
    for first in range(start, start + cells, LANES):
        hits = count_above(v, first, LANES, mark) if above else count_equal(v, first, LANES, mark)
        if hits:
            for j in range(first, first + LANES):
                state = v[np.uint64(j)]
                if state == mark or (above and state >= mark):
                    found[place + total] = j - start
                    total += 1
    return total


@compiled
def add_row(sums, start, wires, row, cells):
    """Add the connections of one spike, a row of 0 and 1, to the target cells' counts."""
    for i in range(cells):
        j = np.uint64(start + i)
        sums[j] = add16(sums[j], wires[np.uint64(row + i)])


@compiled
def synapse(u, sums, start, cells, decay, jump, x, offset, weight):
    """Filter a projection cell by cell, empty its counts, and add it to the cells' inputs x."""
    for i in range(cells):
        j = np.uint64(start + i)
        u[j] = decay * u[j] + jump * np.float32(sums[j])
        sums[j] = 0
        x[np.uint64(offset + i)] += weight * u[j]
