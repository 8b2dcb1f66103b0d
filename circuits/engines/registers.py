"""Registers: the numbers of neighbouring cells, or trials, as one value of compiled code.

A loop over registers is written as if for one cell or trial; operations act on each number and
round in the same way. A register spans several of the processor's, which are computed in parallel.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import operator
from functools import partial, wraps

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from circuits.dynamics import noise
from circuits.engines.memory import CACHE_LINE

WIDTH = 64
"""Numbers in a register of cells; a 64-bit word has one boolean for each."""
TRIALS = CACHE_LINE
"""Numbers in a register of trials."""
_I32, _I64 = ir.IntType(32), ir.IntType(64)


class Register(types.Type):
    """The type of a register of numbers of one kind."""

    def __init__(self, name, element, width):
        self.element, self.width = element, width
        super().__init__(name=f"Register({name}, {width})")

    @property
    def vector(self):
        """Return the LLVM vector that holds the register."""
        return ir.VectorType(self.element, self.width)


def _kinds(width):
    """Return the types of registers of floats, of words and of truth values."""
    elements = {"floats": ir.FloatType(), "words": _I32, "truths": ir.IntType(1)}
    return [Register(name, element, width) for name, element in elements.items()]


_KINDS = {width: _kinds(width) for width in (WIDTH, TRIALS)}
FLOATS, WORDS, TRUTHS = _KINDS[WIDTH]
FLOATS_OF_TRIALS, WORDS_OF_TRIALS, _ = _KINDS[TRIALS]


@register_model(Register)
class _RegisterModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.vector)


def _each(width):
    """Return a function that makes a register of one constant."""
    return lambda value: ir.Constant(ir.VectorType(_I32, width), [value] * width)


def _spread(builder, value, width):
    kind = ir.VectorType(value.type, width)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), _each(width)(0))


def _named(builder, name, *values):
    kind = ir.FunctionType(values[0].type, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _pointer(context, builder, kind, array, place, target):
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), target.as_pointer())


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


def elementwise(emit):
    """Turn a function of a builder and LLVM values into code for registers of any width.

    The result has the type of the first argument after the builder.
    """

    @intrinsic
    @wraps(emit)
    def typed(typing, *operands):
        return operands[0](*operands), lambda _, builder, __, values: emit(builder, *values)

    return typed


def lowbias32(builder, x, low, each):
    """Return the words of ``noise.words``; ``each`` makes a constant with the width of x."""
    x = builder.xor(x, builder.lshr(x, each(16)))
    x = builder.add(builder.mul(x, each(noise.FIRST)), low)
    x = builder.xor(x, builder.lshr(x, each(15)))
    x = builder.mul(x, each(noise.SECOND))
    return builder.xor(x, builder.lshr(x, each(15)))


def high_half(builder, key):
    """Return the upper 32 bits of a key."""
    return builder.trunc(builder.lshr(key, ir.Constant(key.type, 32)), _I32)


def bits_before(builder, byte):
    """Return the number of bits below a byte of a word."""
    return builder.shl(builder.trunc(byte, _I32), ir.Constant(_I32, 3))


def _spreading(kind):
    @instruction(kind, types.float32)
    def spread(builder, value):
        return _spread(builder, value, kind.width)

    return spread


def _loading(kind):
    @intrinsic
    def load(typing, array, place):
        def build(context, builder, signature, arguments):
            array, place = arguments
            pointer = _pointer(context, builder, signature.args[0], array, place, kind.vector)
            return builder.load(pointer, align=4)

        return kind(array, types.uint64), build

    return load


spread, load = _spreading(FLOATS), _loading(FLOATS)
spread_trials, load_trials = _spreading(FLOATS_OF_TRIALS), _loading(FLOATS_OF_TRIALS)
load_words = _loading(WORDS_OF_TRIALS)


@intrinsic
def store(typing, array, place, value):
    """Write numbers to an array from a place on."""

    def build(context, builder, signature, arguments):
        array, place, value = arguments
        pointer = _pointer(context, builder, signature.args[0], array, place, value.type)
        builder.store(value, pointer, align=4)

    return types.void(array, types.uint64, value), build


@intrinsic
def store_past(typing, array, place, value):
    """Write a cache line of numbers without caching it, since it is not read again soon.

    The array must be from ``on_cache_lines`` and the place a multiple of a line, or the process
    crashes.
    """

    def build(context, builder, signature, arguments):
        array, place, value = arguments
        pointer = _pointer(context, builder, signature.args[0], array, place, value.type)
        written = builder.store(value, pointer, align=64)
        written.set_metadata("nontemporal", builder.module.add_metadata([_I32(1)]))

    return types.void(array, types.uint64, value), build


@intrinsic
def take_number(typing, next_number):
    """Return the number in an array of one and raise it by 1, so that each thread gets its own."""

    def build(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, *arguments).data
        return builder.atomic_rmw("add", data, _I64(1), "monotonic")

    return types.int64(next_number), build


@intrinsic
def note(typing, bits, place, truths):
    """Write truth values, one bit each, to a word of an array of 64-bit words."""

    def build(context, builder, signature, arguments):
        bits, place, truths = arguments
        pointer = _pointer(context, builder, signature.args[0], bits, place, _I64)
        builder.store(builder.bitcast(truths, _I64), pointer)

    return types.void(bits, types.uint64, TRUTHS), build


@intrinsic
def marked(typing, marks, place, t):
    """Return whether bit t is set in the marks, one byte each, from a place on."""

    def build(context, builder, signature, arguments):
        marks, place, t = arguments
        kind = ir.VectorType(ir.IntType(8), WIDTH)
        pointer = _pointer(context, builder, signature.args[0], marks, place, kind)
        bit = builder.shl(ir.Constant(ir.IntType(8), 1), builder.trunc(t, ir.IntType(8)))
        selected = builder.and_(builder.load(pointer, align=1), _spread(builder, bit, WIDTH))
        return builder.icmp_unsigned("!=", selected, ir.Constant(kind, [0] * WIDTH))

    return TRUTHS(marks, types.uint64, types.int64), build


def _octets_counted(builder, words):
    """Return the number of ones in each byte of words, in the place of that byte."""
    count = 4 * words.type.count
    octets = builder.bitcast(words, ir.VectorType(ir.IntType(8), count))
    return builder.bitcast(_named(builder, f"llvm.ctpop.v{count}i8", octets), words.type)


@instruction(WORDS, types.uint64, types.uint64)
def byte_counts(builder, index, key):
    """Return ``noise.byte_counts`` of the words of the cells from an index on, from a tick key."""
    high, low = high_half(builder, key), _spread(builder, builder.trunc(key, _I32), WIDTH)
    first = builder.mul(builder.trunc(index, _I32), ir.Constant(_I32, noise.GOLDEN_32))
    steps = [k * noise.GOLDEN_32 % 2**32 for k in range(WIDTH)]
    begin = _spread(builder, builder.add(first, high), WIDTH)
    begin = builder.add(begin, ir.Constant(low.type, steps))
    return _octets_counted(builder, lowbias32(builder, begin, low, _each(WIDTH)))


@instruction(WORDS_OF_TRIALS, types.int64, WORDS_OF_TRIALS, WORDS_OF_TRIALS)
def byte_counts_of_trials(builder, index, high, low):
    """Return ``noise.byte_counts`` of one word in each trial, from the halves of its tick key."""
    first = builder.mul(builder.trunc(index, _I32), ir.Constant(_I32, noise.GOLDEN_32))
    begin = builder.add(_spread(builder, first, TRIALS), high)
    return _octets_counted(builder, lowbias32(builder, begin, low, _each(TRIALS)))


@elementwise
def later(builder, counts, byte):
    """Return counts shifted so that those of a byte are in the lowest byte."""
    return builder.lshr(counts, _spread(builder, bits_before(builder, byte), counts.type.count))


@intrinsic
def ones_in(typing, counts, byte):
    """Return the counts of a byte times ``256**byte``, which needs no shift."""

    def build(_, builder, signature, arguments):
        counts, byte = arguments
        here = builder.shl(ir.Constant(_I32, 15), bits_before(builder, byte))
        masked = builder.and_(counts, _spread(builder, here, counts.type.count))
        return builder.sitofp(masked, signature.return_type.vector)

    return _KINDS[counts.width][0](counts, byte), build


@elementwise
def multiply_add(builder, a, b, c):
    """Return ``a b + c``, rounded once."""
    return _named(builder, f"llvm.fma.v{a.type.count}f32", a, b, c)


@elementwise
def root(builder, x):
    """Return the square root."""
    return _named(builder, f"llvm.sqrt.v{x.type.count}f32", x)


@elementwise
def least(builder, x, other):
    """Return the smaller of two numbers; ``other`` where x is not a number."""
    return builder.select(builder.fcmp_ordered("<", x, other), x, other)


@elementwise
def most(builder, x, other):
    """Return the larger of two numbers; ``other`` where x is not a number."""
    return builder.select(builder.fcmp_ordered(">", x, other), x, other)


@intrinsic
def interpolated(typing, at, within, points):
    """Interpolate a row of an array linearly at positions, between points chosen by ``within``.

    ``within`` are the positions, limited to 0 and the length of the row - 2.
    """

    def build(context, builder, signature, arguments):
        at, within, points = arguments
        kind, width = at.type, at.type.count
        below = builder.fptosi(within, ir.VectorType(_I32, width))
        data = context.make_array(signature.args[2])(context, builder, points).data
        ends = [ir.Constant(kind, ir.Undefined)] * 2
        for lane in map(_I32, range(width)):
            index = builder.zext(builder.extract_element(below, lane), _I64)
            for ahead in (0, 1):
                point = builder.gep(data, [builder.add(index, _I64(ahead))])
                value = builder.load(point, align=4)
                ends[ahead] = builder.insert_element(ends[ahead], value, lane)
        share = builder.fsub(at, builder.sitofp(below, kind))
        rise = builder.fsub(ends[1], ends[0])
        return _named(builder, f"llvm.fma.v{width}f32", share, rise, ends[0])

    return at(at, within, points), build


def _picks(lanes):
    return ir.Constant(ir.VectorType(_I32, len(lanes)), lanes)


def _exchanged(builder, rows, apart):
    """Return rows in which each pair has exchanged the lanes that are ``apart`` (one stage)."""
    width, rows = len(rows), list(rows)
    for i in range(width):
        if not i & apart:
            a, b = rows[i], rows[i + apart]
            firsts = [width + k - apart if k & apart else k for k in range(width)]
            others = [width + k if k & apart else k + apart for k in range(width)]
            rows[i] = builder.shuffle_vector(a, b, _picks(firsts))
            rows[i + apart] = builder.shuffle_vector(a, b, _picks(others))
    return rows


def _transpose(builder, rows, pointer):
    """Exchange rows and columns of registers, and store them one after the other."""
    apart = len(rows) // 2
    while apart:
        rows = _exchanged(builder, rows, apart)
        apart //= 2
    for number, row in enumerate(rows):
        builder.store(row, pointer(_I64(number * len(rows)), row.type), align=4)


@intrinsic
def look_up_rows(typing, table, places, numbers):
    """Write a row of a flat table for each lane, and each number of it to a row of ``numbers``.

    Rows have as many numbers as there are lanes; ``places`` is where each lane's row begins.
    ``numbers`` holds the first number of every lane, then the second, and so on.
    """

    def build(context, builder, signature, arguments):
        table, places, numbers = arguments
        at = context.make_array(signature.args[1])(context, builder, places).data
        target, kind = signature.args[2], FLOATS_OF_TRIALS.vector
        rows = []
        for lane in range(TRIALS):
            place = builder.load(builder.gep(at, [_I64(lane)]))
            pointer = _pointer(context, builder, signature.args[0], table, place, kind)
            rows.append(builder.load(pointer, align=4))
        _transpose(builder, rows, partial(_pointer, context, builder, target, numbers))

    return types.void(table, places, numbers), build


@intrinsic
def transpose(typing, values, place, columns):
    """Exchange rows and columns of a square of numbers, one row after the other from a place on."""

    def build(context, builder, signature, arguments):
        values, place, columns = arguments
        kind, rows = FLOATS_OF_TRIALS.vector, []
        for lane in range(TRIALS):
            row = builder.add(place, _I64(lane * TRIALS))
            pointer = _pointer(context, builder, signature.args[0], values, row, kind)
            rows.append(builder.load(pointer, align=4))
        target = signature.args[2]
        _transpose(builder, rows, partial(_pointer, context, builder, target, columns))

    return types.void(values, types.int64, columns), build


@intrinsic
def where(typing, truths, yes, no):
    """Return ``yes`` where it is true, ``no`` elsewhere."""
    return yes(truths, yes, no), lambda _, builder, __, values: builder.select(*values)


def _operator(symbol, build, *, compares=False):
    """Define an operator for two registers of one width."""

    @intrinsic
    def combined(typing, a, b):
        result = _KINDS[a.width][2] if compares else a
        return result(a, b), lambda _, builder, __, values: build(builder, *values)

    @overload(symbol)
    def of_registers(a, b):
        both = isinstance(a, Register) and a == b
        return (lambda a, b: combined(a, b)) if both else None


_operator(operator.add, ir.IRBuilder.fadd)
_operator(operator.sub, ir.IRBuilder.fsub)
_operator(operator.mul, ir.IRBuilder.fmul)
_operator(operator.lt, lambda builder, a, b: builder.fcmp_ordered("<", a, b), compares=True)
_operator(operator.ge, lambda builder, a, b: builder.fcmp_ordered(">=", a, b), compares=True)
