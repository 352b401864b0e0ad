"""Another look at what the motion of its surroundings does not explain: small things that move by themselves.

A patch that is much larger than an object goes with the background, and the object is lost for good at the first level.
But then it is seen nowhere in the other frame where its surroundings lead, nor is it explained where it has gone. So
what small patches do not find again is searched for among what they do not find in the other frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.levels import SIXTEEN, compare_one, compare_sixteen
from fpsboost.kernels.tiles import Index


@njit(**FINITE_JIT)
def compare_row(flat0, flat1, plane, alike, stride, start0, start1, radius, count, share, most, total):
    """Sums of similarities of the patch around one place and those around SIXTEEN places in a row.

    Gives up, and says so, once none of the first `count` sums, times `share`, can be above `most` whatever the rest is.
    """
    total[:] = 0
    for j in range(-radius, radius + 1):
        for k in range(-radius, radius + 1):
            here, there = Index(start0 + j * stride + k), Index(start1 + j * stride + k)
            compare_one(flat0, here, flat1, there, plane, alike, total, 0, 0)
        highest = np.int32(0)
        for i in range(Index(count)):
            highest = max(highest, np.int32(total[i]))
        if np.float32(highest + (radius - j) * (2 * radius + 1) * np.int64(alike)) * share <= most:
            return False
    return True


@njit(cache=True, **FINITE_JIT)
def measure_point_similarity(planes0, planes1, alike, padding, height, width, step, radius, flow, known):
    """Similarity of small patches at both ends of every point's motion.

    Parameters
    ----------
    planes0, planes1 : (3, H + 2 padding, W + 2 padding or more) uint8
        Components in levels, with repeated edges; padding is larger than the radius.
    alike : uint8
        Similarity of two equal pixels; see `fpsboost.kernels.levels`.
    padding, height, width : int
    step : int
        Distance of the points, pixels.
    radius : int
        r of the small patch, at most 7.
    flow : (points down, points across, 2) float32
    known : (points down, points across) float32 out
        0 to 1.
    """
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane = Index(plane_height * stride)
    share = np.float32(1 / (np.int64(alike) * (2 * radius + 1) ** 2))
    for row in range(flow.shape[0]):
        columns = np.empty(SIXTEEN, np.uint16)
        for point in range(flow.shape[1]):
            y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
            there_y = min(max(y + int(np.rint(flow[row, point, 1])), 0), height - 1)
            there_x = min(max(x + int(np.rint(flow[row, point, 0])), 0), width - 1)
            start0 = Index((y - radius + padding) * stride + x - radius + padding)
            start1 = Index((there_y - radius + padding) * stride + there_x - radius + padding)
            columns[:] = 0
            for _ in range(2 * radius + 1):
                compare_sixteen(flat0, start0, flat1, start1, plane, alike, columns, 0, 0)
                start0 += Index(stride)
                start1 += Index(stride)
            total = np.int32(0)
            for i in range(2 * radius + 1):
                total += columns[i]
            known[row, point] = np.float32(total) * share


@njit(cache=True, **FINITE_JIT)
def search_residuals(
    planes0, planes1, alike, padding, height, width, step, limit, radius, known, elsewhere, enough, better, flow
):  # fmt: skip
    """Replace the motion of points that it does not explain by one that leads to where nothing is explained either.

    Parameters
    ----------
    planes0, planes1, alike, padding, height, width, step, radius
        As for `measure_point_similarity`.
    limit : int
        Largest offset.
    known, elsewhere : (points down, points across) float32
        What `measure_point_similarity` gives for this frame and for the other one.
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
    share = np.float32(1 / (np.int64(alike) * (2 * radius + 1) ** 2))
    rows, columns = known.shape
    for row in range(rows):
        total = np.empty(SIXTEEN, np.uint16)
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
                        and (other_point + 1 - begin) * step <= SIXTEEN
                        and elsewhere[other_row, other_point] < enough
                    ):
                        other_point += 1
                    first, last = max(begin * step, left), min(other_point * step - 1, right)
                    for there_y in range(max(other_row * step, top), min(other_row * step + step - 1, bottom) + 1):
                        start1 = (there_y + padding) * stride + first + padding
                        count = last - first + 1
                        if not compare_row(
                            flat0, flat1, plane, alike, stride, start0, start1, radius, count, share, most, total
                        ):
                            continue
                        for i in range(count):
                            value = np.float32(total[i]) * share
                            if value > most:
                                most = value
                                flow[row, point, 0] = np.float32(first + i - x)
                                flow[row, point, 1] = np.float32(there_y - y)
