"""Search by tiles over the distinct offsets that a coarser level proposes.

Neighbouring pixels mostly propose the same few offsets. So for each tile the distinct proposals in and around it are
gathered once, each with its neighbours, and the summed similarity of every one of them is computed over the whole tile
with running sums: the cost a pixel is that of a few dozen offsets, whatever the search radius.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit, prange

from fpsboost.kernels.box import slide_box, sum_box_across
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.similarity import UNIT

TILE = 32
"""Side of a tile, pixels."""

AROUND = 8
"""Proposals are gathered this far beyond the tile, pixels."""

EVERY = 4
"""One pixel in so many, along x and y, has its proposal gathered."""

TOGETHER = 8
"""Tiles that a thread takes at once; they share a table of flags, which is large and of which each clears its own."""

PADDING = TILE + LANES
"""How far beyond the frame a tile may be compared, pixels."""


@njit(**FINITE_JIT)
def gather_offsets(guess, top, left, bottom, right, reach, limit, seen, offsets):
    """List the distinct offsets within `reach` of any guess in a window; returns how many.

    `seen` is (2 limit + 1)^2 flags, false at the start and at the end; `offsets` (2, capacity) out.
    """
    count = 0
    for y in range(top, bottom, EVERY):
        for x in range(left, right, EVERY):
            dx, dy = guess[y, x, 0], guess[y, x, 1]
            for oy in range(max(dy - reach, -limit), min(dy + reach, limit) + 1):
                for ox in range(max(dx - reach, -limit), min(dx + reach, limit) + 1):
                    if count < offsets.shape[1] and not seen[oy + limit, ox + limit]:
                        seen[oy + limit, ox + limit] = True
                        offsets[0, count], offsets[1, count] = oy, ox
                        count += 1
    for k in range(count):
        seen[offsets[0, k] + limit, offsets[1, k] + limit] = False
    return count


@lru_cache(maxsize=8)
def tile_kernel(patch_radius: int) -> Callable[..., None]:
    """Compile the tile search for one patch size.

    Parameters
    ----------
    patch_radius : int
        r; the patch has (2r + 1) x (2r + 1) pixels.

    Returns
    -------
    callable
        ``search(planes0, planes1, guess, reach, limit, penalty, best, flow)``:

        planes0, planes1 : (3, H + 2 p, W + 2 p + LANES) float32 with p = PADDING + r, scaled by `colour_scale`
        guess : (H, W, 2) int32, proposed motion (dx, dy)
        reach : int, how far around each proposal to search; limit : int, largest offset
        penalty : float32, what a pixel of distance from the own proposal costs, in units of similarity (0 to 1)
        best : (H, W) float32 out, mean similarity less the penalty
        flow : (H, W, 2) float32 out, whole pixels
    """
    size = 2 * patch_radius + 1
    spread = (TILE + 2 * patch_radius + LANES - 1) // LANES * LANES
    room = spread + size + 2 * LANES
    share = np.float32(1 / (UNIT * size * size))

    @njit(parallel=True, cache=True, **FINITE_JIT)
    def search(planes0, planes1, guess, reach, limit, penalty, best, flow):
        height, width = guess.shape[:2]
        rows, columns_of_tiles = (height + TILE - 1) // TILE, (width + TILE - 1) // TILE
        samples = ((TILE + 2 * AROUND) // EVERY) ** 2
        capacity = min((2 * limit + 1) ** 2, samples * (2 * reach + 1) ** 2)
        tiles = rows * columns_of_tiles
        for number in prange((tiles + TOGETHER - 1) // TOGETHER):
            chunk = np.int64(number)  # the loop's own index is unsigned
            seen = np.zeros((2 * limit + 1, 2 * limit + 1), np.bool_)
            for tile in range(chunk * TOGETHER, min((chunk + 1) * TOGETHER, tiles)):
                top, left = tile // columns_of_tiles * TILE, tile % columns_of_tiles * TILE
                bottom, right = min(top + TILE, height), min(left + TILE, width)
                offsets = np.empty((2, capacity), np.int32)
                count = gather_offsets(
                    guess,
                    max(0, top - AROUND),
                    max(0, left - AROUND),
                    min(height, bottom + AROUND),
                    min(width, right + AROUND),
                    reach,
                    limit,
                    seen,
                    offsets,
                )
                ring = np.empty((size, room), np.int32)
                column = np.empty(room, np.int32)
                partial = np.empty(room, np.int32)
                total = np.empty(TILE, np.int32)
                tile_best = np.full((TILE, TILE), np.float32(-2))
                tile_x = np.zeros((TILE, TILE), np.int32)
                tile_y = np.zeros((TILE, TILE), np.int32)
                tile_guess_x = np.zeros((TILE, TILE), np.float32)
                tile_guess_y = np.zeros((TILE, TILE), np.float32)
                tile_guess_x[: bottom - top, : right - left] = guess[top:bottom, left:right, 0]
                tile_guess_y[: bottom - top, : right - left] = guess[top:bottom, left:right, 1]
                for k in range(count):
                    dy, dx = offsets[0, k], offsets[1, k]
                    # the first pixel of the patch around the tile's first pixel, in padded coordinates
                    x0, x1 = left + PADDING, left + PADDING + dx
                    if min(top + dy, left + dx) < -TILE or bottom + dy > height + TILE or right + dx > width + TILE:
                        continue  # hardly anything of the tile would be inside
                    ring[:] = 0
                    column[:] = 0
                    float_x, float_y = np.float32(dx), np.float32(dy)
                    for row in range(bottom - top + size - 1):
                        y0 = top + PADDING + row
                        y1 = y0 + dy
                        slide_box(
                            planes0[0, y0, x0 : x0 + spread],
                            planes0[1, y0, x0 : x0 + spread],
                            planes0[2, y0, x0 : x0 + spread],
                            planes1[0, y1, x1 : x1 + spread],
                            planes1[1, y1, x1 : x1 + spread],
                            planes1[2, y1, x1 : x1 + spread],
                            row % size,
                            spread,
                            ring,
                            column,
                        )
                        if row < size - 1:
                            continue
                        sum_box_across(column, size, TILE, np.int32(0), partial, total)
                        y = row - size + 1
                        row_best, row_x, row_y = tile_best[y], tile_x[y], tile_y[y]
                        row_guess_x, row_guess_y = tile_guess_x[y], tile_guess_y[y]
                        for x in range(TILE):
                            distance = abs(float_x - row_guess_x[x]) + abs(float_y - row_guess_y[x])
                            value = np.float32(total[x]) * share - penalty * distance
                            previous = row_best[x]
                            better = value > previous
                            row_best[x] = value if better else previous
                            row_x[x] = dx if better else row_x[x]
                            row_y[x] = dy if better else row_y[x]
                best[top:bottom, left:right] = tile_best[: bottom - top, : right - left]
                flow[top:bottom, left:right, 0] = tile_x[: bottom - top, : right - left]
                flow[top:bottom, left:right, 1] = tile_y[: bottom - top, : right - left]

    return search
