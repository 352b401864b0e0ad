"""Search for the most similar patch: the report's Algorithm 1 for both directions in one pass.

For one offset k, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` serves both fields: summed over the patch, it is
the score of k at x for A->B, and the score of -k at x + k for B->A. So every offset is computed once, row by row,
without storing a full-size image: only a running column sum over the last 2r + 1 rows of W, a short horizontal sum, and
two comparisons. Four neighbouring offsets are processed together and share the reads of the best scores so far.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.box import slide_box, sum_box_across
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES, njit
from fpsboost.kernels.similarity import similarity

STRIP_WIDTH = 640
"""Columns per pass: wide enough for a small overhead of the patch margins, narrow enough for the caches."""

QUADRUPLES_PER_PASS = 2
"""Quadruples of offsets processed together row by row: the rows they read stay in the first-level cache."""


class BestOffsets(NamedTuple):
    """Best offset of every pixel of a frame so far."""

    similarity: NDArray[Any]
    """Summed similarity, int32 (box) or float32 (taps), -1 at the start."""
    ranks: NDArray[Any]
    """Rank of the best offset, int32, 0 at the start."""


@njit(**FINITE_JIT)
def keep_best_of_four(total0, total1, total2, total3, ranks, width, best, winners):
    """Update `best` and `winners` where one of four totals is larger than `best`, or equal at a lower rank.

    The four ranks increase.
    """
    rank0, rank1, rank2, rank3 = ranks
    for x in range(width):
        first, second, third, fourth, previous = total0[x], total1[x], total2[x], total3[x], best[x]
        swap01, swap23 = second > first, fourth > third
        value01, rank01 = (second, rank1) if swap01 else (first, rank0)
        value23, rank23 = (fourth, rank3) if swap23 else (third, rank2)
        swap = value23 > value01
        value, rank = (value23, rank23) if swap else (value01, rank01)
        better = (value > previous) | ((value == previous) & (rank < winners[x]))
        best[x] = value if better else previous
        winners[x] = rank if better else winners[x]


@njit(inline="always", **FINITE_JIT)
def read_quadruple(table, y, x, step):
    """Return the table entries of four neighbouring offsets; the edge entry for those beyond it, which never win."""
    last = table.shape[1] - 1
    return (
        table[y, x],
        table[y, min(max(x + step, 0), last)],
        table[y, min(max(x + 2 * step, 0), last)],
        table[y, min(max(x + 3 * step, 0), last)],
    )


@njit(inline="always", **FINITE_JIT)
def slide_window(a0, a1, a2, b0, b1, b2, weights, size, slot, width, ring, column):
    """Write the weighted column sums of the last `size` rows, including the new one."""
    # every row is stored twice, `size` rows apart, so that the window is always contiguous
    newest, again = ring[slot], ring[slot + size]
    for x in range(width):
        w = np.float32(similarity(a0[x], a1[x], a2[x], b0[x], b1[x], b2[x]))
        newest[x] = w
        again[x] = w
    window, half = ring[slot + 1 : slot + 1 + size], size // 2
    for x in range(width):
        value = weights[half] * window[half, x]
        for k in range(half):
            value = fma(weights[k], window[k, x] + window[size - 1 - k, x], value)
        column[x] = value


@njit(inline="always", **FINITE_JIT)
def sum_window_across(column, weights, size, width, price, total):
    """Write the weighted sum of `size` neighbouring column sums, minus a penalty."""
    half = size // 2
    for x in range(width):
        value = fma(weights[half], column[x + half], -price)
        for k in range(half):
            value = fma(weights[k], column[x + k] + column[x + size - 1 - k], value)
        total[x] = value


@lru_cache(maxsize=32)
def rank_offsets(search_radius: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Order all offsets by length, so that the smallest motion wins a tie.

    Parameters
    ----------
    search_radius : int
        R, pixels.

    Returns
    -------
    ranks : (2R + 1, 2R + 1) int32
        Rank of the offset (dx, dy) at ``[dy + R, dx + R]``; 0 is no motion.
    offsets : ((2R + 1)^2, 2) float32
        ``(dx, dy)`` of every rank. Both arrays are shared by all callers and read-only.
    """
    dy, dx = np.mgrid[-search_radius : search_radius + 1, -search_radius : search_radius + 1]
    order = np.argsort((dx * dx + dy * dy).ravel(), kind="stable")
    ranks = np.empty(order.size, np.int32)
    ranks[order] = np.arange(order.size)
    offsets = np.stack([dx.ravel()[order], dy.ravel()[order]], axis=-1).astype(np.float32)
    ranks.flags.writeable = offsets.flags.writeable = False
    return ranks.reshape(dx.shape), offsets


@lru_cache(maxsize=32)
def exhaustive_kernel(  # noqa: C901 (its kernel counts as its own)
    patch_radius: int, taps: tuple[float, ...] | None = None
) -> Callable[..., None]:
    """Compile the exhaustive search for one patch size and window.

    The patch size is a compile-time constant, because the speed depends on unrolled horizontal sums.

    Parameters
    ----------
    patch_radius : int
        Radius r of the patch of (2r + 1) x (2r + 1) pixels.
    taps : tuple of 2r + 1 float or None
        One-dimensional weights of a separable window; None for a box.

    Returns
    -------
    callable
        ``search(planes0, planes1, height, width, ranks, prices, found01, found10)``, with
        M = search_radius + 4 and L = LANES:

        planes0 : (3, H + 2r, W + 2r + L or more) float32, scaled by `colour_scale`, edges repeated
        planes1 : (3, H + 2r, W + 2r + 2M + L or more) float32, the same
        found01 : BestOffsets, (H, W + L or more)
        found10 : BestOffsets, (H, W + 2M + 2L or more); column M is the first of the image
        ranks : (2R + 1, 2R + 1) int32, from `rank_offsets`
        prices : (2R + 1, 2R + 1), the type of the similarity, from which they are subtracted; 0 for no motion
    """
    size = 2 * patch_radius + 1
    padded_size = (size + LANES - 1) // LANES * LANES
    box = taps is None
    dtype: Any = np.int32 if box else np.float32
    ring_rows = size if box else 2 * size
    weights = np.array(taps or (), np.float32)

    @njit(cache=True, **FINITE_JIT)
    def search(planes0, planes1, height, width, ranks, prices, found01, found10):  # noqa: C901 (loops share buffers)
        (best01, winners01), (best10, winners10) = found01, found10
        margin = size - 1
        search_radius = len(ranks) // 2
        shift = search_radius + 4
        # whole lanes keep every row aligned; cleared in every pass, so no longer than necessary
        room = (min(STRIP_WIDTH, width) + margin + 3 * LANES - 1) // LANES * LANES
        last_four = search_radius // 4
        rings = np.empty((4 * QUADRUPLES_PER_PASS, ring_rows, room), dtype)
        column_room = room + padded_size + LANES
        columns = np.empty((4 * QUADRUPLES_PER_PASS, column_room), dtype)
        flat_rings, flat_columns = rings.reshape(rings.size), columns.reshape(columns.size)
        flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
        stride0, stride1 = planes0.shape[2], planes1.shape[2]
        plane0, plane1 = planes0.shape[1] * stride0, planes1.shape[1] * stride1
        partial = np.empty(room + padded_size, dtype)
        # positions before the first and after the last pixel are not candidates, but are read for the quadruple
        totals = np.full((4, room + 2 * LANES), -1, dtype)
        for dy in range(-search_radius, search_radius + 1):
            top, bottom = max(0, -dy), min(height, height - dy)
            if top >= bottom:
                continue
            for left in range(0, width, STRIP_WIDTH):
                pixels = min(STRIP_WIDTH, width - left)
                whole = (pixels + LANES - 1) // LANES * LANES
                padded_width = (pixels + margin + LANES - 1) // LANES * LANES
                for group in range(-last_four - 1, last_four + 1, QUADRUPLES_PER_PASS):
                    rings[:] = 0
                    columns[:] = 0
                    for row in range(top, bottom + margin):
                        y = row - margin
                        for four in range(group, min(group + QUADRUPLES_PER_PASS, last_four + 1)):
                            # the offset nearest to zero comes first, as its rank is lowest
                            dx, step = (4 * four, 1) if four >= 0 else (4 * four + 3, -1)
                            if abs(dx) > search_radius:
                                continue
                            count = min(search_radius - abs(dx) + 1, 4)
                            slot, first_number = row % size, 4 * (four - group)
                            for which in range(count, 4):
                                totals[which, LANES : 2 * LANES + whole] = -1
                            if box:
                                place0, place1 = row * stride0 + left, (row + dy) * stride1 + left + shift + dx
                                newest, at = (first_number * ring_rows + slot) * room, first_number * column_room
                                # one long loop instead of four: the end of each is mispredicted
                                for x in range(0, padded_width, LANES):
                                    for which in range(count):
                                        slide_box(
                                            flat0, place0 + x, plane0, flat1, place1 + step * which + x, plane1,
                                            flat_rings, newest + which * (ring_rows * room) + x,
                                            flat_columns, at + which * column_room + x,
                                        )  # fmt: skip
                            else:
                                for which in range(count):
                                    begin, number = left + shift + dx + step * which, first_number + which
                                    # one slice per plane: a slice of all three would be strided and would not vectorise
                                    a0 = planes0[0, row, left : left + padded_width]
                                    a1 = planes0[1, row, left : left + padded_width]
                                    a2 = planes0[2, row, left : left + padded_width]
                                    b0 = planes1[0, row + dy, begin : begin + padded_width]
                                    b1 = planes1[1, row + dy, begin : begin + padded_width]
                                    b2 = planes1[2, row + dy, begin : begin + padded_width]
                                    ring, column = rings[number], columns[number]
                                    slide_window(
                                        a0, a1, a2, b0, b1, b2, weights, size, slot, padded_width, ring, column
                                    )
                            if y < top:
                                continue
                            for which in range(count):
                                offset, column = dx + step * which, columns[first_number + which]
                                total = totals[which, LANES:]
                                price = prices[search_radius + dy, search_radius + offset]
                                if box:
                                    sum_box_across(column, size, whole, price, partial, total)
                                else:
                                    sum_window_across(column, weights, size, whole, price, total)
                                # targets outside of the other frame are not candidates
                                first, last = max(0, -offset - left), min(pixels, width - offset - left)
                                total[: min(first, pixels)] = -1
                                total[max(0, last) : whole + LANES] = -1
                            keep_best_of_four(
                                totals[0, LANES:],
                                totals[1, LANES:],
                                totals[2, LANES:],
                                totals[3, LANES:],
                                read_quadruple(ranks, search_radius + dy, search_radius + dx, step),
                                whole,
                                best01[y, left:],
                                winners01[y, left:],
                            )
                            # each total is shifted by its offset, so that the four refer to the same target
                            begin = left + shift + min(dx, dx + 3 * step)
                            shift0 = LANES - max(0, -3 * step)
                            keep_best_of_four(
                                totals[0, shift0:],
                                totals[1, shift0 - step :],
                                totals[2, shift0 - 2 * step :],
                                totals[3, shift0 - 3 * step :],
                                read_quadruple(ranks, search_radius - dy, search_radius - dx, -step),
                                whole + LANES,
                                best10[y + dy, begin:],
                                winners10[y + dy, begin:],
                            )

    return search
