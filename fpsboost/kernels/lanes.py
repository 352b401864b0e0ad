"""Four-tap filters on eight pixels at once, for loops so short that the compiler would leave them scalar."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

EIGHT = 8
"""Pixels of a vector."""

_VECTOR = ir.VectorType(ir.FloatType(), EIGHT)
_FMA = ir.FunctionType(_VECTOR, [_VECTOR] * 3)


def filter_eight(source, begin, step, w0, w1, w2, w3, out, target):
    """Write ``w0 s[0] + w1 s[1] + w2 s[2] + w3 s[3]`` of eight pixels, where ``s[n]`` begins `n` steps on.

    Parameters
    ----------
    source : (size,) float32
    begin, step : int
        The first pixel's first value, and the distance to its next; no bounds are checked.
    w0, w1, w2, w3 : float32
    out : (size,) float32 out
    target : int
        Where the eight begin.
    """
    taps = [source[begin + n * step :][:EIGHT] for n in range(4)]
    out[target : target + EIGHT] = w0 * taps[0] + w1 * taps[1] + w2 * taps[2] + w3 * taps[3]


@intrinsic
def _vector_filter(typing, source, begin, step, w0, w1, w2, w3, out, target):
    """The processor's own instructions."""
    return types.void(source, types.int64, types.int64, *(types.float32,) * 4, out, types.int64), _emit


def _emit(context, builder, signature, arguments):
    source, begin, step, *weights, out, target = arguments
    fma = cgutils.get_or_insert_function(builder.module, _FMA, f"llvm.fma.v{EIGHT}f32")
    sums = None
    for weight in weights:
        values = builder.load(address_of(context, builder, signature.args[0], source, begin, _VECTOR), align=4)
        spread = spread_value(builder, weight, _VECTOR)
        sums = builder.fmul(values, spread) if sums is None else builder.call(fma, [values, spread, sums])
        begin = builder.add(begin, step)
    builder.store(sums, address_of(context, builder, signature.args[7], out, target, _VECTOR), align=4)
    return context.get_dummy_value()


def address_of(context, builder, kind, array, index, element):
    """Of an element of a flat array of type `kind`, as a pointer to the LLVM type `element`."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def spread_value(builder, value, vector):
    """A vector of type `vector` with one value in all places."""
    integer = ir.IntType(32)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(integer, 0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(integer, vector.count), [0] * vector.count))


@overload(filter_eight, inline="always")
def _compiled(source, begin, step, w0, w1, w2, w3, out, target):
    """What `filter_eight` is within kernels."""

    def compiled(source, begin, step, w0, w1, w2, w3, out, target):
        _vector_filter(source, begin, step, w0, w1, w2, w3, out, target)

    return compiled
