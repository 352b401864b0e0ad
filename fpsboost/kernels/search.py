"""Search for the most similar patch: the report's Algorithm 1 for both directions in one pass.

For one offset k, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` serves both fields: summed over the patch, it is
the score of k at x for A->B, and the score of -k at x + k for B->A. So every offset is computed once, row by row,
without storing a full-size image: only a row of sums across the patch, their sum down the last 2r + 1 rows, and two
comparisons. Some neighbouring offsets are processed together and share the reads of the pixels and of the best scores
so far.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import AS_GIVEN, EIGHT, INDEX, INTEGER, PLACE, REAL, Loop, instruction, vector
from fpsboost.kernels.jit import FINITE_JIT, LANES, njit
from fpsboost.kernels.patch_rows import (
    GAP,
    ROWS_AT_ONCE,
    FramePlanes,
    OffsetRows,
    Ring,
    slide_boxes,
    sum_windows_across,
    sum_windows_down,
)

STRIP_WIDTH = 640
"""Columns per pass: wide enough for a small overhead of the patch margins, narrow enough for the caches."""

OFFSETS_PER_PASS = 8
"""Neighbouring offsets processed together row by row, a multiple of four: they are one loop, whose start and end cost
as much as some vectors."""

OUTSIDE = 16
"""Totals on either side of the candidates that may be compared with them: the rest of a vector, and as the four offsets
of a comparison do not lead from the same pixels."""


class BestOffsets(NamedTuple):
    """Best offset of every pixel of a frame so far."""

    similarity: NDArray[Any]
    """Summed similarity, int32 (box) or float32 (taps), -1 at the start."""
    ranks: NDArray[Any]
    """Rank of the best offset, int32, 0 at the start."""


def keep_best_of_four(totals, at, spacing, ranks, first, best, winners, place, count):
    """Update `best` and `winners` where one of four totals is larger than `best`, or equal at a lower rank.

    - `totals`: (values,) int32 or float32; the first offset's begin at index `at`, the next ones' `spacing` on; no
      bounds are checked
    - `ranks`: (offsets,) int32; four of them, from index `first` on, increase
    - `best`, `winners`: largest totals so far, from index `place` on, and their ranks, (values,) int32
    - `count`: pixels, at least one; as many more as fill the last vector are compared, too
    """
    for x in range(-(-count // EIGHT) * EIGHT):
        value, rank = totals[at + x], ranks[first]
        for which in range(1, 4):
            if totals[at + which * spacing + x] > value:
                value, rank = totals[at + which * spacing + x], ranks[first + which]
        if value > best[place + x] or (value == best[place + x] and rank < winners[place + x]):
            best[place + x], winners[place + x] = value, rank


@instruction(keep_best_of_four, AS_GIVEN, INDEX, INDEX, AS_GIVEN, INDEX, AS_GIVEN, AS_GIVEN, INDEX, INDEX)
def _build_keep_best(code, totals, at, spacing, ranks, first, best, winners, place, count):
    builder, is_float = code.builder, totals.element == REAL
    lanes, whole = vector(totals.element, EIGHT), vector(INTEGER, EIGHT)
    compare = builder.fcmp_ordered if is_float else builder.icmp_signed

    def larger(one, other):
        """Return which of two pairs of totals and ranks has the larger total, the first if they are equal."""
        swap = compare(">", other[0], one[0])
        return tuple(builder.select(swap, second, first) for first, second in zip(one, other, strict=True))

    rows = [totals.at(start) for start in code.steps(at, spacing, 4)]
    numbers = [code.broadcast(ranks.load(code.add(first, which), INTEGER), whole) for which in range(4)]
    best, winners, loop = best.at(place), winners.at(place), Loop(builder)
    x = loop.carry(PLACE(0))
    offsets = [(row.load(x, lanes), number) for row, number in zip(rows, numbers, strict=True)]
    value, rank = larger(larger(*offsets[:2]), larger(*offsets[2:]))
    previous, winner = best.load(x, lanes), winners.load(x, whole)
    is_larger, is_equal = compare(">", value, previous), compare("==", value, previous)
    is_better = builder.or_(is_larger, builder.and_(is_equal, builder.icmp_signed("<", rank, winner)))
    best.store(builder.select(is_larger, value, previous), x)
    winners.store(builder.select(is_better, rank, winner), x)
    loop.end(x, EIGHT, count)


def hide_outside(totals, first, last):
    """Set `OUTSIDE` totals before index `first` and from `last` on to -1, which never wins."""
    totals[first - OUTSIDE : first] = totals[last : last + OUTSIDE] = -1


@instruction(hide_outside, AS_GIVEN, INDEX, INDEX)
def _build_hide_outside(code, totals, first, last):
    lost = code.fill(-1, vector(totals.element, OUTSIDE))
    totals.store(lost, code.add(first, -OUTSIDE))
    totals.store(lost, last)


@njit(forceinline=True, **FINITE_JIT)
def find_candidates(offset, left, pixels, width):
    """Return the first pixel of a strip that an offset leads into the other frame, and that after the last one."""
    return max(0, -offset - left), min(pixels, width - offset - left)


@lru_cache(maxsize=32)
def rank_offsets(search_radius: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Order all offsets (dx, dy) within a search radius R by length, so that the smallest motion wins a tie.

    Return the rank of each offset, at ``[dy + R, dx + R]``, (2R + 1, 2R + 1) int32, and the offset of each rank,
    (number of ranks, 2) float32. Both arrays are shared by all callers and read-only.
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

    The patch size (2r + 1) x (2r + 1) is a compile-time constant, because the speed depends on unrolled horizontal
    sums. `taps` are the one-dimensional weights of a separable window; None for a box. The kernel is ``search(planes0,
    planes1, height, width, ranks, prices, found01, found10)``, with L = LANES:

    - `planes0`: (3, H + 2r, W + 2r + 2L or more) float32, scaled by `colour_scale`, edges repeated
    - `planes1`: (3, H + 2r, W + 2r + 4L or more) float32, the same; column L + r is the first of the image
    - `ranks`: (2R + 1, 2R + 1) int32, from `rank_offsets`
    - `prices`: (2R + 1, 2R + 1), the type of the similarity, from which they are subtracted; 0 for no motion
    - `found01`: BestOffsets, (H, W + L or more)
    - `found10`: BestOffsets, (H, W + 2L or more); column L is the first of the image
    """
    size = 2 * patch_radius + 1
    box = taps is None
    dtype: Any = np.int32 if box else np.float32
    at_once = 1 if box else ROWS_AT_ONCE
    slots = size + at_once - 1
    beyond = max(2 * patch_radius, OUTSIDE)
    weights = np.array(taps or (), np.float32)

    @njit(cache=True, **FINITE_JIT)
    def search(planes0, planes1, height, width, ranks, prices, found01, found10):  # noqa: C901 (loops share buffers)
        (best01, winners01), (best10, winners10) = found01, found10
        margin, search_radius = size - 1, len(ranks) // 2
        # a row of all offsets in line, behind what is overwritten before it
        room = GAP + OFFSETS_PER_PASS * ((min(STRIP_WIDTH, width) + beyond + 2 * LANES - 1) // LANES * LANES)
        ring, nothing = np.zeros((slots + 1) * room, dtype), GAP + slots * room
        totals_room = room + LANES
        totals = np.empty(at_once * totals_room, dtype)
        ranks01, ranks10 = np.zeros(OFFSETS_PER_PASS, np.int32), np.zeros(OFFSETS_PER_PASS, np.int32)
        flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
        stride0, stride1 = planes0.shape[2], planes1.shape[2]
        planes = FramePlanes(flat0, planes0.shape[1] * stride0, flat1, planes1.shape[1] * stride1)
        flat_best01, flat_winners01 = best01.reshape(best01.size), winners01.reshape(winners01.size)
        flat_best10, flat_winners10 = best10.reshape(best10.size), winners10.reshape(winners10.size)
        stride01, stride10 = best01.shape[1], best10.shape[1]
        last_group = search_radius // OFFSETS_PER_PASS
        for dy in range(-search_radius, search_radius + 1):
            top, bottom = max(0, -dy), min(height, height - dy)
            for left in range(0, width, STRIP_WIDTH):
                pixels = min(STRIP_WIDTH, width - left)
                for group in range(-last_group - 1, last_group + 1):
                    # the offset nearest to zero comes first, as its rank is lowest
                    step = 1 if group >= 0 else -1
                    nearest = OFFSETS_PER_PASS * (group if group >= 0 else group + 1) - (group < 0)
                    count = min(search_radius + 1 - abs(nearest), OFFSETS_PER_PASS)
                    begin, end = find_candidates(nearest, left, pixels, width)
                    if count <= 0 or begin >= end or top >= bottom:
                        continue
                    begin = begin // EIGHT * EIGHT
                    row_length = (end - begin + beyond + LANES - 1) // LANES * LANES
                    # offsets that are missing in the last four never win
                    totals[:] = -1
                    for which in range(count):
                        dx, start = nearest + step * which, GAP + which * row_length
                        totals[start : start + row_length] = -prices[search_radius + dy, search_radius + dx]
                        ranks01[which] = ranks[search_radius + dy, search_radius + dx]
                        ranks10[which] = ranks[search_radius - dy, search_radius - dx]
                    for row in range(top, bottom + margin):
                        y, newest = row - margin, GAP + row % slots * room
                        place0 = row * stride0 + left + begin
                        place1 = (row + dy) * stride1 + left + begin + LANES + nearest
                        rows = OffsetRows(place0, place1, step, count, row_length)
                        if box:
                            oldest = newest if row - top >= size else nothing
                            slide_boxes(planes, rows, size, ring, oldest, newest, totals, GAP)
                        else:
                            sum_windows_across(planes, rows, size, weights, ring, newest)
                        ready = (y - top) % at_once + 1
                        if y < top or (ready < at_once and y < bottom - 1):
                            continue
                        upper = y - ready + 1
                        if not box:
                            for which in range(count):
                                price = prices[search_radius + dy, search_radius + nearest + step * which]
                                start = GAP + which * row_length
                                window = Ring(ring, start, upper % slots, room)
                                sum_windows_down(window, weights, size, price, totals, start, totals_room, row_length)
                        for late in range(ready):
                            for first in range(0, count, 4):
                                dx, far = nearest + step * first, nearest + step * (first + 3)
                                origin = late * totals_room + GAP + first * row_length + margin - begin
                                # targets outside of the other frame are not candidates
                                for which in range(4):
                                    start, stop = find_candidates(dx + step * which, left, pixels, width)
                                    at = origin + which * row_length
                                    hide_outside(totals, at + start, at + stop)
                                start, stop = find_candidates(dx, left, pixels, width)
                                if start >= stop:
                                    continue
                                start = start // EIGHT * EIGHT
                                keep_best_of_four(
                                    totals, origin + start, row_length, ranks01, first,
                                    flat_best01, flat_winners01, (upper + late) * stride01 + left + start, stop - start,
                                )  # fmt: skip
                                # each total is shifted by its offset, so that the four refer to the same target
                                start = max(min(dx, far), -left) // EIGHT * EIGHT
                                stop = min(pixels + max(dx, far), width - left)
                                place10 = (upper + late + dy) * stride10 + left + LANES + start
                                keep_best_of_four(
                                    totals, origin - dx + start, row_length - step, ranks10, first,
                                    flat_best10, flat_winners10, place10, stop - start,
                                )  # fmt: skip

    return search
