"""Lists of the most similar offsets of eight points at once, in vector instructions."""

from __future__ import annotations

from llvmlite import ir

from fpsboost.kernels.jit import cgutils, intrinsic, overload, types
from fpsboost.kernels.lanes import EIGHT, address_of, broadcast_value

VALUES_PER_ENTRY = 3
"""Number of values per entry: similarity, dx, dy."""

NOTHING, NOWHERE = -2.0, 1e6
"""Similarity and offset of an empty entry."""

_FLOATS, _INTEGERS = ir.VectorType(ir.FloatType(), EIGHT), ir.VectorType(ir.IntType(32), EIGHT)


def insert_eight(dx, dy, similarities, at, lists, size, capacity):
    """Insert an offset into the lists of eight points, sorted by decreasing similarity.

    Of neighbouring offsets, only the more similar one is kept.

    Parameters
    ----------
    dx, dy : float32
    similarities : (size,) float32
        Similarity of the offset at every point.
    at : int
        Index of the first of the eight points; no bounds are checked.
    lists : (capacity * VALUES_PER_ENTRY * size,) float32
        Ordered by entry, value and point; empty entries last, with NOTHING and NOWHERE. Updated in place.
    size, capacity : int
        Number of points, and of entries per list.
    """
    for point in range(at, at + EIGHT):
        held = [similarities[point], dx, dy]
        for entry in range(capacity):
            places = [(entry * VALUES_PER_ENTRY + number) * size + point for number in range(VALUES_PER_ENTRY)]
            before = [lists[place] for place in places]
            if similarities[point] > before[0]:
                for place, number in zip(places, held, strict=True):
                    lists[place] = number
                held = before
            if abs(before[1] - dx) <= 1 and abs(before[2] - dy) <= 1:
                break


@intrinsic
def _insert_eight(typing, dx, dy, similarities, at, lists, size, capacity):
    place, number = types.int64, types.float32
    return types.void(number, number, similarities, place, lists, place, place), _emit


def _emit(context, builder, signature, arguments):
    dx, dy, similarities, at, lists, size, capacity = arguments
    fabs = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_FLOATS, [_FLOATS]), f"llvm.fabs.v{EIGHT}f32")
    one = ir.Constant(_FLOATS, [1.0] * EIGHT)

    def address(number, array, index):
        return address_of(context, builder, signature.args[number], array, index, _FLOATS)

    def is_near(numbers, number):
        apart = builder.fsub(numbers, broadcast_value(builder, number, _FLOATS))
        return builder.fcmp_ordered("<=", builder.call(fabs, [apart]), one)

    def any_of(mask):
        bits = builder.bitcast(mask, ir.IntType(EIGHT))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    value = builder.load(address(2, similarities, at), align=4)
    entry = builder.mul(size, ir.Constant(size.type, VALUES_PER_ENTRY))
    last = builder.add(at, builder.mul(entry, builder.sub(capacity, ir.Constant(capacity.type, 1))))
    least = builder.load(address(4, lists, last), align=4)
    with builder.if_then(any_of(builder.fcmp_ordered(">", value, least))):
        new = [value, *(broadcast_value(builder, each, _FLOATS) for each in (dx, dy))]
        held = [cgutils.alloca_once_value(builder, each) for each in new]
        open_ = ir.VectorType(ir.IntType(1), EIGHT)
        is_open = cgutils.alloca_once_value(builder, ir.Constant(open_, [1] * EIGHT))
        begin = cgutils.alloca_once_value(builder, at)
        with cgutils.for_range(builder, capacity):
            index = builder.load(begin)
            addresses = []
            for number in range(VALUES_PER_ENTRY):
                shift = builder.mul(size, ir.Constant(size.type, number))
                addresses.append(address(4, lists, builder.add(index, shift)))
            before = [builder.load(each, align=4) for each in addresses]
            goes_on = builder.load(is_open)
            writes = builder.and_(goes_on, builder.fcmp_ordered(">", value, before[0]))
            for where, known, waiting in zip(addresses, before, held, strict=True):
                moved = builder.load(waiting)
                builder.store(builder.select(writes, moved, known), where, align=4)
                builder.store(builder.select(writes, known, moved), waiting)
            near = builder.and_(is_near(before[1], dx), is_near(before[2], dy))
            builder.store(builder.and_(goes_on, builder.not_(near)), is_open)
            builder.store(builder.add(index, entry), begin)
    return context.get_dummy_value()


@overload(insert_eight)
def _compiled(dx, dy, similarities, at, lists, size, capacity):
    """Return the implementation of `insert_eight` within kernels."""

    def compiled(dx, dy, similarities, at, lists, size, capacity):
        _insert_eight(dx, dy, similarities, at, lists, size, capacity)

    return compiled
