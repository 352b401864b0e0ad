"""Similarity of pixels in bytes: the sum of absolute differences, truncated where nothing is alike any more.

``max(1 - sum_c |a_c - b_c| / (4 v), 0)`` falls from 1 to 0 about as the report's exponential does (section 3.2, Eqs. 3
and 4), and sixteen pixels of it are a dozen instructions. Integers make every sum exact, whatever its order.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from fpsboost.kernels.lanes import address_of, spread_value

SIXTEEN = 16
"""Pixels of a vector."""

WHITE = 255
"""The largest level."""

TRUNCATION = 4
"""Widths v of difference from which on two pixels are not alike at all."""

_BYTE, _BYTES = ir.IntType(8), ir.VectorType(ir.IntType(8), SIXTEEN)
_WORDS = ir.VectorType(ir.IntType(16), SIXTEEN)


def level_scale(v: float) -> float:
    """Levels of a component that ranges over 1: 255, or fewer where the truncation would be above that."""
    return WHITE * min(1.0, 1 / (TRUNCATION * v))


def truncation(v: float) -> int:
    """Levels of difference, all components together, from which on two pixels are not alike at all."""
    return max(1, round(TRUNCATION * v * level_scale(v)))


def compare_sixteen(first, place0, second, place1, plane, most, sums, before, after):
    """Write the sums of sixteen pixels plus the similarities, 0 to `most`, of sixteen pairs of pixels.

    Parameters
    ----------
    first, second : (size,) uint8
    place0, place1 : int
        Of the first pixel in the first of three planes; no bounds are checked.
    plane : int
        Distance of the planes.
    most : int
        What `truncation` gives.
    sums : (size,) uint16
        In and out.
    before, after : int
        Where the sixteen are read and written.
    """
    taken = first[place0:][:SIXTEEN], first[place0 + plane :][:SIXTEEN], first[place0 + 2 * plane :][:SIXTEEN]
    _compare(taken, second, place1, plane, most, sums, before, after)


def compare_one(first, place0, second, place1, plane, most, sums, before, after):
    """Like `compare_sixteen`, of one pixel and sixteen."""
    taken = first[place0], first[place0 + plane], first[place0 + 2 * plane]
    _compare(taken, second, place1, plane, most, sums, before, after)


def _compare(taken, second, place1, plane, most, sums, before, after):
    differences = sum(abs(second[place1 + c * plane :][:SIXTEEN].astype(int) - taken[c]) for c in range(3))
    sums[after : after + SIXTEEN] = sums[before : before + SIXTEEN] + (most - differences).clip(0)


def _signature(first, second, sums):
    place = types.int64
    return types.void(first, place, second, place, place, types.uint8, sums, place, place)


@intrinsic
def _vector_pairs(typing, first, place0, second, place1, plane, most, sums, before, after):
    """The processor's own instructions, pixel by pixel."""

    def emit(context, builder, signature, arguments):
        return _emit(context, builder, signature, arguments, one=False)

    return _signature(first, second, sums), emit


@intrinsic
def _vector_one(typing, first, place0, second, place1, plane, most, sums, before, after):
    """The same with one pixel against all."""

    def emit(context, builder, signature, arguments):
        return _emit(context, builder, signature, arguments, one=True)

    return _signature(first, second, sums), emit


def _emit(context, builder, signature, arguments, *, one):
    first, place0, second, place1, plane, most, sums, before, after = arguments
    kind0, kind1, kind_sums = signature.args[0], signature.args[2], signature.args[6]

    def call(name, *values):
        function = ir.FunctionType(_BYTES, [_BYTES] * 2)
        return builder.call(
            cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.v{SIXTEEN}i8"), values
        )

    differences = None
    for _ in range(3):
        if one:
            a = spread_value(builder, builder.load(address_of(context, builder, kind0, first, place0, _BYTE)), _BYTES)
        else:
            a = builder.load(address_of(context, builder, kind0, first, place0, _BYTES), align=1)
        b = builder.load(address_of(context, builder, kind1, second, place1, _BYTES), align=1)
        apart = builder.sub(call("umax", a, b), call("umin", a, b))
        differences = apart if differences is None else call("uadd.sat", differences, apart)
        place0, place1 = builder.add(place0, plane), builder.add(place1, plane)
    alike = builder.zext(call("usub.sat", spread_value(builder, most, _BYTES), differences), _WORDS)
    known = builder.load(address_of(context, builder, kind_sums, sums, before, _WORDS), align=2)
    builder.store(builder.add(known, alike), address_of(context, builder, kind_sums, sums, after, _WORDS), align=2)
    return context.get_dummy_value()


@overload(compare_sixteen, inline="always")
def _compiled_pairs(first, place0, second, place1, plane, most, sums, before, after):
    """What `compare_sixteen` is within kernels."""

    def compiled(first, place0, second, place1, plane, most, sums, before, after):
        _vector_pairs(first, place0, second, place1, plane, most, sums, before, after)

    return compiled


@overload(compare_one, inline="always")
def _compiled_one(first, place0, second, place1, plane, most, sums, before, after):
    """What `compare_one` is within kernels."""

    def compiled(first, place0, second, place1, plane, most, sums, before, after):
        _vector_one(first, place0, second, place1, plane, most, sums, before, after)

    return compiled
