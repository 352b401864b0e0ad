"""Sums of the similarity over patches, row after row, in the processor's own instructions.

The similarities of a row of pixels are summed across in registers as they are computed, and these sums are summed down
over the last rows, which are kept in a ring. Every sum is that of the patch whose last pixel it stands at, so that
nothing beyond need be known.

From the colours of a pixel to its sum is a long way, on which each instruction waits for the one before. So the loop
works on several vectors at a time, each at another stage of that way, and runs through the rows of several offsets
without a stop.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir

from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import LANES, cgutils, intrinsic, overload, types
from fpsboost.kernels.lanes import Loop, address_of, broadcast_value, vector_at
from fpsboost.kernels.similarity import COEFFICIENTS, MAX_SQUARED_DISTANCE, similarity

_FLOATS, _INTEGERS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)
_INDEX = ir.IntType(64)

STAGES = 5
"""Vectors on which the loop works at a time."""

GAP = (STAGES - 1) * LANES
"""Values before a row that are overwritten until the first vector has gone through all stages."""

ROWS_AT_ONCE = 6
"""Windows one below the other that share the reads of their rows."""


def slide_boxes(
    planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, ring, oldest, newest, totals, at
):
    """Move the sums over boxes down by one row, for neighbouring offsets.

    Parameters
    ----------
    planes0, planes1 : (values,) float32
        Scaled components, as for `fpsboost.kernels.similarity.similarity`.
    place0, plane0, place1, plane1 : int
        Index of the first pixel of the new row in the first of three planes, and distance between planes; no bounds
        are checked, and some pixels beyond the row are read.
    step : int
        Distance between the first pixels of two offsets in `planes1`.
    count : int
        Offsets.
    width : int
        Pixels per offset, a multiple of `LANES`.
    size : int
        Side of the box, pixels; a constant.
    ring : (values,) int32
        Sums across of the rows in the box, those of all offsets in line; updated in place.
    oldest, newest : int
        Index of the row to subtract, and that of the new row; `GAP` values before the new row are overwritten.
    totals : (values,) int32
        Sums over the boxes of all offsets in line; updated in place. Those at the first ``size - 1`` pixels of an
        offset, where no box ends, have no meaning, and the `GAP` values before are overwritten.
    at : int
        Index of the first sum.
    """
    for which in range(count):
        alike = np.zeros(width, np.int32)
        for x in range(width):
            pixels = [planes0[place0 + c * plane0 + x] for c in range(3)]
            pixels += [planes1[place1 + step * which + c * plane1 + x] for c in range(3)]
            alike[x] = similarity(*pixels)
            across, value = which * width + x, alike[max(x + 1 - size, 0) : x + 1].sum(dtype=np.int32)
            totals[at + across] += value - ring[oldest + across]
            ring[newest + across] = value


@intrinsic(prefer_literal=True)
def _slide_boxes(
    typing, planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, ring, oldest, newest, totals, at
):
    """Run `slide_boxes` in vector instructions."""
    i = types.int64
    return types.void(planes0, i, i, planes1, i, i, i, i, i, size, ring, i, i, totals, i), _emit_slide_boxes


def _emit_slide_boxes(context, builder, signature, arguments):
    *images, _, ring, oldest, newest, totals, at = arguments
    kinds = signature.args
    old_row, new_row, total_row = (
        _delayed_row(context, builder, kinds[number], array, index)
        for number, array, index in ((10, ring, oldest), (10, ring, newest), (13, totals, at))
    )

    def finish(loop, alike, place):
        across = _emit_box(builder, loop, alike, kinds[9].literal_value)
        old, total, new = (vector_at(builder, row, place, _INTEGERS) for row in (old_row, total_row, new_row))
        change = builder.sub(across, builder.load(old, align=4))
        builder.store(builder.add(builder.load(total, align=4), change), total, align=4)
        builder.store(across, new, align=4)

    _emit_rows(context, builder, kinds, images, finish)
    return context.get_dummy_value()


def sum_windows_across(
    planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, weights, ring, newest
):
    """Write the weighted sums across of a row of similarities, for neighbouring offsets.

    Parameters
    ----------
    planes0, place0, plane0, planes1, place1, plane1, step, count, width, size
        As for `slide_boxes`.
    weights : (size,) float32
        Symmetric.
    ring : (values,) float32 out
        Sums of all offsets in line.
    newest : int
        Index of the new row; `GAP` values before it are overwritten.
    """
    for which in range(count):
        alike = np.zeros(size - 1 + width, np.float32)
        for x in range(width):
            pixels = [planes0[place0 + c * plane0 + x] for c in range(3)]
            pixels += [planes1[place1 + step * which + c * plane1 + x] for c in range(3)]
            alike[size - 1 + x] = similarity(*pixels)
            value = _sum_symmetric(alike[x : x + size], weights, np.float32(0))
            ring[newest + which * width + x] = value


def _sum_symmetric(values, weights, first):
    """Return the sum of symmetrically weighted values and a first one, in the order of the instructions."""
    half = len(values) // 2
    total = fma(weights[half], values[half], first)
    for k in range(half):
        total = fma(weights[k], values[k] + values[len(values) - 1 - k], total)
    return total


@intrinsic(prefer_literal=True)
def _sum_windows_across(
    typing, planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, weights, ring, newest
):
    """Run `sum_windows_across` in vector instructions."""
    i = types.int64
    return types.void(planes0, i, i, planes1, i, i, i, i, i, size, weights, ring, i), _emit_sum_windows_across


def _emit_sum_windows_across(context, builder, signature, arguments):
    *images, _, weights, ring, newest = arguments
    kinds = signature.args
    size = kinds[9].literal_value
    new_row = _delayed_row(context, builder, kinds[11], ring, newest)
    factors = _broadcast_weights(context, builder, kinds[10], weights, size)

    def finish(loop, alike, place):
        values = builder.sitofp(alike, _FLOATS)
        shifted = [_shifted(builder, loop, values, pixels) for pixels in range(size)]
        across = _emit_symmetric(builder, shifted, factors, ir.Constant(_FLOATS, None))
        builder.store(across, vector_at(builder, new_row, place, _FLOATS), align=4)

    _emit_rows(context, builder, kinds, images, finish)
    return context.get_dummy_value()


def sum_windows_down(ring, start, slot, apart, weights, size, price, totals, at, totals_apart, width):
    """Write the weighted sums of `size` rows, minus a penalty, for `ROWS_AT_ONCE` windows one below the other.

    Parameters
    ----------
    ring : (values,) float32
        ``size + ROWS_AT_ONCE - 1`` rows.
    start, slot, apart : int
        Index of the first value in the first slot of the ring, the slot of the uppermost row, and distance between
        slots.
    weights : (size,) float32
        Symmetric.
    size : int
        A constant.
    price : float32
    totals : (values,) float32 out
    at, totals_apart : int
        Index of the first total of the uppermost window, and distance to that of the next one.
    width : int
        Totals of each window, a multiple of `LANES`.
    """
    slots = size + ROWS_AT_ONCE - 1
    for window in range(ROWS_AT_ONCE):
        for x in range(width):
            rows = [ring[start + (slot + window + k) % slots * apart + x] for k in range(size)]
            totals[at + window * totals_apart + x] = _sum_symmetric(rows, weights, -price)


@intrinsic(prefer_literal=True)
def _sum_windows_down(typing, ring, start, slot, apart, weights, size, price, totals, at, totals_apart, width):
    """Run `sum_windows_down` in vector instructions."""
    i = types.int64
    return types.void(ring, i, i, i, weights, size, types.float32, totals, i, i, i), _emit_sum_windows_down


def _emit_sum_windows_down(context, builder, signature, arguments):
    ring, start, slot, apart, weights, _, price, totals, at, totals_apart, width = arguments
    kinds = signature.args
    size = kinds[5].literal_value
    slots, rows, total_rows = ir.Constant(_INDEX, size + ROWS_AT_ONCE - 1), [], []
    for _ in range(size + ROWS_AT_ONCE - 1):
        index = builder.add(start, builder.mul(slot, apart))
        rows.append(address_of(context, builder, kinds[0], ring, index, ir.FloatType()))
        slot = builder.add(slot, ir.Constant(_INDEX, 1))
        slot = builder.select(builder.icmp_signed(">=", slot, slots), builder.sub(slot, slots), slot)
    for _ in range(ROWS_AT_ONCE):
        total_rows.append(address_of(context, builder, kinds[7], totals, at, ir.FloatType()))
        at = builder.add(at, totals_apart)
    factors = _broadcast_weights(context, builder, kinds[4], weights, size)
    first = broadcast_value(builder, builder.fneg(price), _FLOATS)
    loop = Loop(builder)
    x = loop.carry(ir.Constant(_INDEX, 0))
    values = [builder.load(vector_at(builder, row, x, _FLOATS), align=4) for row in rows]
    for window, total_row in enumerate(total_rows):
        total = _emit_symmetric(builder, values[window : window + size], factors, first)
        builder.store(total, vector_at(builder, total_row, x, _FLOATS), align=4)
    following = builder.add(x, ir.Constant(_INDEX, LANES))
    loop.follow(x, following)
    loop.end(builder.icmp_signed("<", following, width))
    return context.get_dummy_value()


def _emit_rows(context, builder, kinds, images, finish):
    """Run through the similarities of all offsets, with `finish` for each vector of them and its place in line."""
    planes0, place0, plane0, planes1, place1, plane1, step, count, width = images

    def rows(kind, array, place, plane):
        """Return the addresses of a row in three planes."""
        each = []
        for _ in range(3):
            each.append(address_of(context, builder, kind, array, place, ir.FloatType()))
            place = builder.add(place, plane)
        return each

    zero, lanes = ir.Constant(_INDEX, 0), ir.Constant(_INDEX, LANES)
    rows0, rows1 = rows(kinds[0], planes0, place0, plane0), rows(kinds[3], planes1, place1, plane1)
    end = builder.add(builder.mul(count, width), ir.Constant(_INDEX, GAP))
    loop = Loop(builder)
    place, x, shift = (loop.carry(zero) for _ in range(3))
    first = [vector_at(builder, row, x, _FLOATS) for row in rows0]
    second = [vector_at(builder, row, builder.add(x, shift), _FLOATS) for row in rows1]
    finish(loop, _emit_similarity(builder, loop, first, second), place)
    following = builder.add(x, lanes)
    over = builder.icmp_signed(">=", following, width)
    loop.follow(x, builder.select(over, zero, following))
    loop.follow(shift, builder.select(over, builder.add(shift, step), shift))
    following = builder.add(place, lanes)
    loop.follow(place, following)
    loop.end(builder.icmp_signed("<", following, end))


def _delayed_row(context, builder, kind, array, index):
    """Return the address of a row for the last stage, to which the first vector comes in round `STAGES`."""
    first = builder.sub(index, ir.Constant(_INDEX, GAP))
    return address_of(context, builder, kind, array, first, context.get_data_type(kind.dtype))


def _emit_similarity(builder, loop, first, second):
    """Return the similarities of the pixels whose components are at some addresses, ``STAGES - 1`` rounds later."""

    def constant(number):
        return ir.Constant(_FLOATS, [float(number)] * LANES)

    squares = None
    for one, other in zip(first, second, strict=True):
        apart = builder.fsub(builder.load(one, align=4), builder.load(other, align=4))
        squares = builder.fmul(apart, apart) if squares is None else _emit_fma(builder, apart, apart, squares)
    largest = constant(MAX_SQUARED_DISTANCE)
    squares = loop.later(builder.select(builder.fcmp_ordered("<", squares, largest), squares, largest))
    whole = builder.fptosi(squares, _INTEGERS)
    fraction = loop.later(builder.fsub(squares, builder.sitofp(whole, _FLOATS)))
    whole, power = loop.later(whole), constant(COEFFICIENTS[-1])
    for number in reversed(range(len(COEFFICIENTS) - 1)):
        power = _emit_fma(builder, power, fraction, constant(COEFFICIENTS[number]))
        if number == 2:
            power, whole, fraction = (loop.later(each) for each in (power, whole, fraction))
    return loop.later(builder.ashr(builder.fptosi(power, _INTEGERS), whole))


def _emit_box(builder, loop, values, size):
    """Return the sums of `size` values up to each, by way of sums of 2, 4, 8 ..."""
    doubled = [values]
    for level in range(size.bit_length() - 1):
        doubled.append(builder.add(doubled[-1], _shifted(builder, loop, doubled[-1], 2**level)))
    total, reach = None, 0
    for level in reversed(range(size.bit_length())):
        if size >> level & 1:
            part = _shifted(builder, loop, doubled[level], reach)
            total = part if total is None else builder.add(total, part)
            reach += 2**level
    return total


def _shifted(builder, loop, values, pixels):
    """Return the values that stand some pixels before."""
    whole, rest = divmod(pixels, LANES)
    newer = loop.later(values, whole)
    if rest == 0:
        return newer
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [LANES - rest + k for k in range(LANES)])
    return builder.shuffle_vector(loop.later(newer), newer, lanes)


def _emit_symmetric(builder, values, factors, first):
    """Return the sum of symmetrically weighted values and a first one."""
    half = len(values) // 2
    total = (
        _emit_fma(builder, factors[half], values[half], first)
        if first is not None
        else builder.fmul(factors[half], values[half])
    )
    for k in range(half):
        total = _emit_fma(builder, factors[k], builder.fadd(values[k], values[-1 - k]), total)
    return total


def _broadcast_weights(context, builder, kind, weights, size):
    """Return the weights of the first half of a window and its middle, each in all lanes."""
    factors = []
    for k in range(size // 2 + 1):
        place = address_of(context, builder, kind, weights, ir.Constant(_INDEX, k), ir.FloatType())
        factors.append(broadcast_value(builder, builder.load(place), _FLOATS))
    return factors


def _emit_fma(builder, first, second, third):
    """Return ``first * second + third``, rounded once."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_FLOATS, [_FLOATS] * 3), f"llvm.fma.v{LANES}f32"
    )
    return builder.call(function, [first, second, third])


@overload(slide_boxes, inline="always", prefer_literal=True)
def _compiled_slide_boxes(
    planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, ring, oldest, newest, totals, at
):
    """Return the implementation of `slide_boxes` within kernels."""

    def compiled(
        planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, ring, oldest, newest, totals, at
    ):
        _slide_boxes(
            planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, ring, oldest, newest, totals, at
        )

    return compiled


@overload(sum_windows_across, inline="always", prefer_literal=True)
def _compiled_sum_windows_across(
    planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, weights, ring, newest
):
    """Return the implementation of `sum_windows_across` within kernels."""

    def compiled(planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, weights, ring, newest):
        _sum_windows_across(
            planes0, place0, plane0, planes1, place1, plane1, step, count, width, size, weights, ring, newest
        )

    return compiled


@overload(sum_windows_down, inline="always", prefer_literal=True)
def _compiled_sum_windows_down(ring, start, slot, apart, weights, size, price, totals, at, totals_apart, width):
    """Return the implementation of `sum_windows_down` within kernels."""

    def compiled(ring, start, slot, apart, weights, size, price, totals, at, totals_apart, width):
        _sum_windows_down(ring, start, slot, apart, weights, size, price, totals, at, totals_apart, width)

    return compiled
