"""Search by tiles over the distinct offsets that a coarser level proposes, at points several pixels apart.

Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
and their neighbours are therefore collected once, and the similarity of each of them is computed over the whole tile
and summed around each point: the cost is that of a few dozen offsets, whatever the search range.

Each point keeps its most similar offsets, one per local maximum: in a repeated pattern, several are equally similar,
and only the neighbours can tell which one is correct.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.lanes import EIGHT
from fpsboost.kernels.levels import SIXTEEN, compare_sixteen
from fpsboost.kernels.offset_lists import NOTHING, NOWHERE, VALUES_PER_ENTRY, insert_eight

TILE = 32
"""Side of a tile, pixels."""

PROPOSAL_MARGIN = 8
"""Distance beyond the tile within which proposals are collected, pixels."""

PADDING = TILE + LANES
"""Maximum distance beyond the frame at which a tile may be compared, pixels."""

Index = np.uint64
"""Type of array indices: unsigned, so that numba need not handle negative indices."""


@njit(**FINITE_JIT)
def gather_offsets(proposals, top, left, bottom, right, reach, limit, seen, offsets):
    """List the distinct offsets within `reach`, along x and y together, of any proposal in a window of places.

    Return the number of offsets. `seen` has (2 limit + 1)^2 flags, false at the start and at the end; `offsets` is a
    (2, capacity) output.
    """
    count = 1
    offsets[:, 0] = 0  # zero motion is always included
    seen[limit, limit] = True
    # by distance from the proposal: of equally similar offsets, the first one is kept
    for around in range(reach + 1):
        for y in range(top, bottom):
            for x in range(left, right):
                dx, dy = proposals[y, x, 0], proposals[y, x, 1]
                for oy in range(max(dy - around, -limit), min(dy + around, limit) + 1):
                    rest = around - abs(oy - dy)
                    for ox in range(max(dx - rest, -limit), min(dx + rest, limit) + 1):
                        if not seen[oy + limit, ox + limit]:
                            seen[oy + limit, ox + limit] = True
                            offsets[0, count], offsets[1, count] = oy, ox
                            count += 1
    for k in range(count):
        seen[offsets[0, k] + limit, offsets[1, k] + limit] = False
    return count


@njit(inline="always", **FINITE_JIT)
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
def write_lists(lists, size, first_down, first_across, down, across, per_tile, count, best, flows):
    """Write the lists of a tile's points to those of the frame, without empty entries."""
    for p in range(down):
        for q in range(across):
            row, column, point = first_down + p, first_across + q, p * per_tile + q
            listed = 0
            for entry in range(best.shape[2]):
                place = entry * VALUES_PER_ENTRY * size + point
                if lists[place] > np.float32(NOTHING):
                    best[row, column, entry] = lists[place]
                    flows[row, column, entry, 0] = lists[place + size]
                    flows[row, column, entry, 1] = lists[place + 2 * size]
                    listed = entry + 1
            count[row, column] = listed


@njit(**FINITE_JIT)
def keep_offset(dx, dy, value, row, column, count, best, flows):
    """Append an offset to a point's list if it is not listed yet; if the list is full, replace the last entry."""
    listed = count[row, column]
    for k in range(listed):
        if flows[row, column, k, 0] == dx and flows[row, column, k, 1] == dy:
            return
    place = min(listed, best.shape[2] - 1)
    best[row, column, place] = value
    flows[row, column, place, 0], flows[row, column, place, 1] = dx, dy
    count[row, column] = place + 1


@njit(cache=True, **FINITE_JIT)
def search_tiles(
    planes0, planes1, most, height, width, proposals, expected, spacing, step, reach, limit, radius, every, count, best,
    flows,
):  # fmt: skip
    """Find the most similar offsets at every point of a frame.

    Parameters
    ----------
    planes0, planes1 : (3, H + 2 p, W + 2 p + LANES or more) uint8 with p = PADDING + radius
        Components in levels, with repeated edges.
    most : int
        Similarity of two equal pixels; see `fpsboost.kernels.levels`.
    height, width : int
        Size of the frame, H and W.
    proposals : (places down, places across, 2) int32
        Motion (dx, dy) at places `spacing` pixels apart, the first at spacing / 2.
    expected : (places down, places across, 2) int32
        Motion that every point there keeps, whatever its similarity, if it is among the proposals or zero.
    spacing, step : int
        Distances between places and between points, pixels; `step` is a divisor of TILE.
    reach, limit : int
        Search range around each proposal, along x and y together, and maximum offset along x and y, pixels.
    radius : int
        Radius r of the patch of (2r + 1) x (2r + 1) pixels.
    every : int
        1, or 2 to compare every second row of the patches; then `step` is a multiple of 4.
    count : (points down, points across) int32 out
        Number of offsets of each point, at least one. An offset that is more similar than a listed neighbour replaces
        it, so that most are local maxima.
    best : (points down, points across, capacity) float32 out
        Mean similarity, at points `step` pixels apart, the first at step / 2; in decreasing order.
    flows : (points down, points across, capacity, 2) float32 out
        Offsets, whole pixels.
    """
    size, padding = 2 * radius + 1, PADDING + radius
    lanes = (TILE + 2 * radius + SIXTEEN - 1) // SIXTEEN * SIXTEEN
    compared = (size + every - 1) // every  # rows of a patch
    share = np.float32(1 / (np.int64(most) * size * compared))
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane = Index(plane_height * stride)
    places_down, places_across = proposals.shape[:2]
    points_down, points_across = count.shape
    per_tile = TILE // step
    tiles_across = (width + TILE - 1) // TILE
    tiles = (height + TILE - 1) // TILE * tiles_across
    capacity = min((2 * limit + 1) ** 2, 1 + ((2 * reach + 1) * ((TILE + 2 * PROPOSAL_MARGIN) // spacing + 2)) ** 2)
    seen = np.zeros((2 * limit + 1, 2 * limit + 1), np.bool_)
    offsets = np.empty((2, capacity), np.int32)
    # cumulative sums of each column from the tile's top, starting with an empty sum
    running = np.zeros((TILE + 2 * radius + 1) * lanes, np.uint16)
    column, totals = np.empty(lanes, np.uint16), np.empty(TILE, np.int32)
    likely, kept = np.empty((per_tile, per_tile, 2), np.int32), np.empty((per_tile, per_tile), np.float32)
    entries, points = best.shape[2], max(per_tile * per_tile, EIGHT)
    lists, values = np.empty(entries * VALUES_PER_ENTRY * points, np.float32), np.empty(points, np.float32)
    for tile in range(tiles):
        top, left = tile // tiles_across * TILE, tile % tiles_across * TILE
        bottom, right = min(top + TILE, height), min(left + TILE, width)
        first_down, first_across = top // step, left // step
        down, across = min(per_tile, points_down - first_down), min(per_tile, points_across - first_across)
        # if no offset leads into the frame, zero motion is the only entry
        count[first_down : first_down + down, first_across : first_across + across] = 0
        best[first_down : first_down + down, first_across : first_across + across] = np.float32(-2)
        flows[first_down : first_down + down, first_across : first_across + across] = 0
        values[:] = np.float32(NOTHING)  # includes points beyond the frame
        for k in range(entries):
            begin = k * VALUES_PER_ENTRY * points
            for i in range(points):
                lists[begin + i] = np.float32(NOTHING)
                lists[begin + points + i] = lists[begin + 2 * points + i] = np.float32(NOWHERE)
        proposed = gather_offsets(
            proposals,
            max(0, (top - PROPOSAL_MARGIN) // spacing),
            max(0, (left - PROPOSAL_MARGIN) // spacing),
            min(places_down, (bottom + PROPOSAL_MARGIN - 1) // spacing + 1),
            min(places_across, (right + PROPOSAL_MARGIN - 1) // spacing + 1),
            reach,
            limit,
            seen,
            offsets,
        )
        for p in range(down):
            place_y = min(((first_down + p) * step + step // 2) // spacing, places_down - 1)
            for q in range(across):
                place_x = min(((first_across + q) * step + step // 2) // spacing, places_across - 1)
                likely[p, q, 0], likely[p, q, 1] = expected[place_y, place_x, 0], expected[place_y, place_x, 1]
                kept[p, q] = -1
        # the last points of a frame may lie beyond its edge
        reached = max(bottom, top + down * step)
        for k in range(proposed):
            dy, dx = offsets[0, k], offsets[1, k]
            if min(top + dy, left + dx) < -TILE or reached + dy > height + TILE or right + dx > width + TILE:
                continue  # the tile would lie mostly outside
            for row in range((reached - top + 2 * radius + every - 1) // every):
                # the patch around the tile's first pixel begins here, in padded coordinates
                y0, x0 = top - radius + padding + row * every, left - radius + padding
                start0 = Index(y0 * stride + x0)
                start1 = Index((y0 + dy) * stride + x0 + dx)
                above, here = Index(row * lanes), Index((row + 1) * lanes)
                for i in range(Index(0), Index(lanes), Index(SIXTEEN)):
                    compare_sixteen(flat0, start0 + i, flat1, start1 + i, plane, most, running, above + i, here + i)
            for p in range(down):
                above = Index((p * step + step // 2) // every * lanes)
                below = above + Index(compared * lanes)
                for i in range(Index(lanes)):
                    column[i] = running[below + i] - running[above + i]
                sum_patches(column, size, step, across, totals)
                for q in range(across):
                    value = np.float32(totals[q]) * share
                    values[p * per_tile + q] = value
                    if dx == likely[p, q, 0] and dy == likely[p, q, 1]:
                        kept[p, q] = value
            for i in range(0, points, EIGHT):
                insert_eight(np.float32(dx), np.float32(dy), values, i, lists, points, entries)
        write_lists(lists, points, first_down, first_across, down, across, per_tile, count, best, flows)
        for p in range(down):
            for q in range(across):
                if kept[p, q] >= 0:
                    keep_offset(
                        likely[p, q, 0], likely[p, q, 1], kept[p, q], first_down + p, first_across + q, count, best,
                        flows,
                    )  # fmt: skip
                count[first_down + p, first_across + q] = max(count[first_down + p, first_across + q], 1)
