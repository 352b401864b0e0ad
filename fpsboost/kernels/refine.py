"""Whole-pixel motion made exact: one weighted least-squares step at every point.

Around each point, the motion is moved so that the two frames differ least (Lucas and Kanade 1981). Each pixel of the
window counts by its similarity, as in the search itself, so that another object in the window has no say.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.prefetch import prefetch
from fpsboost.kernels.tiles import Index

WIDE, HIGH = 8, 8
"""Of the window, pixels."""

TAIL = np.float32(1 / 32)
"""How fast the weight of a pixel falls: slower than its similarity, as the fraction of a pixel is not known yet."""


@njit(forceinline=True, **FINITE_JIT)
def weighted_products(flat0, flat1, p0, p1, stride, plane):
    """Products of one pixel's gradients (xx, xy, yy), of gradient and change (xt, yt), and of change, by similarity."""
    squares, xx, xy, yy = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    xt, yt, one = np.float32(0), np.float32(0), Index(1)
    for _ in range(3):
        change = flat1[p1] - flat0[p0]
        along_x = flat0[p0 + one] - flat0[p0 - one] + flat1[p1 + one] - flat1[p1 - one]
        along_y = flat0[p0 + stride] - flat0[p0 - stride] + flat1[p1 + stride] - flat1[p1 - stride]
        squares = fma(change, change, squares)
        xx = fma(along_x, along_x, xx)
        xy = fma(along_x, along_y, xy)
        yy = fma(along_y, along_y, yy)
        xt = fma(along_x, change, xt)
        yt = fma(along_y, change, yt)
        p0 += plane
        p1 += plane
    weight = fma(squares, TAIL, np.float32(1))
    weight *= weight
    weight = np.float32(1) / (weight * weight)
    return weight * xx, weight * xy, weight * yy, weight * xt, weight * yt, weight * squares


@njit(forceinline=True, **FINITE_JIT)
def add(first, second):
    """Sums of six products."""
    return (
        first[0] + second[0],
        first[1] + second[1],
        first[2] + second[2],
        first[3] + second[3],
        first[4] + second[4],
        first[5] + second[5],
    )


@njit(forceinline=True, **FINITE_JIT)
def sum_two(flat0, flat1, p0, p1, stride, plane):
    """Sums of the products of a pixel and the one below."""
    first = weighted_products(flat0, flat1, p0, p1, stride, plane)
    second = weighted_products(flat0, flat1, p0 + stride, p1 + stride, stride, plane)
    return add(first, second)


@njit(forceinline=True, **FINITE_JIT)
def sum_four(flat0, flat1, p0, p1, stride, plane):
    """The same of a pixel and the three below."""
    first = sum_two(flat0, flat1, p0, p1, stride, plane)
    second = sum_two(flat0, flat1, p0 + stride + stride, p1 + stride + stride, stride, plane)
    return add(first, second)


@njit(nogil=True, error_model="numpy", fastmath={"reassoc"})
def add_window(flat0, flat1, start0, start1, stride, plane, wide, damping):
    """Sums of the products over a window, with `damping` added to those of the squared gradients.

    Four rows at a time, because adding up the lanes of six vectors costs more than a row. These sums, and nothing
    else, may be reordered, which makes them vectors.
    """
    xx, xy, yy, xt, yt, tt = damping, np.float32(0), damping, np.float32(0), np.float32(0), np.float32(0)
    below = Index(4) * stride
    for i in range(Index(wide)):
        upper = sum_four(flat0, flat1, start0 + i, start1 + i, stride, plane)
        lower = sum_four(flat0, flat1, start0 + below + i, start1 + below + i, stride, plane)
        xx += upper[0] + lower[0]
        xy += upper[1] + lower[1]
        yy += upper[2] + lower[2]
        xt += upper[3] + lower[3]
        yt += upper[4] + lower[4]
        tt += upper[5] + lower[5]
    return xx, xy, yy, xt, yt, tt


@njit(inline="always", **FINITE_JIT)
def significance(explained, change):
    """How much of a step is to be believed, 0 to 1, given how much of the squared change it explains.

    Two free numbers explain some of any noise: so much is no evidence of motion (the positive-part shrinkage of James
    and Stein 1961).
    """
    rest = max(change - explained, np.float32(0)) * np.float32(1 / (WIDE * HIGH / 2 - 1))
    return max(explained - rest, np.float32(0)) / max(explained, np.float32(1e-20))


@njit(inline="always", **FINITE_JIT)
def prefetch_rows(flat, place, stride, plane):
    """Fetch a cache line of every row of a window, in all planes."""
    for _ in range(HIGH):
        prefetch(flat, place)
        prefetch(flat, place + plane)
        prefetch(flat, place + plane + plane)
        place += stride


@njit(cache=True, **FINITE_JIT)
def refine_points(planes0, planes1, padding, height, width, step, wide, damping, largest, steps, known, flow):
    """Move the vector of every point by the least-squares step of its window.

    Parameters
    ----------
    planes0, planes1 : (3, H + 2 padding, W + 2 padding or more) float32
        Components with repeated edges, scaled by `colour_scale`.
    padding, height, width : int
    step : int
        Distance of the points, pixels.
    wide : int
        WIDE.
    damping : float32
        Added to the squared gradients; keeps flat areas where they are.
    largest : float32
        Longest step along x or y, pixels.
    steps : int
        A vector that moves by more than half a pixel is rounded and moved again, this often in all.
    known : (points down, points across, 2) float32
        Vectors that were refined before: those that begin at the same whole pixels end there, too.
    flow : (points down, points across, 2) float32
        Rounded to whole pixels at first; in and out.
    """
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane = Index(plane_height * stride)
    for row in range(flow.shape[0]):
        for point in range(flow.shape[1]):
            y0 = min(row * step + step // 2, height - 1) - HIGH // 2 + padding
            x0 = min(point * step + step // 2, width - 1) - WIDE // 2 + padding
            dx, dy = np.rint(flow[row, point, 0]), np.rint(flow[row, point, 1])
            if dx == np.rint(known[row, point, 0]) and dy == np.rint(known[row, point, 1]):
                flow[row, point, 0], flow[row, point, 1] = known[row, point, 0], known[row, point, 1]
                continue
            for _ in range(steps):
                # beyond the padding nothing changes any more
                y1 = min(max(y0 + int(dy), 1), plane_height - HIGH - 1)
                x1 = min(max(x0 + int(dx), 1), stride - WIDE - 1)
                start0, start1 = Index(y0 * stride + x0), Index(y1 * stride + x1)
                # the point after the next one mostly moves like this one
                ahead = Index(2 * step + WIDE - 1)
                prefetch_rows(flat0, start0 + ahead, Index(stride), plane)
                prefetch_rows(flat1, start1 + ahead, Index(stride), plane)
                xx, xy, yy, xt, yt, tt = add_window(flat0, flat1, start0, start1, Index(stride), plane, wide, damping)
                # along a straight edge rounding would leave nothing or less of the determinant
                determinant = max(xx * yy - xy * xy, damping * (xx + yy) * np.float32(0.5))
                along_x, along_y = (yy * xt - xy * yt) / determinant, (xx * yt - xy * xt) / determinant
                # gradients were summed over four pixels
                factor = np.float32(-4) * significance(along_x * xt + along_y * yt, tt)
                flow[row, point, 0] = dx + min(max(factor * along_x, -largest), largest)
                flow[row, point, 1] = dy + min(max(factor * along_y, -largest), largest)
                x, y = np.rint(flow[row, point, 0]), np.rint(flow[row, point, 1])
                if x == dx and y == dy:
                    break
                dx, dy = x, y
