"""Search for the shortest motion around each point that explains the point about as well as its own motion.

In a repeated pattern, many motions are equally similar, and a search for the most similar patch returns any of them.
Comparison with the shorter motions of the surroundings shows which length is necessary.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import Index
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.planes import flatten
from fpsboost.kernels.similarity import similarity


class ShortestMotion(NamedTuple):
    """Motion that explains each point, (points down, points across) float32."""

    own: NDArray[Any]
    """Similarity of the point's own motion, 0 to 1; negative where it leads out of the frame."""
    best: NDArray[Any]
    """Largest similarity of all motions compared."""
    shortest: NDArray[Any]
    """Larger component of the shortest motion whose similarity is sufficient, pixels."""


@njit(inline="always", **FINITE_JIT)
def compare_along(pair, flat, y, x, dy, dx, radius, columns):
    """Return the sum of the similarities of the patches at both ends of a motion; -1 if it leads out of the frame.

    `columns` is a work array for the sums of the columns that are compared at once.
    """
    flat0, flat1, plane, stride = flat
    there_y, there_x, padding = y + dy, x + dx, pair.padding
    if there_y < 0 or there_x < 0 or there_y >= pair.height or there_x >= pair.width:
        return np.int32(-1)
    start0 = Index((y - radius + padding) * stride + x - radius + padding)
    start1 = Index((there_y - radius + padding) * stride + there_x - radius + padding)
    columns[:] = 0
    for _ in range(2 * radius + 1):
        for i in range(Index(columns.size)):
            columns[i] += similarity(
                flat0[start0 + i],
                flat0[start0 + plane + i],
                flat0[start0 + plane + plane + i],
                flat1[start1 + i],
                flat1[start1 + plane + i],
                flat1[start1 + plane + plane + i],
            )
        start0 += Index(stride)
        start1 += Index(stride)
    total = np.int32(0)
    for i in range(2 * radius + 1):
        total += columns[i]
    return total


@njit(cache=True, **FINITE_JIT)
def find_shortest(pair, step, patch_radius, lanes, support_radius, tolerance, flow, motion):
    """Compare each point's motion with the motions of the points around it, and with zero motion.

    - `pair`: float32, scaled by `colour_scale`; the padding is larger than the radius
    - `step`: distance between points, pixels
    - `patch_radius`: radius r of the compared patch, pixels
    - `lanes`: columns compared at once, at least 2r + 1
    - `support_radius`: points in each direction whose motion is compared
    - `tolerance`: amount by which the similarity of a shorter motion may be lower
    - `flow`: (points down, points across, 2) float32; rounded to whole pixels for the comparison
    """
    _, _, _, height, width, max_similarity = pair
    (own, best, shortest), flat = motion, flatten(pair)
    share = np.float32(1 / (max_similarity * (2 * patch_radius + 1) ** 2))
    rows, points = flow.shape[:2]
    for row in range(rows):
        columns = np.empty(lanes, np.int32)
        for point in range(points):
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            dy, dx = int(np.rint(flow[row, point, 1])), int(np.rint(flow[row, point, 0]))
            total = compare_along(pair, flat, y, x, dy, dx, patch_radius, columns)
            own[row, point] = np.float32(total) * share
            min_similarity = own[row, point] - tolerance
            least = max(abs(flow[row, point, 0]), abs(flow[row, point, 1]))
            still = compare_along(pair, flat, y, x, 0, 0, patch_radius, columns)
            most = max(own[row, point], np.float32(still) * share)
            if np.float32(still) * share >= min_similarity:
                least = np.float32(0)
            last_dy, last_dx = dy, dx
            for other_row in range(max(row - support_radius, 0), min(row + support_radius, rows - 1) + 1):
                for other in range(max(point - support_radius, 0), min(point + support_radius, points - 1) + 1):
                    other_dy = int(np.rint(flow[other_row, other, 1]))
                    other_dx = int(np.rint(flow[other_row, other, 0]))
                    if other_dy == last_dy and other_dx == last_dx:
                        continue  # usually equal to its neighbour
                    last_dy, last_dx = other_dy, other_dx
                    total = compare_along(pair, flat, y, x, other_dy, other_dx, patch_radius, columns)
                    value = np.float32(total) * share
                    most = max(most, value)
                    if value >= min_similarity:
                        least = min(least, np.float32(max(abs(other_dy), abs(other_dx))))
            best[row, point] = most
            shortest[row, point] = least
