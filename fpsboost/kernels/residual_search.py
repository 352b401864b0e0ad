"""Residual search for small objects that the motion of their surroundings does not explain.

A patch that is much larger than an object follows the background, and the object is lost on the coarsest level already.
But then neither the object nor, in the other frame, its new position has a match along the motion of the surroundings.
Points that small patches do not explain are therefore compared with the points of the other frame that are not
explained either.
"""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.instruction import SIXTEEN, Index
from fpsboost.kernels.jit import FINITE_JIT, JIT, njit
from fpsboost.kernels.planes import flatten, opposite
from fpsboost.kernels.points import forward_backward_vector_error
from fpsboost.kernels.similarity import compare_one, compare_sixteen


@njit(**FINITE_JIT)
def compare_row(flat, start0, start1, radius, count, max_similarity, share, most, total):
    """Sum the similarities of the patch around one position and those around SIXTEEN positions in a row.

    Return False as soon as none of the first `count` sums, times `share`, can exceed `most`, else True.
    """
    flat0, flat1, plane, stride = flat
    total[:] = 0
    for j in range(-radius, radius + 1):
        for k in range(-radius, radius + 1):
            here, there = Index(start0 + j * stride + k), Index(start1 + j * stride + k)
            compare_one(flat0, here, flat1, there, plane, max_similarity, total, 0, 0)
        highest = np.int32(0)
        for i in range(Index(count)):
            highest = max(highest, np.int32(total[i]))
        if np.float32(highest + (radius - j) * (2 * radius + 1) * np.int64(max_similarity)) * share <= most:
            return False
    return True


@njit(**FINITE_JIT)
def measure_point_similarity(pair, step, patch_radius, flow, similarity):
    """Measure the similarity, 0 to 1, of the small patches at both ends of every point's motion.

    - `pair`: in levels; the padding is larger than the radius
    - `step`: distance between points, pixels
    - `patch_radius`: radius r of the small patch, at most 7 pixels
    - `flow`: (points down, points across, 2) float32
    - `similarity`: (points down, points across) float32 out
    """
    _, _, padding, height, width, max_similarity = pair
    flat0, flat1, plane, stride = flatten(pair)
    share = np.float32(1 / (np.int64(max_similarity) * (2 * patch_radius + 1) ** 2))
    for row in range(flow.shape[0]):
        columns = np.empty(SIXTEEN, np.uint16)
        for point in range(flow.shape[1]):
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            there_y = min(max(y + int(np.rint(flow[row, point, 1])), 0), height - 1)
            there_x = min(max(x + int(np.rint(flow[row, point, 0])), 0), width - 1)
            start0 = Index((y - patch_radius + padding) * stride + x - patch_radius + padding)
            start1 = Index((there_y - patch_radius + padding) * stride + there_x - patch_radius + padding)
            columns[:] = 0
            for _ in range(2 * patch_radius + 1):
                compare_sixteen(flat0, start0, flat1, start1, plane, max_similarity, columns, 0, 0)
                start0 += Index(stride)
                start1 += Index(stride)
            total = np.int32(0)
            for i in range(2 * patch_radius + 1):
                total += columns[i]
            similarity[row, point] = np.float32(total) * share


@njit(**FINITE_JIT)
def search_residuals(pair, step, max_offset, patch_radius, similarity, elsewhere, min_similarity, better, flow):
    """Replace the motion of unexplained points by motion to unexplained positions of the other frame, in whole pixels.

    - `max_offset`: maximum offset along x and y, pixels
    - `similarity`, `elsewhere`: by `measure_point_similarity`, for this frame and for the other one
    - `min_similarity`: similarity at which a point counts as explained
    - `better`: minimum increase of the similarity by another motion
    - `flow`: updated in place
    """
    _, _, padding, height, width, max_similarity = pair
    flat = flatten(pair)
    stride = flat.stride
    share = np.float32(1 / (np.int64(max_similarity) * (2 * patch_radius + 1) ** 2))
    rows, columns = similarity.shape
    for row in range(rows):
        total = np.empty(SIXTEEN, np.uint16)
        for point in range(columns):
            if similarity[row, point] >= min_similarity:
                continue
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            start0 = (y + padding) * stride + x + padding
            most = similarity[row, point] + better
            top, bottom = max(y - max_offset, 0), min(y + max_offset, height - 1)
            left, right = max(x - max_offset, 0), min(x + max_offset, width - 1)
            for other_row in range(top // step, bottom // step + 1):
                other_point, behind = left // step, right // step + 1
                while other_point < behind:
                    if elsewhere[other_row, other_point] >= min_similarity:
                        other_point += 1
                        continue
                    # unexplained neighbours are compared together, up to one vector of pixels
                    begin = other_point
                    while (
                        other_point < behind
                        and (other_point + 1 - begin) * step <= SIXTEEN
                        and elsewhere[other_row, other_point] < min_similarity
                    ):
                        other_point += 1
                    first, last = max(begin * step, left), min(other_point * step - 1, right)
                    for there_y in range(max(other_row * step, top), min(other_row * step + step - 1, bottom) + 1):
                        start1 = (there_y + padding) * stride + first + padding
                        count = last - first + 1
                        if not compare_row(
                            flat, start0, start1, patch_radius, count, max_similarity, share, most, total
                        ):
                            continue
                        for i in range(count):
                            value = np.float32(total[i]) * share
                            if value > most:
                                most = value
                                flow[row, point, 0] = np.float32(first + i - x)
                                flow[row, point, 1] = np.float32(there_y - y)


@njit(**FINITE_JIT)
def find_lowest_neighbours(values, lowest):
    """Write the minimum of each value and its eight neighbours."""
    rows, columns = values.shape
    for row in range(rows):
        for column in range(columns):
            least = values[row, column]
            for y in range(max(row - 1, 0), min(row + 2, rows)):
                for x in range(max(column - 1, 0), min(column + 2, columns)):
                    least = min(least, values[y, x])
            lowest[row, column] = least


@njit(cache=True, **FINITE_JIT)
def search_residuals_bidirectional(pair, step, max_offset, patch_radius, min_similarity, better, flow):
    """Search both frames like `search_residuals`; `flow` has both directions and is updated in place.

    A position in the other frame counts as unexplained if one of its neighbours is.
    """
    similarity = np.empty(flow.shape[:3], np.float32)
    around = np.empty_like(similarity)
    for direction in range(2):
        measure_point_similarity(pair, step, patch_radius, flow[direction], similarity[direction])
        find_lowest_neighbours(similarity[direction], around[direction])
        pair = opposite(pair)
    for direction in range(2):
        here, there = similarity[direction], around[1 - direction]
        search_residuals(pair, step, max_offset, patch_radius, here, there, min_similarity, better, flow[direction])
        pair = opposite(pair)


@njit(cache=True, **JIT)
def loosen_ties(flow, before, step, tolerance, weak, ties):
    """Give points with new motion that the other frame confirms a smaller share of the smoothness.

    - `flow`, `before`: motion in both directions after and before the residual search, (2, points down, points across,
      2) float32; new motion differs by more than a pixel along x or y
    - `step`: distance between points, pixels
    - `tolerance`: maximum forward-backward error of new motion, pixels
    - `weak`: share of the smoothness that applies to points with such motion; 1 applies to all others
    - `ties`: (2, points down, points across) float32 out
    """
    _, rows, columns = ties.shape
    # in units of points: the way back is that of the point nearest to the end of a vector, not of its pixel
    in_points = np.empty_like(flow)
    for direction in range(2):
        for row in range(rows):
            for point in range(columns):
                in_points[direction, row, point, 0] = flow[direction, row, point, 0] / step
                in_points[direction, row, point, 1] = flow[direction, row, point, 1] / step
    for direction in range(2):
        there, back = in_points[direction], in_points[1 - direction]
        for row in range(rows):
            for point in range(columns):
                change_x = abs(flow[direction, row, point, 0] - before[direction, row, point, 0])
                change_y = abs(flow[direction, row, point, 1] - before[direction, row, point, 1])
                dx, dy = there[row, point, 0], there[row, point, 1]
                distance, _ = forward_backward_vector_error(dx, dy, back, 1, rows, columns, row, point)
                is_trusted = max(change_x, change_y) > 1 and distance * step <= tolerance
                ties[direction, row, point] = weak if is_trusted else np.float32(1)
