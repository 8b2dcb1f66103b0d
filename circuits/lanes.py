"""What makes the ensemble engine fast, in one place: loops over cells that the compiler vectorises.

One trial at a time; neighbouring cells lie in neighbouring lanes of a register. A word of noise
serves four ticks, and where their inputs are known the cells take all four at once, in registers;
the loops over one tick are for the rest. Six things are needed for that, and each is used below:

* 32-bit integer arithmetic. Numba widens to 64 bits, for which older machines have no vector
  multiplication; the few functions at the top emit 32-bit instructions. Their NumPy twins are
  ``noise.words`` and ``noise.byte_counts``.
* A number of cells that the compiler sees to be a multiple of 64: nothing is left over at the end.
* Arguments that are None where a loop has no use for them: each combination is compiled apart.
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
WHOLE = -LANES
"""Keeps of a number of cells what is such a multiple."""
WAIT = np.float32(2.0**20)
WAITING = np.float32(-(2.0**19))
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
BYTE0, BYTE1, BYTE2, BYTE3 = (np.int32(8 * i) for i in range(4))
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
def ones8(typing, byte):
    """Return the number of ones in a byte."""

    def build(context, builder, signature, arguments):
        return builder.ctpop(*arguments)

    return types.uint8(types.uint8), build


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
def bits(typing, first, second, third, fourth):
    """Return four truths as the low bits of a byte."""

    def build(context, builder, signature, arguments):
        total = _const(0)
        for i, truth in enumerate(arguments):
            total = builder.or_(total, builder.select(truth, _const(1 << i), _const(0)))
        return builder.trunc(total, ir.IntType(8))

    return types.uint8(*[types.boolean] * 4), build


@intrinsic
def lowest(typing, word):
    """Return the place of the lowest one of a 64-bit word that has one."""

    def build(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), build


@intrinsic
def add_bits(typing, sums, place, word):
    """Add the bits of a word to 64 counts of a byte: bit k of its bytes to the eight from 8 k."""

    def build(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        kind = ir.VectorType(ir.IntType(64), 8)
        pointer = builder.bitcast(builder.gep(array.data, [arguments[1]]), kind.as_pointer())
        word = ir.Constant(kind, ir.Undefined)
        for k in range(8):
            word = builder.insert_element(word, arguments[2], _const(k))
        word = builder.lshr(word, ir.Constant(kind, list(range(8))))
        word = builder.and_(word, ir.Constant(kind, [0x0101010101010101] * 8))
        total = builder.add(builder.load(pointer, align=8), word)
        builder.store(total, pointer, align=8)

    return types.void(sums, types.uint64, types.uint64), build


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
    for i in range(cells & WHOLE):
        counts[np.uint64(start + i)] = word32(i, high, low)
    ones = counts.view(np.uint8)
    for i in range(4 * (cells & WHOLE)):
        j = np.uint64(4 * start + i)
        ones[j] = ones8(ones[j])


@numba.njit(inline="always")
def _lif(old, moved, threshold, hold):
    """Return the next state of an integrate-and-fire cell, and whether it fires."""
    new = choose(old < WAITING, old + WAIT, moved)
    spike = new >= threshold
    return choose(spike, hold, new), spike


@compiled
def lif_alike(v, counts, start, cells, shift, decay, push, kick, threshold, hold):
    """Advance integrate-and-fire cells that differ in noise alone; return how many fired.

    v is measured from the reset: ``v decay + (push + kick * ones)``, waiting cells apart: the
    bracket does not wait for the tick before.
    """
    fired = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        moved = v[j] * decay + (push + kick * ones_at(counts[j], shift))
        v[j], spike = _lif(v[j], moved, threshold, hold)
        fired = count(fired, spike)
    return fired


@compiled
def lif_four(v, counts, start, cells, decay, push, kick, threshold, hold, marks):
    """Advance such cells by four ticks; return how many fired in each, or mark them.

    Marks are None, or take a bit for every tick in which a cell fired; counting is left out then.
    """
    p0, p1, p2, p3 = push[0], push[1], push[2], push[3]
    f0 = f1 = f2 = f3 = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x, word = v[j], counts[j]
        x, s0 = _lif(x, x * decay + (p0 + kick * ones_at(word, BYTE0)), threshold, hold)
        x, s1 = _lif(x, x * decay + (p1 + kick * ones_at(word, BYTE1)), threshold, hold)
        x, s2 = _lif(x, x * decay + (p2 + kick * ones_at(word, BYTE2)), threshold, hold)
        x, s3 = _lif(x, x * decay + (p3 + kick * ones_at(word, BYTE3)), threshold, hold)
        v[j] = x
        if marks is not None:
            marks[np.uint64(i)] = bits(s0, s1, s2, s3)
        else:
            f0, f1, f2, f3 = count(f0, s0), count(f1, s1), count(f2, s2), count(f3, s3)
    return f0, f1, f2, f3


@numba.njit(inline="always")
def _phase(old, push, noise_):
    """Return the next phase of a cell, and whether it fires."""
    new = (old - choose(old >= ONE, ONE, ZERO)) + (push + noise_)
    return new, new >= ONE


@compiled
def phase_four(v, counts, start, cells, push, kick, marks):
    """Advance phases by four ticks; return how many fired in each, or mark them."""
    p0, p1, p2, p3 = push[0], push[1], push[2], push[3]
    k0, k1, k2, k3 = kick[0], kick[1], kick[2], kick[3]
    f0 = f1 = f2 = f3 = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x, word = v[j], counts[j]
        x, s0 = _phase(x, p0, k0 * ones_at(word, BYTE0))
        x, s1 = _phase(x, p1, k1 * ones_at(word, BYTE1))
        x, s2 = _phase(x, p2, k2 * ones_at(word, BYTE2))
        x, s3 = _phase(x, p3, k3 * ones_at(word, BYTE3))
        v[j] = x
        if marks is not None:
            marks[np.uint64(i)] = bits(s0, s1, s2, s3)
        else:
            f0, f1, f2, f3 = count(f0, s0), count(f1, s1), count(f2, s2), count(f3, s3)
    return f0, f1, f2, f3


@numba.njit(inline="always")
def _jitter(mean, kick, word, byte):
    """Return the noise of a phase with an expected advance ``mean``."""
    return kick * np.sqrt(mean) * (ones_at(word, byte) - HALF_BITS)


@compiled
def phase_apart_four(v, counts, start, cells, mean, kick, marks):
    """Advance phases with an expected advance each by four ticks; return as ``phase_four``."""
    m0, m1, m2, m3 = mean[0], mean[1], mean[2], mean[3]
    f0 = f1 = f2 = f3 = np.int32(0)
    for i in range(cells & WHOLE):
        c, j = np.uint64(i), np.uint64(start + i)
        x, word = v[j], counts[j]
        x, s0 = _phase(x, m0[c], _jitter(m0[c], kick, word, BYTE0))
        x, s1 = _phase(x, m1[c], _jitter(m1[c], kick, word, BYTE1))
        x, s2 = _phase(x, m2[c], _jitter(m2[c], kick, word, BYTE2))
        x, s3 = _phase(x, m3[c], _jitter(m3[c], kick, word, BYTE3))
        v[j] = x
        if marks is not None:
            marks[c] = bits(s0, s1, s2, s3)
        else:
            f0, f1, f2, f3 = count(f0, s0), count(f1, s1), count(f2, s2), count(f3, s3)
    return f0, f1, f2, f3


@compiled
def lif_apart(v, counts, start, cells, shift, x, decay, rest, slope, kick, threshold, hold):
    """Advance integrate-and-fire cells with an input x and constants each.

    v is in units in which all cells have one threshold.
    """
    fired = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        push = rest[j] + slope[j] * x[np.uint64(i)] + kick[j] * ones_at(counts[j], shift)
        moved = v[j] * decay[j] + push
        v[j], spike = _lif(v[j], moved, threshold, hold)
        fired = count(fired, spike)
    return fired


@compiled
def lif_apart_four(v, counts, start, cells, x, decay, rest, slope, kick, threshold, hold, marks):
    """Advance such cells by four ticks; return how many fired in each, or mark them."""
    x0, x1, x2, x3 = x[0], x[1], x[2], x[3]
    f0 = f1 = f2 = f3 = np.int32(0)
    for i in range(cells & WHOLE):
        c, j = np.uint64(i), np.uint64(start + i)
        y, word, d, r, s, n = v[j], counts[j], decay[j], rest[j], slope[j], kick[j]
        y, s0 = _lif(y, y * d + (r + s * x0[c] + n * ones_at(word, BYTE0)), threshold, hold)
        y, s1 = _lif(y, y * d + (r + s * x1[c] + n * ones_at(word, BYTE1)), threshold, hold)
        y, s2 = _lif(y, y * d + (r + s * x2[c] + n * ones_at(word, BYTE2)), threshold, hold)
        y, s3 = _lif(y, y * d + (r + s * x3[c] + n * ones_at(word, BYTE3)), threshold, hold)
        v[j] = y
        if marks is not None:
            marks[c] = bits(s0, s1, s2, s3)
        else:
            f0, f1, f2, f3 = count(f0, s0), count(f1, s1), count(f2, s2), count(f3, s3)
    return f0, f1, f2, f3


@compiled
def phase_alike(v, counts, start, cells, shift, push, kick):
    """Advance phases; a phase that reached 1 shows its spike until the next tick takes 1 off."""
    fired = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        v[j], spike = _phase(v[j], push, kick * ones_at(counts[j], shift))
        fired = count(fired, spike)
    return fired


@compiled
def phase_apart(v, counts, start, cells, shift, mean, kick):
    """Advance phases with an expected advance ``mean`` each; kick is cv / sqrt 2."""
    fired = np.int32(0)
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        here = mean[np.uint64(i)]
        v[j], spike = _phase(v[j], here, _jitter(here, kick, counts[j], shift))
        fired = count(fired, spike)
    return fired


@compiled
def escape_alike(v, start, cells, high, low, limit, hold):
    """Advance escape cells that share a hazard; v counts waiting ticks up to 0."""
    fired = np.int32(0)
    for i in range(cells & WHOLE):
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
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        old = v[j]
        word = np.float32(word32(i, high, low)) * np.float32(2.0**-32)
        # 1 - exp(-m) by its series: the difference would lose the small rates' bits.
        m = min(mean[np.uint64(i)], ONE)
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
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x[j] = decay * x[j] + gain * wanted[np.uint64(i)]


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
def marked(marks, cells, found, most, places, found_n):
    """List the cells with each of four marks, at four places; return how many there are."""
    words = marks.view(np.uint64)
    for t in range(4):
        found_n[places[t]] = 0
    for i in range(cells // 8):
        word = words[np.uint64(i)]
        while word:
            bit = lowest(word)
            word &= word - np.uint64(1)
            place = places[bit & 7]
            found[place * most + found_n[place]] = 8 * i + (bit >> 3)
            found_n[place] += 1
    return found_n[places[0]], found_n[places[1]], found_n[places[2]], found_n[places[3]]


@compiled
def add_row(sums, wires, row, cells):
    """Add the connections of one spike, a row of bits, to the target cells' counts, a byte each.

    Bit ``8 i + k`` of a word stands for cell ``8 k + i`` of its 64.
    """
    eight = sums.view(np.uint64)
    for m in range(cells // LANES):
        add_bits(eight, np.uint64(8 * m), wires[np.uint64(row + m)])


@compiled
def arrive(u, start, sums, cells, jump):
    """Add what arrived to the filters of cells, and empty the counts."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        u[j] += jump * np.float32(sums[np.uint64(i)])
        sums[np.uint64(i)] = 0


@compiled
def scaled(u, start, cells, factor):
    """Multiply the filters of cells by a factor."""
    for i in range(cells & WHOLE):
        u[np.uint64(start + i)] *= factor


@compiled
def inputs(x, cells, common, u, first, weight, second, other):
    """Set the input x of each cell to a common part and two filters of its own."""
    for i in range(cells & WHOLE):
        own = weight * u[np.uint64(first + i)] + other * u[np.uint64(second + i)]
        x[np.uint64(i)] = common + own


@compiled
def more_inputs(x, cells, u, first, weight):
    """Add a filter to the input x of each cell."""
    for i in range(cells & WHOLE):
        x[np.uint64(i)] += weight * u[np.uint64(first + i)]


@compiled
def fill(x, cells, value):
    """Set the input of all cells."""
    for i in range(cells & WHOLE):
        x[np.uint64(i)] = value


@compiled
def fill_apart(x, start, cells, value, factor):
    """Set the input of all cells to a value times a factor each."""
    for i in range(cells & WHOLE):
        x[np.uint64(i)] = value * factor[np.uint64(start + i)]
