"""Block matching as in video coding: for every block of one frame, find the best-matching block of the other frame.

The best match has the lowest sum of absolute differences; of equally good matches, the nearest one. Images are given as
rows of values with the channels of a pixel side by side, so that a row of a block is contiguous in memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import JIT, njit

MAX_SUM = 2**62
"""Initial minimum, larger than any sum of absolute differences."""


class SearchPlan(NamedTuple):
    """Passes and offsets that `match_blocks` tries."""

    offsets: NDArray[np.int32]
    """``(dy, dx)`` to try relative to the best position so far, pass by pass, (N, 2); the first is no motion."""
    turns: NDArray[np.int32]
    """Pass k tries ``offsets[turns[k]:turns[k + 1]]``, all relative to the best position before the pass, (T + 1,)."""
    repeated: NDArray[np.bool_]
    """Whether a pass is repeated for as long as it finds a better position, (T,)."""


@njit(**JIT)
def sum_of_differences(rows0, rows1, channels, block, dy, dx, limit, kind):
    """Return the sum of absolute differences of a block and its match at ``(dx, dy)``, stopping above the limit."""
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
def match_blocks(rows0, rows1, channels, block_size, search_range, plan, motion, difference):
    """Find the best match in the second image for every block of the first.

    - `rows0`, `rows1`: (H, W * channels) uint8, uint16 or float32
    - `block_size`: side of a block, pixels; blocks at the right and at the bottom edge may be smaller
    - `search_range`: largest motion along x and y, pixels; positions outside of the frame are not considered
    - `motion`: ``(dx, dy)``, (rows, columns, 2) int32 out
    - `difference`: sums of absolute differences, (rows, columns) int64, for float images float32, out
    """
    offsets, turns, repeated = plan
    height, width = rows0.shape[0], rows0.shape[1] // channels
    kind = difference.dtype.type
    for row, column in np.ndindex(difference.shape):
        top, left = row * block_size, column * block_size
        bottom, right = min(top + block_size, height), min(left + block_size, width)
        best_y, best_x, least = np.int64(0), np.int64(0), kind(MAX_SUM)
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
