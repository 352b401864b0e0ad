"""Sums of the similarity over patches, row after row, as instructions.

The similarities of a row of pixels are summed across in registers as they are computed, and these sums are summed down
over the last rows, which are kept in a ring. Every sum is that of the patch whose last pixel it stands at, so that
nothing beyond need be known. Sums of neighbouring offsets are in line in one flat array, and symmetric weights are
(size,) float32.

From the colours of a pixel to its sum is a long way, on which each instruction waits for the one before. So the loop
works on several vectors at a time, each at another stage of that way, and runs through the rows of several offsets
without a stop.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import (
    AS_GIVEN,
    CONSTANT,
    FLOAT,
    INDEX,
    INTEGER,
    PLACE,
    REAL,
    Loop,
    fma,
    instruction,
    vector,
)
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.similarity import COEFFICIENTS, MAX_SQUARED_DISTANCE, similarity

_FLOATS, _INTEGERS = vector(REAL, LANES), vector(INTEGER, LANES)

STAGES = 5
"""Vectors on which the loop works at a time."""

GAP = (STAGES - 1) * LANES
"""Values before a row that are overwritten until the first vector has gone through all stages."""

ROWS_AT_ONCE = 6
"""Windows one below the other that share the reads of their rows."""


class FramePlanes(NamedTuple):
    """Flat planes of both frames, scaled as for `similarity`, and the distances between planes."""

    first: NDArray[Any]
    """(values,) float32, both."""
    plane0: int
    second: NDArray[Any]
    plane1: int


class OffsetRows(NamedTuple):
    """One row of frame 0, and the rows of frame 1 to which neighbouring offsets lead from it.

    No bounds are checked, and some pixels beyond the rows are read.
    """

    place0: int
    """Index of the first pixel in the first plane of frame 0."""
    place1: int
    """Index of the pixel in the first plane of frame 1 to which the first offset leads."""
    step: int
    """Distance between the first pixels of two offsets in frame 1."""
    offsets: int
    width: int
    """Pixels per offset, a multiple of `LANES`."""


class Ring(NamedTuple):
    """The last rows of sums across windows, for one offset."""

    sums: NDArray[Any]
    """Sums of all offsets, (values,) float32; has ``size + ROWS_AT_ONCE - 1`` slots."""
    start: int
    """Index of the first sum of the offset in the first slot."""
    slot: int
    """Slot of the uppermost row."""
    slot_size: int
    """Distance between slots."""


def slide_boxes(planes, rows, size, ring, oldest, newest, totals, at):
    """Move the sums over boxes, whose side is `size`, down by a new row, for neighbouring offsets.

    - `ring`: sums across of the rows in the box, (values,) int32; updated in place
    - `oldest`, `newest`: indices of the row to subtract, and of the new row; `GAP` values before it are overwritten
    - `totals`: sums over the boxes from index `at` on, (values,) int32; updated in place, and so are the `GAP` values
      before. The first ``size - 1`` of an offset, where no box ends, have no meaning
    """
    for which in range(rows.offsets):
        similarities = _similarities(planes, rows, which)
        for x in range(rows.width):
            place, value = which * rows.width + x, similarities[max(x + 1 - size, 0) : x + 1].sum(dtype=np.int32)
            totals[at + place] += value - ring[oldest + place]
            ring[newest + place] = value


@instruction(slide_boxes, AS_GIVEN, AS_GIVEN, CONSTANT, AS_GIVEN, INDEX, INDEX, AS_GIVEN, INDEX)
def _build_slide_boxes(code, planes, rows, size, ring, oldest, newest, totals, at):
    builder = code.builder
    old_row, new_row, total_row = _delayed(code, ring, oldest), _delayed(code, ring, newest), _delayed(code, totals, at)

    def finish(loop, similarities, place):
        across = _sum_box(code, loop, similarities, size)
        change = builder.sub(across, old_row.load(place, _INTEGERS))
        total_row.store(builder.add(total_row.load(place, _INTEGERS), change), place)
        new_row.store(across, place)

    _run_through(code, planes, rows, finish)


def sum_windows_across(planes, rows, size, weights, ring, newest):
    """Write the weighted sums across of a row of similarities, for neighbouring offsets.

    The new row begins at index `newest` of `ring`, (values,) float32; `GAP` values before it are overwritten.
    """
    for which in range(rows.offsets):
        similarities = np.zeros(size - 1 + rows.width, np.float32)
        similarities[size - 1 :] = _similarities(planes, rows, which)
        for x in range(rows.width):
            value = _sum_symmetric(similarities[x : x + size], weights, np.float32(0))
            ring[newest + which * rows.width + x] = value


@instruction(sum_windows_across, AS_GIVEN, AS_GIVEN, CONSTANT, AS_GIVEN, AS_GIVEN, INDEX)
def _build_sum_windows_across(code, planes, rows, size, weights, ring, newest):
    new_row, factors = _delayed(code, ring, newest), _broadcast_half(code, weights, size)

    def finish(loop, similarities, place):
        values = code.builder.sitofp(similarities, _FLOATS)
        shifted = [_shift(code, loop, values, pixels) for pixels in range(size)]
        new_row.store(_add_symmetric(code, shifted, factors, code.fill(0.0, _FLOATS)), place)

    _run_through(code, planes, rows, finish)


def sum_windows_down(ring, weights, size, price, totals, at, totals_apart, width):
    """Write the weighted sums of `size` rows, minus a penalty, for `ROWS_AT_ONCE` windows one below the other.

    The uppermost window has `width` totals, a multiple of `LANES`, from index `at` of `totals`, (values,) float32; the
    next one's are `totals_apart` on.
    """
    sums, start, slot, slot_size = ring
    slots = size + ROWS_AT_ONCE - 1
    for window in range(ROWS_AT_ONCE):
        for x in range(width):
            rows = [sums[start + (slot + window + k) % slots * slot_size + x] for k in range(size)]
            totals[at + window * totals_apart + x] = _sum_symmetric(rows, weights, -price)


@instruction(sum_windows_down, AS_GIVEN, AS_GIVEN, CONSTANT, FLOAT, AS_GIVEN, INDEX, INDEX, INDEX)
def _build_sum_windows_down(code, ring, weights, size, price, totals, at, totals_apart, width):
    (sums, start, slot, slot_size), builder = ring, code.builder
    slots, rows = PLACE(size + ROWS_AT_ONCE - 1), []
    for _ in range(size + ROWS_AT_ONCE - 1):
        rows.append(sums.at(builder.add(start, builder.mul(slot, slot_size))))
        slot = code.add(slot, 1)
        slot = builder.select(builder.icmp_signed(">=", slot, slots), builder.sub(slot, slots), slot)
    factors = _broadcast_half(code, weights, size)
    first = code.broadcast(builder.fneg(price), _FLOATS)
    total_rows = [totals.at(place) for place in code.steps(at, totals_apart, ROWS_AT_ONCE)]
    loop = Loop(builder)
    x = loop.carry(PLACE(0))
    values = [row.load(x, _FLOATS) for row in rows]
    for window, total_row in enumerate(total_rows):
        total_row.store(_add_symmetric(code, values[window : window + size], factors, first), x)
    loop.end(x, LANES, width)


def _similarities(planes, rows, which):
    """Return the similarities of a row of pixels and that to which one of the offsets leads."""
    place0, place1 = rows.place0, rows.place1 + which * rows.step
    components = [planes.first[place0 + c * planes.plane0 :][: rows.width] for c in range(3)]
    components += [planes.second[place1 + c * planes.plane1 :][: rows.width] for c in range(3)]
    return np.array([similarity(*pixels) for pixels in zip(*components, strict=True)], np.int32)


def _sum_symmetric(values, weights, first):
    """Return the sum of symmetrically weighted values and a first one, in the order of `_add_symmetric`."""
    half = len(values) // 2
    total = fma(weights[half], values[half], first)
    for k in range(half):
        total = fma(weights[k], values[k] + values[len(values) - 1 - k], total)
    return total


def _add_symmetric(code, values, factors, first):
    """Return the vector for `_sum_symmetric`."""
    half = len(values) // 2
    total = code.fma(factors[half], values[half], first)
    for k in range(half):
        total = code.fma(factors[k], code.builder.fadd(values[k], values[-1 - k]), total)
    return total


def _broadcast_half(code, weights, size):
    """Return the weights of the first half of a window and its middle, each in all lanes."""
    return [code.broadcast(weights.load(PLACE(k), REAL), _FLOATS) for k in range(size // 2 + 1)]


def _delayed(code, array, index):
    """Return the array for the last stage, to which the first vector comes in round `STAGES`."""
    return array.at(code.add(index, -GAP))


def _run_through(code, planes, rows, finish):
    """Run through the similarities of all offsets, with `finish` for each vector of them and its place in line."""
    (first, plane0, second, plane1), (place0, place1, step, count, width), builder = planes, rows, code.builder
    rows0 = [first.at(place) for place in code.steps(place0, plane0, 3)]
    rows1 = [second.at(place) for place in code.steps(place1, plane1, 3)]
    end = code.add(builder.mul(count, width), GAP)
    loop = Loop(builder)
    place, x, shift = (loop.carry(PLACE(0)) for _ in range(3))
    there = builder.add(x, shift)
    pairs = [(row0.load(x, _FLOATS), row1.load(there, _FLOATS)) for row0, row1 in zip(rows0, rows1, strict=True)]
    finish(loop, _compare(code, loop, pairs), place)
    following = code.add(x, LANES)
    over = builder.icmp_signed(">=", following, width)
    loop.follow(x, builder.select(over, PLACE(0), following))
    loop.follow(shift, builder.select(over, builder.add(shift, step), shift))
    loop.end(place, LANES, end)


def _compare(code, loop, pairs):
    """Return the similarities of pixels, given their components in both frames, ``STAGES - 1`` rounds later."""
    builder, squares = code.builder, None
    for one, other in pairs:
        change = builder.fsub(one, other)
        squares = builder.fmul(change, change) if squares is None else code.fma(change, change, squares)
    largest = code.fill(float(MAX_SQUARED_DISTANCE), _FLOATS)
    squares = loop.later(builder.select(builder.fcmp_ordered("<", squares, largest), squares, largest))
    whole = builder.fptosi(squares, _INTEGERS)
    fraction = loop.later(builder.fsub(squares, builder.sitofp(whole, _FLOATS)))
    whole, power = loop.later(whole), code.fill(float(COEFFICIENTS[-1]), _FLOATS)
    for number in reversed(range(len(COEFFICIENTS) - 1)):
        power = code.fma(power, fraction, code.fill(float(COEFFICIENTS[number]), _FLOATS))
        if number == 2:
            power, whole, fraction = map(loop.later, (power, whole, fraction))
    return loop.later(builder.ashr(builder.fptosi(power, _INTEGERS), whole))


def _sum_box(code, loop, values, size):
    """Return the sums of `size` values up to each, by way of sums of 2, 4, 8 ..."""
    add, doubled = code.builder.add, [values]
    for level in range(size.bit_length() - 1):
        doubled.append(add(doubled[-1], _shift(code, loop, doubled[-1], 2**level)))
    total, reach = None, 0
    for level in reversed(range(size.bit_length())):
        if size >> level & 1:
            part = _shift(code, loop, doubled[level], reach)
            total = part if total is None else add(total, part)
            reach += 2**level
    return total


def _shift(code, loop, values, pixels):
    """Return the values that stand some pixels before."""
    whole, rest = divmod(pixels, LANES)
    newer = loop.later(values, whole)
    if rest == 0:
        return newer
    return code.choose(loop.later(newer), range(LANES - rest, 2 * LANES - rest), newer)
