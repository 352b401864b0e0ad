"""Block matching as video coding does it: for every block of one frame, the most similar place in the other.

Most similar is what has the lowest sum of absolute differences; of several such places, the nearest. Images come as
rows of values, the channels of a pixel side by side, so that a row of a block is one run of memory.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import JIT

UNLIMITED = 2**62
"""More than any sum."""


@njit(**JIT)
def sum_of_differences(rows0, rows1, channels, block, dy, dx, limit, kind):
    """Absolute differences of a block and what lies ``(dx, dy)`` away; beyond the limit, the rest is left out."""
    top, left, bottom, right = block
    total = kind(0)
    for y in range(top, bottom):
        here = rows0[y, left * channels : right * channels]
        there = rows1[y + dy, (left + dx) * channels : (right + dx) * channels]
        for i in range(here.shape[0]):
            total += abs(kind(here[i]) - kind(there[i]))
        if total > limit:
            break
    return total


@njit(cache=True, **JIT)
def match_blocks(rows0, rows1, channels, block_size, search_range, offsets, turns, repeated, motion, difference):
    """Find every block of the first image in the second.

    Parameters
    ----------
    rows0, rows1 : (H, W * channels) uint8, uint16 or float32
    channels : int
    block_size : int
        Side of a block; those at the right and at the bottom edge have what is left.
    search_range : int
        Largest motion along x and y, pixels; places that are not within the frame do not count.
    offsets : (N, 2) int32
        ``(dy, dx)`` that are tried from the best place so far, turn after turn; the first is no motion.
    turns : (T + 1,) int32
        Turn k tries ``offsets[turns[k]:turns[k + 1]]``, all from the place that was the best before it.
    repeated : (T,) bool
        Turns that come again for as long as they find a better place.
    motion : (rows, columns, 2) int32
        Out: ``(dx, dy)``.
    difference : (rows, columns) int64, for float images float32
        Out: the sum of absolute differences.
    """
    height, width = rows0.shape[0], rows0.shape[1] // channels
    kind = difference.dtype.type
    for row, column in np.ndindex(difference.shape):
        top, left = row * block_size, column * block_size
        bottom, right = min(top + block_size, height), min(left + block_size, width)
        best_y, best_x, least = np.int64(0), np.int64(0), kind(UNLIMITED)
        for turn in range(repeated.shape[0]):
            again = True
            while again:
                again = False
                centre_y, centre_x = best_y, best_x
                for k in range(turns[turn], turns[turn + 1]):
                    dy, dx = centre_y + np.int64(offsets[k, 0]), centre_x + np.int64(offsets[k, 1])
                    if max(abs(dy), abs(dx)) > search_range or min(top + dy, left + dx) < 0:
                        continue
                    if bottom + dy > height or right + dx > width:
                        continue
                    block = top, left, bottom, right
                    total = sum_of_differences(rows0, rows1, channels, block, dy, dx, least, kind)
                    nearer = dy * dy + dx * dx < best_y * best_y + best_x * best_x
                    if total < least or (total == least and nearer):
                        best_y, best_x, least = dy, dx, total
                        again = repeated[turn]
        motion[row, column, 0], motion[row, column, 1] = best_x, best_y
        difference[row, column] = least
