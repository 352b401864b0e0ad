"""Search for the most similar patch: the report's Algorithm 1 for both directions in one pass.

For one offset k the similarity image ``W_k(x) = xi(A(x), B(x + k))`` serves both fields: summed over the patch it is
the score of k at x for A->B, and the score of -k at x + k for B->A. So every offset is computed once, row by row, and
nothing the size of a frame is ever stored: a running column sum over the last 2r + 1 rows of W, a short horizontal
sum, two comparisons. Offsets go in pairs of neighbours, which share what is read of A and of the best so far.

Rows of A are dealt to the threads in bands. All threads work on one vertical offset at a time, so the rows of B that
they update are as disjoint as their rows of A.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.similarity import similarity

STRIP = 640
"""Columns per pass: wide enough that the margins of a patch are cheap, narrow enough for the caches."""

BAND = 192
"""Largest number of rows per band."""

PAIRS = 4
"""Pairs of offsets that go down the rows together, so that the rows they read stay in the first-level cache."""


@njit(inline="always", **FINITE_JIT)
def centre_out(k):
    """0, 1, 2, 3, ... -> 0, 1, -1, -2, 2, 3, -3, -4, ...: pairs of neighbours, the smaller motion first.

    Comparisons are strict, so the offset that comes first wins a tie.
    """
    pair = k // 2
    return pair + k % 2 if pair % 2 == 0 else -(pair + k % 2)


@njit(inline="always", **FINITE_JIT)
def keep_better(total0, total1, code0, code1, width, best, index):
    """Where one of two totals beats `best`, take it and its code."""
    for x in range(width):
        first, second, previous = total0[x], total1[x], best[x]
        swap = second > first
        value = second if swap else first
        code = code1 if swap else code0
        better = value > previous
        best[x] = value if better else previous
        index[x] = code if better else index[x]


@lru_cache(maxsize=32)
def exhaustive_kernel(patch_radius: int, taps: tuple[float, ...] | None = None) -> Callable[..., None]:
    """Compile the exhaustive search for one patch.

    The patch size is a constant of the compiled code, because unrolled horizontal sums are what makes it fast.

    Parameters
    ----------
    patch_radius : int
        r; the patch has (2r + 1) x (2r + 1) pixels.
    taps : tuple of 2r + 1 float or None
        One-dimensional weights of a separable window; None for the box.

    Returns
    -------
    callable
        ``search(planes0, planes1, height, width, search_radius, best01, index01, best10, index10)``, with
        M = search_radius + 2 and L = LANES:

        planes0 : (3, H + 2r, W + 2r + L) float32, scaled by `colour_scale`, edges repeated
        planes1 : (3, H + 2r, W + 2r + 2M + L) float32, the same
        best01 : (H, W + L) int32 (box) or float32 (taps), -1 at the start; the summed similarity
        best10 : (H, W + 2M + 2L), the same; column M is the first of the image
        index01, index10 : int32, shaped like best; ``(dy + R) * (2R + 1) + dx + R`` of the best offset k, which is
        the motion in index01 and its negative in index10
    """
    size = 2 * patch_radius + 1
    fives, rest = divmod(size, 5)
    reach = (size + LANES - 1) // LANES * LANES
    dtype: Any = np.int32 if taps is None else np.float32
    ring_rows = size if taps is None else 2 * size
    weights = np.array(taps or (), np.float32)

    if taps is None:

        @njit(inline="always", **FINITE_JIT)
        def slide(a0, a1, a2, b0, b1, b2, slot, width, ring, column):
            oldest = ring[slot]
            for x in range(width):
                w = np.int32(similarity(a0[x], a1[x], a2[x], b0[x], b1[x], b2[x]))
                column[x] += w - oldest[x]
                oldest[x] = w

        @njit(inline="always", **FINITE_JIT)
        def across(column, width, partial, total):
            for x in range(width + reach):
                partial[x] = column[x] + column[x + 1] + column[x + 2] + column[x + 3] + column[x + 4]
            for x in range(width):
                value = np.int32(0)
                for k in range(fives):
                    value += partial[x + 5 * k]
                for k in range(rest):
                    value += column[x + 5 * fives + k]
                total[x] = value

    else:

        @njit(inline="always", **FINITE_JIT)
        def slide(a0, a1, a2, b0, b1, b2, slot, width, ring, column):
            # every row is stored twice, a window apart, so that the window is always contiguous
            newest, again = ring[slot], ring[slot + size]
            for x in range(width):
                w = np.float32(similarity(a0[x], a1[x], a2[x], b0[x], b1[x], b2[x]))
                newest[x] = w
                again[x] = w
            window = ring[slot + 1 : slot + 1 + size]
            for x in range(width):
                value = np.float32(0)
                for k in range(size):
                    value += weights[k] * window[k, x]
                column[x] = value

        @njit(inline="always", **FINITE_JIT)
        def across(column, width, partial, total):
            for x in range(width):
                value = np.float32(0)
                for k in range(size):
                    value += weights[k] * column[x + k]
                total[x] = value

    @njit(parallel=True, cache=True, **FINITE_JIT)
    def search(planes0, planes1, height, width, search_radius, best01, index01, best10, index10):
        margin = size - 1
        side = 2 * search_radius + 1
        shift = search_radius + 2
        bands = (height + BAND - 1) // BAND
        rows = (height + bands - 1) // bands
        room = STRIP + margin + 2 * LANES
        for vertical in range(side):
            dy = centre_out(vertical)
            for number in prange(bands):
                band = np.int64(number)  # the loop's own index is unsigned
                top, bottom = max(band * rows, -dy), min((band + 1) * rows, height, height - dy)
                if top >= bottom:
                    continue
                rings = np.empty((2 * PAIRS, ring_rows, room), dtype)
                columns = np.empty((2 * PAIRS, room + reach + LANES), dtype)
                partial = np.empty(room + reach, dtype)
                # a column before the first pixel and some behind the last are no candidates: pairs read over the edge
                totals = np.full((2, room + LANES), -1, dtype)
                for left in range(0, width, STRIP):
                    pixels = min(STRIP, width - left)
                    whole = (pixels + LANES - 1) // LANES * LANES
                    spread = (pixels + margin + LANES - 1) // LANES * LANES
                    for group in range(0, search_radius + 1, PAIRS):
                        rings[:] = 0
                        columns[:] = 0
                        for row in range(top, bottom + margin):
                            y = row - margin
                            for pair in range(group, min(group + PAIRS, search_radius + 1)):
                                dx = min(centre_out(2 * pair), centre_out(2 * pair + 1))
                                start = left + shift + dx
                                for which in range(2):
                                    column = columns[2 * (pair - group) + which]
                                    begin, end = start + which, start + which + spread
                                    # one slice a plane: a slice of all three would be strided and would not vectorise
                                    slide(
                                        planes0[0, row, left : left + spread],
                                        planes0[1, row, left : left + spread],
                                        planes0[2, row, left : left + spread],
                                        planes1[0, row + dy, begin:end],
                                        planes1[1, row + dy, begin:end],
                                        planes1[2, row + dy, begin:end],
                                        row % size,
                                        spread,
                                        rings[2 * (pair - group) + which],
                                        column,
                                    )
                                    if y < top:
                                        continue
                                    total, offset = totals[which, 1:], dx + which
                                    across(column, whole, partial, total)
                                    # targets outside of the other frame are no candidates
                                    first, last = max(0, -offset - left), min(pixels, width - offset - left)
                                    if abs(offset) > search_radius:
                                        last = 0
                                    total[: min(first, pixels)] = -1
                                    total[max(0, last) : whole + LANES] = -1
                                if y < top:
                                    continue
                                code = np.int32((dy + search_radius) * side + search_radius + dx)
                                near, far = (0, 1) if dx >= 0 else (1, 0)
                                keep_better(
                                    totals[near, 1:],
                                    totals[far, 1:],
                                    np.int32(code + near),
                                    np.int32(code + far),
                                    whole,
                                    best01[y, left:],
                                    index01[y, left:],
                                )
                                keep_better(
                                    totals[near, 1 - near :],
                                    totals[far, 1 - far :],
                                    np.int32(code + near),
                                    np.int32(code + far),
                                    whole + LANES,
                                    best10[y + dy, start:],
                                    index10[y + dy, start:],
                                )

    return search
