"""Similarity of 8-bit pixels: one minus the sum of absolute differences, truncated at 0.

``max(1 - sum_c |a_c - b_c| / (4 v), 0)`` falls from 1 to 0 approximately as the report's exponential does (section 3.2,
Eqs. 3 and 4; v is the bandwidth), and takes a dozen instructions for sixteen pixels. Integers make every sum exact,
whatever its order.
"""

from __future__ import annotations

from llvmlite import ir

from fpsboost.kernels.jit import cgutils, intrinsic, overload, types
from fpsboost.kernels.lanes import address_of, broadcast_value

SIXTEEN = 16
"""Pixels per vector."""

WHITE = 255
"""Largest level."""

TRUNCATION = 4
"""Sum of absolute differences, in units of the bandwidth, at which the similarity reaches 0."""

_BYTE, _BYTES = ir.IntType(8), ir.VectorType(ir.IntType(8), SIXTEEN)
_WORDS = ir.VectorType(ir.IntType(16), SIXTEEN)


def level_scale(bandwidth: float) -> float:
    """Return the levels of a component that ranges over 1: 255, or fewer if the truncation would exceed 255."""
    return WHITE * min(1.0, 1 / (TRUNCATION * bandwidth))


def truncation(bandwidth: float) -> int:
    """Return the sum of absolute differences over all components, in levels, at which the similarity reaches 0."""
    return max(1, round(TRUNCATION * bandwidth * level_scale(bandwidth)))


def compare_sixteen(first, place0, second, place1, plane, most, sums, before, after):
    """Add the similarities, 0 to `most`, of sixteen pairs of pixels to the sums of sixteen pixels.

    Parameters
    ----------
    first, second : (size,) uint8
    place0, place1 : int
        Index of the first pixel in the first of three planes; no bounds are checked.
    plane : int
        Distance between planes.
    most : int
        Similarity of two equal pixels, as returned by `truncation`.
    sums : (size,) uint16
        Sums of similarities; updated in place.
    before, after : int
        Indices at which the sixteen sums are read and written.
    """
    taken = first[place0:][:SIXTEEN], first[place0 + plane :][:SIXTEEN], first[place0 + 2 * plane :][:SIXTEEN]
    _compare(taken, second, place1, plane, most, sums, before, after)


def compare_one(first, place0, second, place1, plane, most, sums, before, after):
    """Do the same as `compare_sixteen`, but compare one pixel with sixteen."""
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
    """Run `compare_sixteen` in vector instructions."""

    def emit(context, builder, signature, arguments):
        return _emit(context, builder, signature, arguments, one=False)

    return _signature(first, second, sums), emit


@intrinsic
def _vector_one(typing, first, place0, second, place1, plane, most, sums, before, after):
    """Run `compare_one` in vector instructions."""

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
            a = broadcast_value(
                builder, builder.load(address_of(context, builder, kind0, first, place0, _BYTE)), _BYTES
            )
        else:
            a = builder.load(address_of(context, builder, kind0, first, place0, _BYTES), align=1)
        b = builder.load(address_of(context, builder, kind1, second, place1, _BYTES), align=1)
        apart = builder.sub(call("umax", a, b), call("umin", a, b))
        differences = apart if differences is None else call("uadd.sat", differences, apart)
        place0, place1 = builder.add(place0, plane), builder.add(place1, plane)
    alike = builder.zext(call("usub.sat", broadcast_value(builder, most, _BYTES), differences), _WORDS)
    known = builder.load(address_of(context, builder, kind_sums, sums, before, _WORDS), align=2)
    builder.store(builder.add(known, alike), address_of(context, builder, kind_sums, sums, after, _WORDS), align=2)
    return context.get_dummy_value()


@overload(compare_sixteen)
def _compiled_pairs(first, place0, second, place1, plane, most, sums, before, after):
    """Return the implementation of `compare_sixteen` within kernels."""

    def compiled(first, place0, second, place1, plane, most, sums, before, after):
        _vector_pairs(first, place0, second, place1, plane, most, sums, before, after)

    return compiled


@overload(compare_one)
def _compiled_one(first, place0, second, place1, plane, most, sums, before, after):
    """Return the implementation of `compare_one` within kernels."""

    def compiled(first, place0, second, place1, plane, most, sums, before, after):
        _vector_one(first, place0, second, place1, plane, most, sums, before, after)

    return compiled
