"""Fast loops of the ensemble engine over cells, one register at a time.

Trials run one at a time; neighbouring cells occupy neighbouring lanes of a register
(``registers``). A word of noise serves four ticks, and a cell advances through all four while its
state and its noise are in registers. Each loop sets a bit in ``fired`` for each cell that fires in
a tick, so spikes are counted by counting bits. Six things are needed for speed:

* 32-bit integer arithmetic. Numba widens to 64 bits, for which older machines have no vector
  multiplication; the few functions at the top and ``registers`` emit 32-bit instructions. Their
  NumPy twins are ``noise.words`` and ``noise.byte_counts``.
* A number of cells that is a multiple of 64, so that no loop has a remainder.
* A loop over ticks whose length the compiler knows from that of a tuple, so that it is unrolled.
* None for unused arguments: each combination is compiled separately.
* Unsigned indices, so that no check for negative ones is needed.
* No second array for refractory cells. A refractory cell has ``-WAIT * (ticks left)`` instead of a
  potential (measured from its reset), adds WAIT at each tick and returns to exactly 0 in time.
  Cells that only pad a register stay refractory for ever, at minus infinity.

The state of a cell is float32. The tests compare each loop with plain NumPy.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from circuits.dynamics import noise
from circuits.engines.compiling import part
from circuits.engines.registers import (
    WIDTH,
    bits_before,
    byte_counts,
    high_half,
    instruction,
    later,
    load,
    lowbias32,
    marked,
    multiply_add,
    note,
    ones_in,
    root,
    spread,
    store,
    where,
)

LANES = WIDTH
"""Populations are padded to a multiple of this many cells."""
WHOLE = -LANES
"""Mask that rounds a number of cells down to such a multiple."""
WAIT = np.float32(2.0**20)
WAITING = np.float32(-(2.0**19))
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
NOISE_STEP, FACTOR = 3, 4
"""Rows of the cells' constants: effect of a bit of noise, and factor on the rate."""
FOUR, SINGLE = (0, 1, 2, 3), (0,)
"""Ticks by which a loop advances its cells at once."""
HALF_BITS = np.float32(4.0)
_BYTES = tuple(np.float32(256.0**-byte) for byte in range(4))

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


def _const(value: int) -> ir.Constant:
    return ir.Constant(_I32, value)


@intrinsic
def word32(typing, index, key):
    """Return ``noise.words`` of one cell from the tick key."""

    def build(context, builder, signature, arguments):
        high = high_half(builder, arguments[1])
        x, low = (builder.trunc(value, _I32) for value in arguments)
        x = builder.add(builder.mul(x, _const(noise.GOLDEN_32)), high)
        return lowbias32(builder, x, low, _const)

    return types.uint32(index, types.uint64), build


@instruction(types.uint8, types.uint8)
def ones8(builder, byte):
    """Return the number of ones in a byte."""
    return builder.ctpop(byte)


@instruction(types.float32, types.uint32, types.int64)
def ones_at(builder, counts, byte):
    """Return the count of a byte, as float32."""
    here = builder.lshr(counts, bits_before(builder, byte))
    return builder.sitofp(builder.and_(here, _const(15)), _F32)


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
            word = builder.insert_element(word, arguments[2], _const(k))
        word = builder.lshr(word, ir.Constant(kind, list(range(8))))
        word = builder.and_(word, ir.Constant(kind, [0x0101010101010101] * 8))
        total = builder.add(builder.load(pointer, align=8), word)
        builder.store(total, pointer, align=8)

    return types.void(sums, types.uint64, types.uint64), build


@instruction(types.float32, types.float32)
def two_to(builder, power):
    """Return 2**power for a whole float32 from -126 to 127."""
    exponent = builder.add(builder.fptosi(power, _I32), _const(127))
    return builder.bitcast(builder.shl(exponent, _const(23)), _F32)


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
def begin(v, start, cells, filled, key, least, span):
    """Put each cell at ``least + span * word / 2**32``; padding stays refractory for ever."""
    for i in range(filled):
        place = least + span * (np.float32(word32(i, key)) * np.float32(2.0**-32))
        v[np.uint64(start + i)] = place if i < cells else -np.float32(np.inf)


@part
def in_own_units(v, start, cells, constants):
    """Convert potentials to units in which all cells have the same threshold."""
    if constants is None:
        return
    for j in range(start, start + cells):
        v[j] *= constants[FACTOR][j] if v[j] >= 0 else ONE


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
    for i in range(cells & WHOLE):
        counts[np.uint64(start + i)] >>= np.uint32(8 * byte)


@numba.njit(inline="always")
def _counts(place, noise_of, ticks):
    """Return the noise of a register of cells: for four ticks, or one tick's in the lowest byte."""
    key, byte = noise_of
    counts = byte_counts(place, key)
    return counts if len(ticks) > 1 else later(counts, byte)


@numba.njit(inline="always")
def _spread_four(values):
    return spread(values[0]), spread(values[1]), spread(values[2]), spread(values[3])


@numba.njit(inline="always")
def _per_bit(steps):
    """Return the effect of a bit of noise in four ticks, as ``ones_in`` counts bits."""
    return steps[0], steps[1] * _BYTES[1], steps[2] * _BYTES[2], steps[3] * _BYTES[3]


@numba.njit(inline="always")
def _lif(old, moved, wait, waiting, threshold, refractory):
    """Return the next state of integrate-and-fire cells, and whether they fire."""
    new = where(old < waiting, old + wait, moved)
    spike = new >= threshold
    return where(spike, refractory, new), spike


@part
def lif_identical(
    v, fired, start, cells, noise_of, ticks, decay, mean_step, noise_step, threshold, refractory
):
    """Advance integrate-and-fire cells that differ only in their noise.

    v is measured from the reset, and becomes ``v decay + (mean_step + noise_step * ones)`` except
    in refractory cells. The bracket does not depend on the previous tick.
    """
    steps = _spread_four(mean_step)
    each = _spread_four(_per_bit((noise_step, noise_step, noise_step, noise_step)))
    wait, waiting, kept = spread(WAIT), spread(WAITING), spread(decay)
    top, held = spread(threshold), spread(refractory)
    for g in range(cells // LANES):
        i = np.uint64(LANES * g)
        j = np.uint64(start) + i
        x, counts = load(v, j), _counts(i, noise_of, ticks)
        for t in range(len(ticks)):
            step = multiply_add(each[t], ones_in(counts, t), steps[t])
            x, spike = _lif(x, multiply_add(x, kept, step), wait, waiting, top, held)
            note(fired[t], np.uint64(g), spike)
        store(v, j, x)


@part
def lif_varied(
    v, fired, start, cells, noise_of, ticks, common, x, constants, threshold, refractory
):
    """Advance heterogeneous integrate-and-fire cells, with inputs x or a common input.

    v is in units in which all cells have the same threshold.
    """
    if constants is None:
        return
    decay, rest, slope, noise_step = constants[0], constants[1], constants[2], constants[NOISE_STEP]
    shared, wait, waiting = _spread_four(common), spread(WAIT), spread(WAITING)
    top, held = spread(threshold), spread(refractory)
    for g in range(cells // LANES):
        c = np.uint64(LANES * g)
        j = np.uint64(start) + c
        y, counts = load(v, j), _counts(c, noise_of, ticks)
        for t in range(len(ticks)):
            heard = shared[t] if x is None else load(x[t], c)
            pushed = multiply_add(load(slope, j), heard, load(rest, j))
            step = multiply_add(load(noise_step, j), ones_in(later(counts, t), 0), pushed)
            y, spike = _lif(y, multiply_add(y, load(decay, j), step), wait, waiting, top, held)
            note(fired[t], np.uint64(g), spike)
        store(v, j, y)


@numba.njit(inline="always")
def _phase(old, mean_step, one):
    """Return the next phase of cells, and whether they fire; visible until the next tick."""
    new = where(old >= one, old - one, old) + mean_step
    return new, new >= one


@part
def phase_identical(v, fired, start, cells, noise_of, ticks, mean_step, noise_step):
    """Advance phases that differ only in their noise."""
    steps, each, one = _spread_four(mean_step), _spread_four(_per_bit(noise_step)), spread(ONE)
    for g in range(cells // LANES):
        i = np.uint64(LANES * g)
        j = np.uint64(start) + i
        x, counts = load(v, j), _counts(i, noise_of, ticks)
        for t in range(len(ticks)):
            x, spike = _phase(x, multiply_add(each[t], ones_in(counts, t), steps[t]), one)
            note(fired[t], np.uint64(g), spike)
        store(v, j, x)


@part
def phase_varied(v, fired, start, cells, noise_of, ticks, mean, mean_root, x, constants, each):
    """Advance phases with individual expected steps: x, or the mean times the cell's factor.

    The jitter of an advance m is ``each sqrt(m)``; mean_root is that of the mean, and a cell's
    noise step ``each`` times the root of its factor.
    """
    if constants is None:
        return
    noise_step, factor = constants[NOISE_STEP], constants[FACTOR]
    means, roots, jitter = _spread_four(mean), _spread_four(mean_root), spread(each)
    one, half = spread(ONE), spread(HALF_BITS)
    for g in range(cells // LANES):
        c = np.uint64(LANES * g)
        j = np.uint64(start) + c
        y, counts = load(v, j), _counts(c, noise_of, ticks)
        for t in range(len(ticks)):
            m = means[t] * load(factor, j) if x is None else load(x[t], c)
            width = roots[t] * load(noise_step, j) if x is None else jitter * root(m)
            step = multiply_add(width, ones_in(later(counts, t), 0), m - half * width)
            y, spike = _phase(y, step, one)
            note(fired[t], np.uint64(g), spike)
        store(v, j, y)


@part
def filtered(x, start, cells, decay, gain, wanted):
    """Filter the inputs of cells in place: ``x = decay x + gain wanted``."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x[j] = fused(decay, x[j], gain * wanted[np.uint64(i)])


@part
def noted(marks, fired, cells, ticks):
    """Convert the marks of cells, one byte each with a bit per tick, to ``fired``."""
    for t in range(ticks):
        for g in range(cells // LANES):
            note(fired[t], np.uint64(g), marked(marks, np.uint64(LANES * g), t))


@part
def how_many(fired, cells):
    """Return the number of cells that fired, from a bit for each."""
    total = 0
    for g in range(cells // LANES):
        total += ones(fired[np.uint64(g)])
    return total


@part
def listed(fired, cells, places):
    """List the cells that fired; return how many."""
    count = 0
    for g in range(cells // LANES):
        word = fired[np.uint64(g)]
        while word:
            places[count] = LANES * g + lowest(word)
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
