"""Search by tiles over the distinct offsets that a coarser level proposes, at points several pixels apart.

Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
and their neighbours are therefore collected once, and the similarity of each of them is computed over the whole tile
and summed around each point: the cost is that of a few dozen offsets, whatever the search range.

Each point keeps its most similar offsets, one per local maximum: in a repeated pattern, several are equally similar,
and only the neighbours can tell which one is correct.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from fpsboost.kernels.instruction import AS_GIVEN, EIGHT, FLOAT, INDEX, REAL, SIXTEEN, Index, instruction, vector
from fpsboost.kernels.jit import FINITE_JIT, LANES, cgutils, njit
from fpsboost.kernels.planes import flatten
from fpsboost.kernels.similarity import compare_sixteen

TILE = 32
"""Side of a tile, pixels."""

PROPOSAL_MARGIN = 8
"""Distance beyond the tile within which proposals are collected, pixels."""

PADDING = TILE + LANES
"""Maximum distance beyond the frame at which a tile may be compared, pixels."""

VALUES_PER_ENTRY = 3
"""Number of values per entry: similarity, dx, dy."""

NOTHING, NOWHERE = -2.0, 1e6
"""Similarity and offset of an empty entry."""

_FLOATS = vector(REAL, EIGHT)


class Proposals(NamedTuple):
    """Motion that a coarser level proposes, at places `spacing` pixels apart, the first at spacing / 2."""

    motion: NDArray[Any]
    """``(dx, dy)``, (places down, places across, 2) int32."""
    expected: NDArray[Any]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero; the same shape."""
    spacing: int


class OffsetLists(NamedTuple):
    """Most similar offsets of each point in decreasing order, at points `step` pixels apart, the first at step / 2."""

    listed: NDArray[Any]
    """Number of offsets of each point, (points down, points across) int32."""
    similarity: NDArray[Any]
    """Mean similarity, (points down, points across, capacity) float32."""
    flow: NDArray[Any]
    """Offsets, whole pixels, (points down, points across, capacity, 2) float32."""


class TilePoints(NamedTuple):
    """First row and column of the points of a tile, and their number down and across."""

    row: int
    column: int
    down: int
    across: int


def insert_eight(dx, dy, similarities, at, lists, size, capacity):
    """Insert an offset into the lists of eight points; of neighbouring offsets, only the more similar one is kept.

    - `similarities`: of the offset at every point, (size,) float32; the first of the eight is at index `at`
    - `lists`: by decreasing similarity, ordered by entry, value and point, (capacity * VALUES_PER_ENTRY * size,)
      float32; empty entries last, with NOTHING and NOWHERE; updated in place, no bounds are checked
    """
    for point in range(at, at + EIGHT):
        inserted = [similarities[point], dx, dy]
        for entry in range(capacity):
            places = [(entry * VALUES_PER_ENTRY + number) * size + point for number in range(VALUES_PER_ENTRY)]
            before = [lists[place] for place in places]
            if similarities[point] > before[0]:
                for place, number in zip(places, inserted, strict=True):
                    lists[place] = number
                inserted = before
            if abs(before[1] - dx) <= 1 and abs(before[2] - dy) <= 1:
                break


@instruction(insert_eight, FLOAT, FLOAT, AS_GIVEN, INDEX, AS_GIVEN, INDEX, INDEX)
def _build_insert_eight(code, dx, dy, similarities, at, lists, size, capacity):
    builder, one = code.builder, code.fill(1.0, _FLOATS)
    offset = code.broadcast(dx, _FLOATS), code.broadcast(dy, _FLOATS)

    def is_near(numbers, number):
        return builder.fcmp_ordered("<=", code.call("fabs", builder.fsub(numbers, number)), one)

    value = similarities.load(at, _FLOATS)
    entry = builder.mul(size, size.type(VALUES_PER_ENTRY))
    last = builder.add(at, builder.mul(entry, code.add(capacity, -1)))
    is_better = builder.bitcast(builder.fcmp_ordered(">", value, lists.load(last, _FLOATS)), ir.IntType(EIGHT))
    with builder.if_then(builder.icmp_unsigned("!=", is_better, is_better.type(0))):
        inserted = [cgutils.alloca_once_value(builder, numbers) for numbers in (value, *offset)]
        is_open = cgutils.alloca_once_value(builder, code.fill(1, vector(ir.IntType(1), EIGHT)))
        begin = cgutils.alloca_once_value(builder, at)
        with cgutils.for_range(builder, capacity):
            index = builder.load(begin)
            places = code.steps(index, size, VALUES_PER_ENTRY)
            before = [lists.load(place, _FLOATS) for place in places]
            goes_on = builder.load(is_open)
            writes = builder.and_(goes_on, builder.fcmp_ordered(">", value, before[0]))
            for place, listed, variable in zip(places, before, inserted, strict=True):
                moved = builder.load(variable)
                lists.store(builder.select(writes, moved, listed), place)
                builder.store(builder.select(writes, listed, moved), variable)
            near = builder.and_(is_near(before[1], offset[0]), is_near(before[2], offset[1]))
            builder.store(builder.and_(goes_on, builder.not_(near)), is_open)
            builder.store(builder.add(index, entry), begin)


@njit(**FINITE_JIT)
def gather_offsets(proposals, top, left, bottom, right, refine_radius, max_offset, is_listed, offsets):
    """List the distinct offsets within `refine_radius` of any proposal in a window of places, and return their number.

    `is_listed` has (2 max_offset + 1)^2 flags, false at the start and at the end; `offsets` is (2, capacity) out.
    """
    count = 1
    offsets[:, 0] = 0  # zero motion is always included
    is_listed[max_offset, max_offset] = True
    # by distance from the proposal: of equally similar offsets, the first one is kept
    for around in range(refine_radius + 1):
        for y in range(top, bottom):
            for x in range(left, right):
                dx, dy = proposals[y, x, 0], proposals[y, x, 1]
                for oy in range(max(dy - around, -max_offset), min(dy + around, max_offset) + 1):
                    rest = around - abs(oy - dy)
                    for ox in range(max(dx - rest, -max_offset), min(dx + rest, max_offset) + 1):
                        if not is_listed[oy + max_offset, ox + max_offset]:
                            is_listed[oy + max_offset, ox + max_offset] = True
                            offsets[0, count], offsets[1, count] = oy, ox
                            count += 1
    for k in range(count):
        is_listed[offsets[0, k] + max_offset, offsets[1, k] + max_offset] = False
    return count


@njit(**FINITE_JIT)
def sum_patches(column, size, step, across, totals):
    """Sum `size` columns around each of `across` points of a row, the first at step / 2."""
    if step > 1:
        for q in range(across):
            total = np.int32(0)
            for i in range(size):
                total += column[q * step + step // 2 + i]
            totals[q] = total
        return
    totals[:] = 0
    for i in range(size):
        for q in range(TILE):
            totals[q] += column[q + i]


@njit(**FINITE_JIT)
def write_lists(entries, size, points, expected, similarities, lists):
    """Write the lists of a tile's points to those of the frame, without empty entries.

    The expected motion is added where its similarity is not negative; if nothing is listed, zero motion is.
    """
    listed, similarity, flow = lists
    for p in range(points.down):
        for q in range(points.across):
            row, column, point = points.row + p, points.column + q, p * expected.shape[1] + q
            count = 0
            for entry in range(similarity.shape[2]):
                place = entry * VALUES_PER_ENTRY * size + point
                if entries[place] > np.float32(NOTHING):
                    similarity[row, column, entry] = entries[place]
                    flow[row, column, entry, 0] = entries[place + size]
                    flow[row, column, entry, 1] = entries[place + 2 * size]
                    count = entry + 1
            listed[row, column] = count
            if similarities[p, q] >= 0:
                keep_offset(expected[p, q, 0], expected[p, q, 1], similarities[p, q], row, column, lists)
            listed[row, column] = max(listed[row, column], 1)


@njit(**FINITE_JIT)
def keep_offset(dx, dy, value, row, column, lists):
    """Append an offset to a point's list if it is not listed yet; if the list is full, replace the last entry."""
    listed, similarity, flow = lists
    count = listed[row, column]
    for k in range(count):
        if flow[row, column, k, 0] == dx and flow[row, column, k, 1] == dy:
            return
    place = min(count, similarity.shape[2] - 1)
    similarity[row, column, place] = value
    flow[row, column, place, 0], flow[row, column, place, 1] = dx, dy
    listed[row, column] = place + 1


@njit(**FINITE_JIT)
def clear_tile(points, size, entries, lists):
    """Clear the lists of a tile's points; if no offset leads into the frame, zero motion is the only entry."""
    listed, similarity, flow = lists
    below, right = points.row + points.down, points.column + points.across
    listed[points.row : below, points.column : right] = 0
    similarity[points.row : below, points.column : right] = np.float32(-2)
    flow[points.row : below, points.column : right] = 0
    for k in range(similarity.shape[2]):
        begin = k * VALUES_PER_ENTRY * size
        for i in range(size):
            entries[begin + i] = np.float32(NOTHING)
            entries[begin + size + i] = entries[begin + 2 * size + i] = np.float32(NOWHERE)


@njit(**FINITE_JIT)
def find_expected(points, step, expected, spacing, likely, similarities):
    """Write the expected motion of each point of a tile to `likely`, and -1 to `similarities`."""
    for p in range(points.down):
        place_y = min(((points.row + p) * step + step // 2) // spacing, expected.shape[0] - 1)
        for q in range(points.across):
            place_x = min(((points.column + q) * step + step // 2) // spacing, expected.shape[1] - 1)
            likely[p, q, 0], likely[p, q, 1] = expected[place_y, place_x, 0], expected[place_y, place_x, 1]
            similarities[p, q] = -1


@njit(**FINITE_JIT)
def search_tiles(pair, proposals, step, refine_radius, max_offset, patch_radius, row_step, lists):
    """Find the most similar offsets, at least one, at every point of a frame.

    An offset that is more similar than a listed neighbour replaces it, so that most are local maxima.

    - `pair`: in levels, padded by PADDING + patch_radius and LANES more on the right
    - `step`: distance between points, pixels; a divisor of TILE
    - `refine_radius`, `max_offset`: search range around each proposal, along x and y together, and maximum offset along
      x and y, pixels
    - `patch_radius`: radius r of the patch of (2r + 1) x (2r + 1) pixels
    - `row_step`: 1, or 2 to compare every second row of the patches; then `step` is a multiple of 4
    """
    _, _, padding, height, width, max_similarity = pair
    flat0, flat1, plane, stride = flatten(pair)
    proposed_motion, expected, spacing = proposals
    size = 2 * patch_radius + 1
    lanes = (TILE + 2 * patch_radius + SIXTEEN - 1) // SIXTEEN * SIXTEEN
    compared = (size + row_step - 1) // row_step  # rows of a patch
    share = np.float32(1 / (np.int64(max_similarity) * size * compared))
    places_down, places_across = proposed_motion.shape[:2]
    points_down, points_across = lists.listed.shape
    per_tile = TILE // step
    tiles_across = (width + TILE - 1) // TILE
    tiles = (height + TILE - 1) // TILE * tiles_across
    places_per_tile = (TILE + 2 * PROPOSAL_MARGIN) // spacing + 2
    capacity = min((2 * max_offset + 1) ** 2, 1 + ((2 * refine_radius + 1) * places_per_tile) ** 2)
    is_listed = np.zeros((2 * max_offset + 1, 2 * max_offset + 1), np.bool_)
    offsets = np.empty((2, capacity), np.int32)
    # cumulative sums of each column from the tile's top, starting with an empty sum
    running = np.zeros((TILE + 2 * patch_radius + 1) * lanes, np.uint16)
    column, totals = np.empty(lanes, np.uint16), np.empty(TILE, np.int32)
    likely, similarities = np.empty((per_tile, per_tile, 2), np.int32), np.empty((per_tile, per_tile), np.float32)
    entries_per_list, list_count = lists.similarity.shape[2], max(per_tile * per_tile, EIGHT)
    entries = np.empty(entries_per_list * VALUES_PER_ENTRY * list_count, np.float32)
    values = np.empty(list_count, np.float32)
    for tile in range(tiles):
        top, left = tile // tiles_across * TILE, tile % tiles_across * TILE
        bottom, right = min(top + TILE, height), min(left + TILE, width)
        first_down, first_across = top // step, left // step
        down, across = min(per_tile, points_down - first_down), min(per_tile, points_across - first_across)
        points = TilePoints(first_down, first_across, down, across)
        values[:] = np.float32(NOTHING)  # includes points beyond the frame
        clear_tile(points, list_count, entries, lists)
        proposed = gather_offsets(
            proposed_motion,
            max(0, (top - PROPOSAL_MARGIN) // spacing),
            max(0, (left - PROPOSAL_MARGIN) // spacing),
            min(places_down, (bottom + PROPOSAL_MARGIN - 1) // spacing + 1),
            min(places_across, (right + PROPOSAL_MARGIN - 1) // spacing + 1),
            refine_radius,
            max_offset,
            is_listed,
            offsets,
        )
        find_expected(points, step, expected, spacing, likely, similarities)
        # the last points of a frame may lie beyond its edge
        last_row = max(bottom, top + down * step)
        for k in range(proposed):
            dy, dx = offsets[0, k], offsets[1, k]
            if min(top + dy, left + dx) < -TILE or last_row + dy > height + TILE or right + dx > width + TILE:
                continue  # the tile would lie mostly outside
            for row in range((last_row - top + 2 * patch_radius + row_step - 1) // row_step):
                # the patch around the tile's first pixel begins here, in padded coordinates
                y0, x0 = top - patch_radius + padding + row * row_step, left - patch_radius + padding
                start0 = Index(y0 * stride + x0)
                start1 = Index((y0 + dy) * stride + x0 + dx)
                above, here = Index(row * lanes), Index((row + 1) * lanes)
                for i in range(Index(0), Index(lanes), Index(SIXTEEN)):
                    compare_sixteen(
                        flat0, start0 + i, flat1, start1 + i, plane, max_similarity, running, above + i, here + i
                    )
            for p in range(down):
                above = Index((p * step + step // 2) // row_step * lanes)
                below = above + Index(compared * lanes)
                for i in range(Index(lanes)):
                    column[i] = running[below + i] - running[above + i]
                sum_patches(column, size, step, across, totals)
                for q in range(across):
                    value = np.float32(totals[q]) * share
                    values[p * per_tile + q] = value
                    if dx == likely[p, q, 0] and dy == likely[p, q, 1]:
                        similarities[p, q] = value
            for i in range(0, list_count, EIGHT):
                insert_eight(np.float32(dx), np.float32(dy), values, i, entries, list_count, entries_per_list)
        write_lists(entries, list_count, points, likely, similarities, lists)
