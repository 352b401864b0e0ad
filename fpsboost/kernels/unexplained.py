"""Another look at what the motion of its surroundings does not explain: small things that move by themselves.

A patch that is much larger than an object goes with the background, and the object is lost for good at the first level.
But then it is seen nowhere in the other frame where its surroundings lead, nor is it explained where it has gone. So
what small patches do not find again is searched for among what they do not find in the other frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.similarity import UNIT, similarity
from fpsboost.kernels.tiles import Index


@njit(**FINITE_JIT)
def compare_row(flat0, flat1, plane, stride, start0, start1, radius, wide, count, share, most, total):
    """Sums of similarities of the patch around one place and those around `wide` places in a row.

    Gives up, and says so, once none of the first `count` sums, times `share`, can be above `most` whatever the rest is.
    """
    for i in range(Index(wide)):
        total[i] = 0
    for j in range(-radius, radius + 1):
        for k in range(-radius, radius + 1):
            here, there = Index(start0 + j * stride + k), Index(start1 + j * stride + k)
            first, second, third = flat0[here], flat0[here + plane], flat0[here + plane + plane]
            for i in range(Index(wide)):
                total[i] += similarity(
                    first,
                    second,
                    third,
                    flat1[there + i],
                    flat1[there + plane + i],
                    flat1[there + plane + plane + i],
                )
        highest = np.int32(0)
        for i in range(Index(count)):
            highest = max(highest, total[i])
        if np.float32(highest + (radius - j) * (2 * radius + 1) * UNIT) * share <= most:
            return False
    return True


@njit(inline="always", **FINITE_JIT)
def compare_patches(flat0, flat1, plane, stride, start0, start1, radius, lanes, columns):
    """Sum of the similarities of two patches, given where their first pixels are; `columns` is room for `lanes`."""
    columns[:] = 0
    for _ in range(2 * radius + 1):
        for i in range(Index(lanes)):
            columns[i] += similarity(
                flat0[start0 + i],
                flat0[start0 + plane + i],
                flat0[start0 + plane + plane + i],
                flat1[start1 + i],
                flat1[start1 + plane + i],
                flat1[start1 + plane + plane + i],
            )
        start0 += stride
        start1 += stride
    total = np.int32(0)
    for i in range(2 * radius + 1):
        total += columns[i]
    return total


@njit(parallel=True, cache=True, **FINITE_JIT)
def measure_points(planes0, planes1, padding, height, width, step, radius, lanes, flow, known):
    """Similarity of small patches at both ends of every point's motion.

    Parameters
    ----------
    planes0, planes1 : (3, H + 2 padding, W + 2 padding or more) float32
        Components with repeated edges, scaled by `colour_scale`; padding is larger than the radius.
    padding, height, width : int
    step : int
        Distance of the points, pixels.
    radius : int
        r of the small patch.
    lanes : int
        LANES; at least 2r + 1.
    flow : (points down, points across, 2) float32
    known : (points down, points across) float32 out
        0 to 1.
    """
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane = Index(plane_height * stride)
    share = np.float32(1 / (UNIT * (2 * radius + 1) ** 2))
    for number in prange(flow.shape[0]):
        row = np.int64(number)
        columns = np.empty(lanes, np.int32)
        for point in range(flow.shape[1]):
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            there_y = min(max(y + int(np.rint(flow[row, point, 1])), 0), height - 1)
            there_x = min(max(x + int(np.rint(flow[row, point, 0])), 0), width - 1)
            start0 = Index((y - radius + padding) * stride + x - radius + padding)
            start1 = Index((there_y - radius + padding) * stride + there_x - radius + padding)
            total = compare_patches(flat0, flat1, plane, Index(stride), start0, start1, radius, lanes, columns)
            known[row, point] = np.float32(total) * share


@njit(parallel=True, cache=True, **FINITE_JIT)
def search_unexplained(
    planes0, planes1, padding, height, width, step, limit, radius, lanes, known, elsewhere, enough, better, flow
):  # fmt: skip
    """Replace the motion of points that it does not explain by one that leads to where nothing is explained either.

    Parameters
    ----------
    planes0, planes1, padding, height, width, step, radius
        As for `measure_points`.
    limit : int
        Largest offset.
    lanes : int
        LANES; at least the step.
    known, elsewhere : (points down, points across) float32
        What `measure_points` gives for this frame and for the other one.
    enough : float32
        Similarity at which a point counts as explained.
    better : float32
        What another motion must add to it.
    flow : (points down, points across, 2) float32
        In and out; what is found is whole pixels.
    """
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane = Index(plane_height * stride)
    share = np.float32(1 / (UNIT * (2 * radius + 1) ** 2))
    rows, columns = known.shape
    for number in prange(rows):
        row = np.int64(number)
        total = np.empty(lanes, np.int32)
        for point in range(columns):
            if known[row, point] >= enough:
                continue
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            start0 = (y + padding) * stride + x + padding
            most = known[row, point] + better
            top, bottom = max(y - limit, 0), min(y + limit, height - 1)
            left, right = max(x - limit, 0), min(x + limit, width - 1)
            for other_row in range(top // step, bottom // step + 1):
                other_point, behind = left // step, right // step + 1
                while other_point < behind:
                    if elsewhere[other_row, other_point] >= enough:
                        other_point += 1
                        continue
                    # neighbours that nothing explains are compared together, as many as fill a vector
                    begin = other_point
                    while (
                        other_point < behind
                        and (other_point + 1 - begin) * step <= lanes
                        and elsewhere[other_row, other_point] < enough
                    ):
                        other_point += 1
                    first, last = max(begin * step, left), min(other_point * step - 1, right)
                    for there_y in range(max(other_row * step, top), min(other_row * step + step - 1, bottom) + 1):
                        start1 = (there_y + padding) * stride + first + padding
                        count = last - first + 1
                        if not compare_row(
                            flat0, flat1, plane, stride, start0, start1, radius, lanes, count, share, most, total
                        ):
                            continue
                        for i in range(count):
                            value = np.float32(total[i]) * share
                            if value > most:
                                most = value
                                flow[row, point, 0] = np.float32(first + i - x)
                                flow[row, point, 1] = np.float32(there_y - y)
