"""Detection of static overlays on moving frames: titles, logos, the car that the camera follows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import Index
from fpsboost.kernels.jit import JIT, borrowed, njit

STAYS, STANDS_OUT = 1, 2


class Frames(NamedTuple):
    """Luma of a pair and of the frames before and after it, (H, W) uint8 or uint16; an overlay is the same in all."""

    image0: NDArray[Any]
    image1: NDArray[Any]
    before: NDArray[Any]
    after: NDArray[Any]


@njit(inline="always", **JIT)
def difference(one, other, as_code):
    """Return the absolute difference of two code values in their type, of which a vector holds more than of int64."""
    return as_code(max(one, other) - min(one, other))


@njit(inline="always", **JIT)
def motion_of_block(vector, shortest):
    """Return whether a motion is so short that its block counts as static, and the motion in whole pixels."""
    return max(abs(vector[0]), abs(vector[1])) < shortest, int(np.rint(vector[0])), int(np.rint(vector[1]))


@njit(inline="always", **JIT)
def find_smallest_change(frames, y, left, right, dx, dy, smallest):
    """Write how much some pixels of row y would change at least if they had moved along, from `left` to `right`.

    One of the frames would show the pixel's luma on one side or the other. It is 0 where that is outside.
    """
    image0, image1, before, after = frames
    height, width = image0.shape
    as_code = image0.dtype.type
    smallest[left:right] = as_code((1 << 8 * image0.itemsize) - 1)
    here = Index(y)
    for sign in (-1, 1):
        there, moved = y + sign * dy, sign * dx
        first, last = min(max(-moved, left), right), max(min(width - moved, right), left)
        if there < 0 or there >= height or first >= last:
            smallest[left:right] = 0
            break
        smallest[left:first] = 0
        smallest[last:right] = 0
        begin, source, size = Index(first), Index(first + moved), Index(last - first)
        for i in range(size):
            luma = image0[here, begin + i]
            smallest[begin + i] = min(
                smallest[begin + i],
                difference(image0[Index(there), source + i], luma, as_code),
                difference(image1[Index(there), source + i], luma, as_code),
                difference(before[Index(there), source + i], luma, as_code),
                difference(after[Index(there), source + i], luma, as_code),
            )


@njit(inline="always", **JIT)
def mark_static(frames, y, most, row):
    """Write STAYS for the pixels of row y that change by at most `most` code values, else 0."""
    image0, image1, before, after = frames
    as_code, here = image0.dtype.type, Index(y)
    for x in range(Index(row.size)):
        luma = image0[here, x]
        largest = max(
            difference(image1[here, x], luma, as_code),
            difference(before[here, x], luma, as_code),
            difference(after[here, x], luma, as_code),
        )
        row[x] = np.uint8(STAYS) if largest <= most else np.uint8(0)


@njit(cache=True, **JIT)
def mark_overlay(frames, motion, spacing, shortest, same, different, smallest, marks):
    """Find the pixels that stay the same although their surroundings move.

    - `motion`: of the surroundings of each block of `spacing` pixels, to frame 1, (rows, columns, 2) float32
    - `shortest`: motion below which the surroundings count as static, pixels
    - `same`, `different`: difference in code values up to which a pixel is the same, and above which it is different
    - `smallest`: work array, (W,) in the type of the frames
    - `marks`: (H, W) uint8 out: STAYS where a pixel stays the same; STANDS_OUT where it would also be different if it
      had moved; else 0
    """
    frames, motion, smallest, marks = borrowed((frames, motion, smallest, marks))
    (height, width), as_code = marks.shape, frames.image0.dtype.type
    most, least = as_code(same), as_code(different)
    for top in range(0, height, spacing):
        rows, vectors = range(top, min(top + spacing, height)), motion[top // spacing]
        for y in rows:
            mark_static(frames, y, most, marks[y])
        end = 0
        while end < len(vectors):
            # neighbouring blocks that move alike are one, because short loops are slow
            first_block, shared = end, motion_of_block(vectors[end], shortest)
            while end < len(vectors) and motion_of_block(vectors[end], shortest) == shared:
                end += 1
            still, dx, dy = shared
            left, right = first_block * spacing, min(end * spacing, width)
            for y in rows:
                row = marks[y]
                if still:
                    row[left:right] = 0
                    continue
                find_smallest_change(frames, y, left, right, dx, dy, smallest)
                for x in range(Index(left), Index(right)):
                    stands_out = (smallest[x] > least) & (row[x] == np.uint8(STAYS))
                    row[x] = np.uint8(STANDS_OUT) if stands_out else row[x]
