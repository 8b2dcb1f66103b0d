"""Fast loops of the spikes engine over cells with a tick.

Trials run one at a time; the compiler turns a loop over neighbouring cells into vector
instructions. A word of noise serves four ticks, and a cell advances through all four while its
state is in registers. Each loop writes a byte for each cell, a bit of which says whether the cell
fires in a tick, so spikes are counted by counting bits. Needed for speed:

* 32-bit integer arithmetic. Numba widens to 64 bits, for which older machines have no vector
  multiplication; the few functions at the top emit 32-bit instructions for one number. Their NumPy
  twins are ``noise.words`` and ``noise.byte_counts``.
* A number of cells that is a multiple of 64, so that no loop has a remainder.
* A loop over ticks whose length the compiler knows from that of a tuple, so that it is unrolled.
* None for unused arguments: each combination is compiled separately.
* Unsigned indices, so that no check for negative ones is needed.
* One array of marks for all ticks, since a vectorised loop first checks that arrays are apart.
* No second array for refractory cells. A refractory cell has ``-WAIT * (ticks left)`` instead of a
  potential (measured from its reset), adds WAIT at each tick and returns to exactly 0 in time.
  Cells that only pad a block stay refractory for ever, at minus infinity.

The few operations that Numba lacks are LLVM instructions for one number. The state of a cell is
float32. The tests compare each loop with plain NumPy.
"""

from __future__ import annotations

from functools import wraps

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from circuits.dynamics import noise
from circuits.engines.compiling import part

LANES = 64
"""Populations are padded to a multiple of this many cells."""
WHOLE = -LANES
"""Mask that rounds a number of cells down to such a multiple."""
WAIT = np.float32(2.0**20)
WAITING = np.float32(-(2.0**19))
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
NOISE_STEP, UNIT = 3, 4
"""Rows of the cells' constants: effect of a bit of noise, and unit of potential."""
FOUR, SINGLE = (0, 1, 2, 3), (0,)
"""Ticks by which a loop advances its cells at once."""

_GOLDEN = np.uint64(noise.GOLDEN)
_I32 = ir.IntType(32)
_F32 = ir.FloatType()


def _data(context, builder, kind, array, place=None):
    data = context.make_array(kind)(context, builder, array).data
    return data if place is None else builder.gep(data, [place])


def _row(context, builder, kind, array):
    shape = context.make_array(kind)(context, builder, array).shape
    return builder.extract_value(shape, 1)


def _call(builder, address, *values):
    kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
    builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def advance(typing, address, states, constants, start, counts, heard, cells, ticks, marks):
    """Call a cell type's compiled ``advance`` (see ``cells``) on a block."""

    def build(context, builder, signature, arguments):
        address, states, constants, start, counts, heard, cells, ticks, marks = arguments
        of = dict(zip(("states", "constants", "counts", "heard", "marks"),
                      (signature.args[i] for i in (1, 2, 4, 5, 8)), strict=True))  # fmt: skip
        _call(
            builder,
            address,
            _data(context, builder, of["states"], states, start),
            _data(context, builder, of["constants"], constants, start),
            _row(context, builder, of["states"], states),
            _data(context, builder, of["counts"], counts, start),
            _data(context, builder, of["heard"], heard),
            _row(context, builder, of["heard"], heard),
            cells,
            ticks,
            _data(context, builder, of["marks"], marks),
        )

    integer = types.int64
    return types.void(
        integer, states, constants, integer, counts, heard, integer, integer, marks
    ), build


@intrinsic
def place(typing, address, states, constants, start, key, cells):
    """Call a cell type's compiled ``place`` on a block."""

    def build(context, builder, signature, arguments):
        address, states, constants, start, key, cells = arguments
        _, of_states, of_constants, *_ = signature.args
        _call(
            builder,
            address,
            _data(context, builder, of_states, states, start),
            _data(context, builder, of_constants, constants, start),
            _row(context, builder, of_states, states),
            key,
            cells,
        )

    integer = types.int64
    return types.void(integer, states, constants, integer, types.uint64, integer), build


def instruction(result, *kinds):
    """Return a decorator that turns a function of a builder and LLVM values into compiled code.

    ``result`` and ``kinds`` are the types of its result, and of its arguments after the builder.
    """

    def made(emit):
        @intrinsic
        @wraps(emit)
        def typed(typing, *operands):
            return result(*kinds), lambda _, builder, __, values: emit(builder, *values)

        return typed

    return made


@intrinsic
def take_number(typing, next_number):
    """Return the number in an array of one and raise it by 1, so that each thread gets its own."""

    def build(context, builder, signature, arguments):
        data = _data(context, builder, signature.args[0], arguments[0])
        return builder.atomic_rmw("add", data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(next_number), build


@instruction(types.uint32, types.int64, types.uint32, types.uint32)
def lowbias32(builder, index, high, low):
    """Return the word of ``noise.lowbias32`` of one cell."""
    x = builder.add(builder.mul(builder.trunc(index, _I32), _I32(noise.GOLDEN_32)), high)
    x = builder.xor(x, builder.lshr(x, _I32(16)))
    x = builder.add(builder.mul(x, _I32(noise.FIRST)), low)
    x = builder.xor(x, builder.lshr(x, _I32(15)))
    x = builder.mul(x, _I32(noise.SECOND))
    return builder.xor(x, builder.lshr(x, _I32(15)))


@numba.njit(inline="always")
def word32(index, key):
    """Return ``noise.words`` of one cell from the tick key."""
    return lowbias32(index, np.uint32(key >> np.uint64(32)), np.uint32(key))


@instruction(types.uint8, types.uint8)
def ones8(builder, byte):
    """Return the number of ones in a byte."""
    return builder.ctpop(byte)


@numba.njit(inline="always")
def ones_at(counts, byte):
    """Return the count of a byte, as float32."""
    return np.float32(np.int32(np.uint32(counts >> np.uint32(8 * byte)) & np.uint32(15)))


@intrinsic
def choose(typing, condition, yes, no):
    """Return ``yes`` or ``no`` without a branch."""

    def build(context, builder, signature, arguments):
        return builder.select(*arguments)

    return yes(types.boolean, yes, yes), build


@instruction(types.float32, types.float32, types.float32, types.float32)
def fused(builder, a, b, c):
    """Return ``a b + c`` of float32, rounded once, on every machine."""
    return builder.fma(a, b, c)


@instruction(types.int64, types.uint64)
def lowest(builder, word):
    """Return the position of the lowest set bit of a 64-bit word other than 0."""
    return builder.cttz(word, ir.Constant(ir.IntType(1), 1))


@instruction(types.int64, types.uint64)
def ones(builder, word):
    """Return the number of ones in a 64-bit word."""
    return builder.ctpop(word)


@intrinsic
def add_bits(typing, sums, place, word):
    """Add the bits of a word to 64 one-byte counts: bit k of byte i to count ``8 k + i``."""

    def build(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        kind = ir.VectorType(ir.IntType(64), 8)
        pointer = builder.bitcast(builder.gep(array.data, [arguments[1]]), kind.as_pointer())
        word = ir.Constant(kind, ir.Undefined)
        for k in range(8):
            word = builder.insert_element(word, arguments[2], _I32(k))
        word = builder.lshr(word, ir.Constant(kind, list(range(8))))
        word = builder.and_(word, ir.Constant(kind, [0x0101010101010101] * 8))
        total = builder.add(builder.load(pointer, align=8), word)
        builder.store(total, pointer, align=8)

    return types.void(sums, types.uint64, types.uint64), build


@instruction(types.float32, types.float32)
def two_to(builder, power):
    """Return 2**power for a whole float32 from -126 to 127."""
    exponent = builder.add(builder.fptosi(power, _I32), _I32(127))
    return builder.bitcast(builder.shl(exponent, _I32(23)), _F32)


@numba.njit(inline="always")
def exp32(x):
    """Return exp(x) for float32 up to 60, with a relative error near 1e-7; 1e-38 below -87."""
    x = min(max(x, np.float32(-87.0)), np.float32(60.0))
    power = np.floor(x * np.float32(1.44269504) + np.float32(0.5))
    # ln 2 in two parts, so that the remainder keeps its bits.
    r = fused(power, np.float32(2.12194440e-4), fused(power, np.float32(-0.693359375), x))
    # Taylor about 0 on |r| <= ln 2 / 2: the next term is below 1e-7.
    p = np.float32(1 / 5040)
    p = fused(p, r, np.float32(1 / 720))
    p = fused(p, r, np.float32(1 / 120))
    p = fused(p, r, np.float32(1 / 24))
    p = fused(p, r, np.float32(1 / 6))
    p = fused(p, r, np.float32(0.5))
    p = fused(p, r, ONE)
    p = fused(p, r, ONE)
    return p * two_to(power)


@numba.njit(inline="always")
def tick_key(stream, tick):
    """Return ``noise.tick_key`` as one word."""
    z = stream + np.uint64(tick + 1) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@part
def begin(v, start, cells, filled, key, threshold):
    """Put each cell between reset and threshold at random; padding stays refractory for ever."""
    for i in range(filled):
        place = threshold * (np.float32(word32(i, key)) * np.float32(2.0**-32))
        v[np.uint64(start + i)] = place if i < cells else -np.float32(np.inf)


@part
def in_own_units(v, start, cells, constants):
    """Convert potentials to units in which all cells have the same threshold."""
    if constants is None:
        return
    for j in range(start, start + cells):
        v[j] *= constants[UNIT][j] if v[j] >= 0 else ONE


@part
def refresh(counts, start, cells, noise_of):
    """Draw the noise of the next four ticks, as counts of ones per byte, the next tick's lowest."""
    key, byte = noise_of
    for i in range(cells & WHOLE):
        counts[np.uint64(start + i)] = word32(i, key)
    octets = counts.view(np.uint8)
    for i in range(4 * (cells & WHOLE)):
        j = np.uint64(4 * start + i)
        octets[j] = ones8(octets[j])
    if byte:
        for i in range(cells & WHOLE):
            counts[np.uint64(start + i)] >>= np.uint32(8 * byte)


@numba.njit(inline="always")
def _lif(old, moved, threshold, refractory):
    """Return the next state of an integrate-and-fire cell, and whether it fires."""
    new = old + WAIT if old < WAITING else moved
    spike = new >= threshold
    return refractory if spike else new, spike


@part
def lif_identical(
    v,
    marks,
    counts,
    start,
    cells,
    ticks,
    decay,
    mean_step,
    noise_step,
    threshold,
    refractory,
):
    """Advance integrate-and-fire cells that differ only in their noise.

    v is measured from the reset, and becomes ``v decay + (mean_step + noise_step * ones)`` except
    in refractory cells. The bracket does not depend on the previous tick.
    """
    for i in range(cells & WHOLE):
        c, j = np.uint64(i), np.uint64(start + i)
        x, noise, marked = v[j], counts[j], np.uint8(0)
        for t in range(len(ticks)):
            step = fused(noise_step, ones_at(noise, t), mean_step[t])
            x, spike = _lif(x, fused(x, decay, step), threshold, refractory)
            marked |= np.uint8(spike) << np.uint8(t)
        v[j] = x
        marks[c] = marked


@part
def lif_varied(v, marks, counts, start, cells, ticks, common, x, constants, threshold, refractory):
    """Advance heterogeneous integrate-and-fire cells, with inputs x or a common input.

    v is in units in which all cells have the same threshold.
    """
    if constants is None:
        return
    decay, rest, slope, noise_step = constants[0], constants[1], constants[2], constants[NOISE_STEP]
    for i in range(cells & WHOLE):
        c, j = np.uint64(i), np.uint64(start + i)
        y, noise, marked = v[j], counts[j], np.uint8(0)
        for t in range(len(ticks)):
            heard = common[t] if x is None else x[t, c]
            pushed = fused(slope[j], heard, rest[j])
            step = fused(noise_step[j], ones_at(noise, t), pushed)
            y, spike = _lif(y, fused(y, decay[j], step), threshold, refractory)
            marked |= np.uint8(spike) << np.uint8(t)
        v[j] = y
        marks[c] = marked


@part
def filtered(x, start, cells, decay, gain, wanted):
    """Filter the inputs of cells in place: ``x = decay x + gain wanted``."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x[j] = fused(decay, x[j], gain * wanted[np.uint64(i)])


@part
def how_many(marks, cells, t):
    """Return the number of cells that fired in a tick, from a byte for each with a bit per tick."""
    eight, bit, total = marks.view(np.uint64), np.uint64(0x0101010101010101) << np.uint64(t), 0
    for i in range((cells & WHOLE) // 8):
        total += ones(eight[np.uint64(i)] & bit)
    return total


@part
def listed(marks, cells, t, places):
    """List the cells that fired in a tick; return how many."""
    eight, bit, count = marks.view(np.uint64), np.uint64(0x0101010101010101) << np.uint64(t), 0
    for i in range((cells & WHOLE) // 8):
        word = eight[np.uint64(i)] & bit
        while word:
            places[count] = 8 * i + lowest(word) // 8
            word &= word - np.uint64(1)
            count += 1
    return count


@numba.njit(inline="always")
def add_row(sums, connections, row, cells):
    """Add the connections of one spike, a row of bits, to the one-byte counts of target cells.

    Bit ``8 i + k`` of a word is the connection to cell ``8 k + i`` of its 64.
    """
    eight = sums.view(np.uint64)
    for m in range(cells // LANES):
        add_bits(eight, np.uint64(8 * m), connections[np.uint64(row + m)])


@part
def arrive(u, start, sums, cells, jump):
    """Add arrivals to the filters of cells, and clear the counts."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        u[j] = fused(jump, np.float32(sums[np.uint64(i)]), u[j])
        sums[np.uint64(i)] = 0


@part
def scaled(u, start, cells, factor):
    """Multiply the filters of cells by a factor."""
    for i in range(cells & WHOLE):
        u[np.uint64(start + i)] *= factor


@part
def inputs(x, cells, common, u, first, weight, second, other):
    """Set the input x of each cell to a common part plus two filters of the cell."""
    for i in range(cells & WHOLE):
        filtered = fused(other, u[np.uint64(second + i)], weight * u[np.uint64(first + i)])
        x[np.uint64(i)] = common + filtered


@part
def more_inputs(x, cells, u, first, weight):
    """Add a filter to the input x of each cell."""
    for i in range(cells & WHOLE):
        j = np.uint64(i)
        x[j] = fused(weight, u[np.uint64(first + i)], x[j])
