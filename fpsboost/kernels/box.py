"""Running sums of the similarity over a box, row by row: the cost does not depend on the patch size."""

from __future__ import annotations

import numpy as np
from llvmlite import ir

from fpsboost.kernels.jit import FINITE_JIT, LANES, cgutils, intrinsic, njit, overload, types
from fpsboost.kernels.lanes import address_of
from fpsboost.kernels.similarity import COEFFICIENTS, MAX_SQUARED_DISTANCE, similarity

_FLOATS, _INTEGERS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)


def slide_box(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at):
    """Move the column sums of a box down by one row, for LANES columns: add the new row and subtract the oldest.

    Parameters
    ----------
    planes0, planes1 : (size,) float32
        Scaled components, as for `fpsboost.kernels.similarity.similarity`.
    place0, plane0, place1, plane1 : int
        Index of the first pixel of the new row in the first of three planes, and distance between planes; no bounds
        are checked.
    oldest : (size,) int32
        Similarities of the rows in the box; updated in place.
    newest : int
        Index at which the new row replaces the oldest.
    columns : (size,) int32
        Column sums; updated in place.
    at : int
        Index of the first column sum.
    """
    for x in range(LANES):
        pixels = [planes0[place0 + c * plane0 + x] for c in range(3)]
        pixels += [planes1[place1 + c * plane1 + x] for c in range(3)]
        w = np.int32(similarity(*pixels))
        columns[at + x] += w - oldest[newest + x]
        oldest[newest + x] = w


@intrinsic
def _slide_box(typing, planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at):
    """Run `slide_box` in vector instructions."""
    place = types.int64
    return types.void(planes0, place, place, planes1, place, place, oldest, place, columns, place), _emit


def _emit(context, builder, signature, arguments):
    planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at = arguments
    fma = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_FLOATS, [_FLOATS] * 3), f"llvm.fma.v{LANES}f32"
    )

    def place(number, array, index, vector):
        return address_of(context, builder, signature.args[number], array, index, vector)

    def constant(number):
        return ir.Constant(_FLOATS, [float(number)] * LANES)

    squares = None
    for _ in range(3):
        first = builder.load(place(0, planes0, place0, _FLOATS), align=4)
        second = builder.load(place(3, planes1, place1, _FLOATS), align=4)
        apart = builder.fsub(first, second)
        squares = builder.fmul(apart, apart) if squares is None else builder.call(fma, [apart, apart, squares])
        place0, place1 = builder.add(place0, plane0), builder.add(place1, plane1)
    largest = constant(MAX_SQUARED_DISTANCE)
    squares = builder.select(builder.fcmp_ordered("<", squares, largest), squares, largest)
    whole = builder.fptosi(squares, _INTEGERS)
    fraction = builder.fsub(squares, builder.sitofp(whole, _FLOATS))
    power = constant(COEFFICIENTS[-1])
    for coefficient in COEFFICIENTS[-2::-1]:
        power = builder.call(fma, [power, fraction, constant(coefficient)])
    alike = builder.ashr(builder.fptosi(power, _INTEGERS), whole)
    row, sums = place(6, oldest, newest, _INTEGERS), place(8, columns, at, _INTEGERS)
    change = builder.sub(alike, builder.load(row, align=4))
    builder.store(builder.add(builder.load(sums, align=4), change), sums, align=4)
    builder.store(alike, row, align=4)
    return context.get_dummy_value()


@overload(slide_box, inline="always")
def _compiled(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at):
    """Return the implementation of `slide_box` within kernels."""

    def compiled(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at):
        _slide_box(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at)

    return compiled


@njit(inline="always", **FINITE_JIT)
def sum_box_across(column, size, width, price, partial, total):
    """Sum `size` neighbouring column sums, by way of sums of five, and subtract a penalty."""
    fives, rest = size // 5, size % 5
    padded_size = (size + LANES - 1) // LANES * LANES
    for x in range(width + padded_size):
        partial[x] = column[x] + column[x + 1] + column[x + 2] + column[x + 3] + column[x + 4]
    for x in range(width):
        value = -price
        for k in range(fives):
            value += partial[x + 5 * k]
        for k in range(rest):
            value += column[x + 5 * fives + k]
        total[x] = value
