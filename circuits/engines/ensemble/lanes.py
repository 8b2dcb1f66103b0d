"""What makes the ensemble engine fast, in one place: loops over cells that the compiler vectorises.

One trial at a time; neighbouring cells lie in neighbouring lanes of a register. A word of noise
serves four ticks, and a cell takes all four while its state is in a register. Each loop returns how
many cells fired in each tick, or, given marks, sets a bit for each tick in which a cell fired; to
count as well would take longer. Seven things are needed for speed, and each is used below:

* 32-bit integer arithmetic. Numba widens to 64 bits, for which older machines have no vector
  multiplication; the few functions at the top emit 32-bit instructions. Their NumPy twins are
  ``noise.words`` and ``noise.byte_counts``.
* A number of cells that the compiler sees to be a multiple of 64: nothing is left over at the end.
* A loop over ticks whose length the compiler sees, as that of a tuple: it writes the ticks out, one
  after the other, and goes through cells side by side.
* Arguments that are None where a loop has no use for them: each combination is compiled variation.
* An unsigned index, so that no negative one has to be wrapped.
* Choosing between two values instead of branching, and storing what was chosen every time: a
  store under a mask costs ten times as much on some machines.
* No second array for refractory cells. A cell that waits holds ``-WAIT * (ticks left)`` instead of
  a potential (measured from its reset), adds WAIT at each tick and is back at exactly 0 in time.
  Cells that only fill a register up wait for ever, at minus infinity.

The state of a cell is float32, sums over cells are int32. The tests hold each loop to plain
NumPy.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import intrinsic

from circuits import noise
from circuits.engines.compiling import compiled

LANES = 64
"""Populations are filled up to a multiple of this many cells."""
WHOLE = -LANES
"""Keeps of a number of cells what is such a multiple."""
WAIT = np.float32(2.0**20)
WAITING = np.float32(-(2.0**19))
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
NOISE_STEP, FACTOR = 3, 4
"""Rows of the cells' constants: what a bit of noise does, and what a rate is multiplied by."""
FOUR, SINGLE = (0, 1, 2, 3), (0,)
"""Ticks that a loop takes its cells through at once."""
UNMARKED = np.int32(0)
NOBODY = (np.int32(0),) * 4
HALF_BITS = np.float32(4.0)

_GOLDEN = np.uint64(noise.GOLDEN)
_I32 = ir.IntType(32)
_F32 = ir.FloatType()


def _data(context, builder, kind, array, place=None):
    """Return the pointer to an array's data, or to one of its elements."""
    data = context.make_array(kind)(context, builder, array).data
    return data if place is None else builder.gep(data, [place])


def _row(context, builder, kind, array):
    """Return the length of the rows of a two-dimensional array."""
    shape = context.make_array(kind)(context, builder, array).shape
    return builder.extract_value(shape, 1)


def _call(builder, address, *values):
    """Call a function of no result by its address."""
    kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
    builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def advance(typing, address, states, own, start, counts, heard, cells, ticks, marks, fired):
    """Call a cell type's compiled ``advance`` (see ``cells``) on a block."""

    def build(context, builder, signature, arguments):
        address, states, own, start, counts, heard, cells, ticks, marks, fired = arguments
        of = dict(zip(("states", "own", "counts", "heard", "marks", "fired"),
                      (signature.args[i] for i in (1, 2, 4, 5, 8, 9)), strict=True))  # fmt: skip
        _call(
            builder,
            address,
            _data(context, builder, of["states"], states, start),
            _data(context, builder, of["own"], own, start),
            _row(context, builder, of["states"], states),
            _data(context, builder, of["counts"], counts, start),
            _data(context, builder, of["heard"], heard),
            _row(context, builder, of["heard"], heard),
            cells,
            ticks,
            _data(context, builder, of["marks"], marks),
            _data(context, builder, of["fired"], fired),
        )

    whole = types.int64
    return types.void(whole, states, own, whole, counts, heard, whole, whole, marks, fired), build


@intrinsic
def place(typing, address, states, own, start, key, cells):
    """Call a cell type's compiled ``place`` on a block."""

    def build(context, builder, signature, arguments):
        address, states, own, start, key, cells = arguments
        _, of_states, of_own, *_ = signature.args
        _call(
            builder,
            address,
            _data(context, builder, of_states, states, start),
            _data(context, builder, of_own, own, start),
            _row(context, builder, of_states, states),
            key,
            cells,
        )

    whole = types.int64
    return types.void(whole, states, own, whole, types.uint64, whole), build


def _const(value: int) -> ir.Constant:
    return ir.Constant(_I32, value)


@intrinsic
def word32(typing, index, key):
    """Return ``noise.words`` of one cell from the tick key."""

    def build(context, builder, signature, arguments):
        _, key = arguments
        high = builder.trunc(builder.lshr(key, ir.Constant(key.type, 32)), _I32)
        x, low = (builder.trunc(value, _I32) for value in arguments)
        x = builder.add(builder.mul(x, _const(noise.GOLDEN_32)), high)
        x = builder.xor(x, builder.lshr(x, _const(16)))
        x = builder.add(builder.mul(x, _const(noise.FIRST)), low)
        x = builder.xor(x, builder.lshr(x, _const(15)))
        x = builder.mul(x, _const(noise.SECOND))
        return builder.xor(x, builder.lshr(x, _const(15)))

    return types.uint32(index, types.uint64), build


@intrinsic
def ones8(typing, byte):
    """Return the number of ones in a byte."""

    def build(context, builder, signature, arguments):
        return builder.ctpop(*arguments)

    return types.uint8(types.uint8), build


@intrinsic
def ones_at(typing, counts, byte):
    """Return the count of a byte, as float32."""

    def build(context, builder, signature, arguments):
        counts, byte = arguments
        shift = builder.shl(builder.trunc(byte, _I32), _const(3))
        return builder.sitofp(builder.and_(builder.lshr(counts, shift), _const(15)), _F32)

    return types.float32(types.uint32, types.int64), build


@intrinsic
def choose(typing, condition, yes, no):
    """Return yes or no without a branch."""

    def build(context, builder, signature, arguments):
        return builder.select(*arguments)

    return yes(types.boolean, yes, yes), build


@intrinsic
def fused(typing, a, b, c):
    """Return ``a b + c`` of float32, rounded once, on every machine."""

    def build(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), build


@intrinsic
def count(typing, total, fired):
    """Return total + fired in 32 bits."""

    def build(context, builder, signature, arguments):
        total, fired = arguments
        return builder.add(total, builder.zext(fired, _I32))

    return types.int32(types.int32, types.boolean), build


@intrinsic
def bit(typing, mark, place, truth):
    """Return a mark with one more truth in it."""

    def build(context, builder, signature, arguments):
        mark, place, truth = arguments
        here = builder.shl(_const(1), builder.trunc(place, _I32))
        return builder.or_(mark, builder.select(truth, here, _const(0)))

    return types.int32(types.int32, types.int64, types.boolean), build


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
    r = fused(whole, np.float32(2.12194440e-4), fused(whole, np.float32(-0.693359375), x))
    # Taylor about 0 on |r| <= ln 2 / 2: the next term is below 1e-7.
    p = np.float32(1 / 5040)
    p = fused(p, r, np.float32(1 / 720))
    p = fused(p, r, np.float32(1 / 120))
    p = fused(p, r, np.float32(1 / 24))
    p = fused(p, r, np.float32(1 / 6))
    p = fused(p, r, np.float32(0.5))
    p = fused(p, r, ONE)
    p = fused(p, r, ONE)
    return p * two_to(whole)


@numba.njit(inline="always")
def tick_key(stream, tick):
    """Return ``noise.tick_key`` as one word."""
    z = stream + np.uint64(tick + 1) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@compiled
def begin(v, start, cells, filled, key, least, span):
    """Put each cell at ``least + span * word / 2**32``; what only fills up waits for ever."""
    for i in range(filled):
        place = least + span * (np.float32(word32(i, key)) * np.float32(2.0**-32))
        v[np.uint64(start + i)] = place if i < cells else -np.float32(np.inf)


@compiled
def in_own_units(v, start, cells, constants):
    """Take potentials into the units in which all cells have one threshold."""
    if constants is None:
        return
    for j in range(start, start + cells):
        v[j] *= constants[FACTOR][j] if v[j] >= 0 else ONE


@compiled
def refresh(counts, start, cells, key):
    """Draw the words that serve the next four ticks, as ones a byte, the next tick's lowest."""
    for i in range(cells & WHOLE):
        counts[np.uint64(start + i)] = word32(i, key)
    ones = counts.view(np.uint8)
    for i in range(4 * (cells & WHOLE)):
        j = np.uint64(4 * start + i)
        ones[j] = ones8(ones[j])


@compiled
def next_byte(counts, start, cells):
    """Bring the noise of the next tick down, where ticks are taken one by one."""
    for i in range(cells & WHOLE):
        counts[np.uint64(start + i)] >>= np.uint32(8)


@compiled
def _noted(fired, mark, t, spike, marks):
    """Count a spike of tick t, or mark it if there are marks."""
    if marks is None:
        return tuple_setitem(fired, t, count(fired[t], spike)), mark
    return fired, bit(mark, t, spike)


@numba.njit(inline="always")
def _lif(old, moved, threshold, refractory):
    """Return the next state of an integrate-and-fire cell, and whether it fires."""
    new = choose(old < WAITING, old + WAIT, moved)
    spike = new >= threshold
    return choose(spike, refractory, new), spike


@compiled
def lif_identical(
    v, counts, start, cells, ticks, decay, mean_step, noise_step, threshold, refractory, marks
):
    """Advance integrate-and-fire cells that differ in noise alone.

    v is measured from the reset: ``v decay + (mean_step + noise_step * ones)``, waiting cells
    apart: the bracket does not wait for the tick before.
    """
    fired = NOBODY
    for i in range(cells & WHOLE):
        j, mark = np.uint64(start + i), UNMARKED
        x, word = v[j], counts[j]
        for t in range(len(ticks)):
            moved = fused(x, decay, fused(noise_step, ones_at(word, t), mean_step[t]))
            x, spike = _lif(x, moved, threshold, refractory)
            fired, mark = _noted(fired, mark, t, spike, marks)
        v[j] = x
        if marks is not None:
            marks[np.uint64(i)] = mark
    return fired


@compiled
def lif_varied(v, counts, start, cells, ticks, common, x, constants, threshold, refractory, marks):
    """Advance integrate-and-fire cells with constants each; with inputs x, or all with the common.

    v is in units in which all cells have one threshold.
    """
    if constants is None:
        return NOBODY
    fired = NOBODY
    decay, rest, slope, noise_step = constants[0], constants[1], constants[2], constants[NOISE_STEP]
    for i in range(cells & WHOLE):
        c, j, mark = np.uint64(i), np.uint64(start + i), UNMARKED
        y, word = v[j], counts[j]
        for t in range(len(ticks)):
            heard = common[t] if x is None else x[t, c]
            mean_step = fused(noise_step[j], ones_at(word, t), fused(slope[j], heard, rest[j]))
            y, spike = _lif(y, fused(y, decay[j], mean_step), threshold, refractory)
            fired, mark = _noted(fired, mark, t, spike, marks)
        v[j] = y
        if marks is not None:
            marks[c] = mark
    return fired


@numba.njit(inline="always")
def _phase(old, mean_step):
    """Return the next phase of a cell, and whether it fires: it shows that until the next tick."""
    new = (old - choose(old >= ONE, ONE, ZERO)) + mean_step
    return new, new >= ONE


@compiled
def phase_identical(v, counts, start, cells, ticks, mean_step, noise_step, marks):
    """Advance phases that differ in noise alone."""
    fired = NOBODY
    for i in range(cells & WHOLE):
        j, mark = np.uint64(start + i), UNMARKED
        x, word = v[j], counts[j]
        for t in range(len(ticks)):
            x, spike = _phase(x, fused(noise_step[t], ones_at(word, t), mean_step[t]))
            fired, mark = _noted(fired, mark, t, spike, marks)
        v[j] = x
        if marks is not None:
            marks[np.uint64(i)] = mark
    return fired


@compiled
def phase_varied(v, counts, start, cells, ticks, mean, root, x, constants, each, marks):
    """Advance phases with an expected advance each: x, or the mean times the cell's factor.

    The jitter of an advance m is ``each sqrt(m)``; root is that of the mean, and a cell's noise
    step ``each`` times the root of its factor.
    """
    if constants is None:
        return NOBODY
    fired = NOBODY
    noise_step, factor = constants[NOISE_STEP], constants[FACTOR]
    for i in range(cells & WHOLE):
        c, j, mark = np.uint64(i), np.uint64(start + i), UNMARKED
        y, word = v[j], counts[j]
        for t in range(len(ticks)):
            m = mean[t] * factor[j] if x is None else x[t, c]
            width = root[t] * noise_step[j] if x is None else each * np.sqrt(m)
            mean_step = fused(width, ones_at(word, t), m - HALF_BITS * width)
            y, spike = _phase(y, mean_step)
            fired, mark = _noted(fired, mark, t, spike, marks)
        v[j] = y
        if marks is not None:
            marks[c] = mark
    return fired


@compiled
def filtered(x, start, cells, decay, gain, wanted):
    """Filter the inputs of cells in place: ``x = decay x + gain wanted``."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        x[j] = fused(decay, x[j], gain * wanted[np.uint64(i)])


@compiled
def marked(marks, cells, found, most, places, found_n):
    """List the cells with each of four marks, at four places; return how many there are."""
    if marks is None:
        return NOBODY
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


@numba.njit(inline="always")
def add_row(sums, connections, row, cells):
    """Add the connections of one spike, a row of bits, to the target cells' counts, a byte each.

    Bit ``8 i + k`` of a word stands for cell ``8 k + i`` of its 64.
    """
    eight = sums.view(np.uint64)
    for m in range(cells // LANES):
        add_bits(eight, np.uint64(8 * m), connections[np.uint64(row + m)])


@compiled
def arrive(u, start, sums, cells, jump):
    """Add what arrived to the filters of cells, and empty the counts."""
    for i in range(cells & WHOLE):
        j = np.uint64(start + i)
        u[j] = fused(jump, np.float32(sums[np.uint64(i)]), u[j])
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
        own = fused(other, u[np.uint64(second + i)], weight * u[np.uint64(first + i)])
        x[np.uint64(i)] = common + own


@compiled
def more_inputs(x, cells, u, first, weight):
    """Add a filter to the input x of each cell."""
    for i in range(cells & WHOLE):
        j = np.uint64(i)
        x[j] = fused(weight, u[np.uint64(first + i)], x[j])
