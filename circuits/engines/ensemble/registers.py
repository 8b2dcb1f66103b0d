"""Registers of cells: the numbers of neighbouring cells as one value of compiled code.

A loop over registers is written as if for one cell; operations act on each number and round in the
same way. A register spans several of the processor's, which are computed in parallel.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import functools
import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from circuits.dynamics import noise

WIDTH = 64
"""Numbers in a register; a 64-bit word has one boolean for each."""
_I32, _I64 = ir.IntType(32), ir.IntType(64)


class Register(types.Type):
    """The type of a register of numbers of one kind."""

    def __init__(self, name, element):
        self.element = element
        super().__init__(name=f"Register({name})")


FLOATS = Register("floats", ir.FloatType())
WORDS = Register("words", _I32)
TRUTHS = Register("truths", ir.IntType(1))


def _vector(element):
    return ir.VectorType(element, WIDTH)


@register_model(Register)
class _RegisterModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _vector(kind.element))


def _each(value):
    return ir.Constant(_vector(_I32), [value] * WIDTH)


def _spread(builder, value):
    kind = _vector(value.type)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), _each(0))


def _named(builder, name, *values):
    """Call an LLVM function of vectors by its name."""
    kind = ir.FunctionType(values[0].type, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _pointer(context, builder, kind, array, place, target):
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), target.as_pointer())


def instruction(result, *kinds):
    """Return a decorator that turns a function of a builder and LLVM values into compiled code.

    Parameters
    ----------
    result, *kinds : types.Type
        Types of its result, and of its arguments after the builder.
    """

    def made(emit):
        @intrinsic
        @functools.wraps(emit)
        def typed(typing, *given):
            return result(*kinds), lambda _, builder, __, values: emit(builder, *values)

        return typed

    return made


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


@instruction(FLOATS, types.float32)
def spread(builder, value):
    """Return a register of one number."""
    return _spread(builder, value)


@intrinsic
def load(typing, array, place):
    """Return the numbers of an array from a place on."""

    def build(context, builder, signature, arguments):
        array, place = arguments
        target = _vector(FLOATS.element)
        pointer = _pointer(context, builder, signature.args[0], array, place, target)
        return builder.load(pointer, align=4)

    return FLOATS(array, types.uint64), build


@intrinsic
def store(typing, array, place, value):
    """Write numbers to an array from a place on."""

    def build(context, builder, signature, arguments):
        array, place, value = arguments
        pointer = _pointer(context, builder, signature.args[0], array, place, value.type)
        builder.store(value, pointer, align=4)

    return types.void(array, types.uint64, FLOATS), build


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
        kind = _vector(ir.IntType(8))
        pointer = _pointer(context, builder, signature.args[0], marks, place, kind)
        bit = builder.shl(ir.Constant(ir.IntType(8), 1), builder.trunc(t, ir.IntType(8)))
        found = builder.and_(builder.load(pointer, align=1), _spread(builder, bit))
        return builder.icmp_unsigned("!=", found, ir.Constant(kind, [0] * WIDTH))

    return TRUTHS(marks, types.uint64, types.int64), build


@instruction(WORDS, types.uint64, types.uint64)
def byte_counts(builder, index, key):
    """Return ``noise.byte_counts`` of the words of the cells from an index on, from a tick key."""
    high, low = high_half(builder, key), _spread(builder, builder.trunc(key, _I32))
    first = builder.mul(builder.trunc(index, _I32), ir.Constant(_I32, noise.GOLDEN_32))
    steps = [k * noise.GOLDEN_32 % 2**32 for k in range(WIDTH)]
    begin = _spread(builder, builder.add(first, high))
    x = lowbias32(builder, builder.add(begin, ir.Constant(low.type, steps)), low, _each)
    octets = builder.bitcast(x, ir.VectorType(ir.IntType(8), 4 * WIDTH))
    return builder.bitcast(_named(builder, f"llvm.ctpop.v{4 * WIDTH}i8", octets), x.type)


@instruction(WORDS, WORDS, types.int64)
def later(builder, counts, byte):
    """Return counts shifted so that those of a byte are in the lowest byte."""
    return builder.lshr(counts, _spread(builder, bits_before(builder, byte)))


@instruction(FLOATS, WORDS, types.int64)
def ones_in(builder, counts, byte):
    """Return the counts of a byte times ``256**byte``, which needs no shift."""
    here = builder.shl(ir.Constant(_I32, 15), bits_before(builder, byte))
    return builder.sitofp(builder.and_(counts, _spread(builder, here)), _vector(FLOATS.element))


@instruction(FLOATS, FLOATS, FLOATS, FLOATS)
def multiply_add(builder, a, b, c):
    """Return ``a b + c``, rounded once."""
    return _named(builder, f"llvm.fma.v{WIDTH}f32", a, b, c)


@instruction(FLOATS, FLOATS)
def root(builder, x):
    """Return the square root."""
    return _named(builder, f"llvm.sqrt.v{WIDTH}f32", x)


@instruction(FLOATS, TRUTHS, FLOATS, FLOATS)
def where(builder, truths, yes, no):
    """Return ``yes`` where it is true, ``no`` elsewhere."""
    return builder.select(truths, yes, no)


def _operator(symbol, result, build):
    """Define an operator for two registers."""

    @instruction(result, FLOATS, FLOATS)
    def combined(builder, a, b):
        return build(builder, a, b)

    @overload(symbol)
    def of_registers(a, b):
        return (lambda a, b: combined(a, b)) if a == b == FLOATS else None


_operator(operator.add, FLOATS, ir.IRBuilder.fadd)
_operator(operator.sub, FLOATS, ir.IRBuilder.fsub)
_operator(operator.mul, FLOATS, ir.IRBuilder.fmul)
_operator(operator.lt, TRUTHS, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_operator(operator.ge, TRUTHS, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
