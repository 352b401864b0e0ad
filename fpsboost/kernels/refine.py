"""Subpixel refinement of motion: weighted least-squares steps at every point.

The vector of each point is moved to minimise the difference of the two frames in a window around the point (Lucas and
Kanade 1981). Each pixel of the window is weighted by its similarity, as in the search, so that another object in the
window has no influence.
"""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.plane_pair import opposite
from fpsboost.kernels.prefetch import prefetch
from fpsboost.kernels.window_products import PRODUCT_COUNT, WINDOW_SIDE, window_products


@njit(**FINITE_JIT)
def significance(explained, change):
    """Return how much of a step to trust, 0 to 1, given how much of the squared change it explains.

    Two free parameters explain some of any noise, which is no evidence of motion (positive-part shrinkage of James and
    Stein 1961).
    """
    rest = max(change - explained, np.float32(0)) * np.float32(1 / (WINDOW_SIDE * WINDOW_SIDE / 2 - 1))
    return max(explained - rest, np.float32(0)) / max(explained, np.float32(1e-20))


@njit(**FINITE_JIT)
def prefetch_rows(flat, place, stride, plane):
    """Prefetch a cache line of every row of a window, in all planes."""
    for _ in range(WINDOW_SIDE):
        prefetch(flat, place)
        prefetch(flat, place + plane)
        prefetch(flat, place + plane + plane)
        place += stride


@njit(**FINITE_JIT)
def refine_points(pair, step, tail, damping, largest, steps, known, flow):
    """Refine the vector of every point by least-squares steps on its window.

    Parameters
    ----------
    pair : PlanePair
        In levels, with at least 8 columns more on the right.
    step : int
        Distance between points, pixels.
    tail : float32
        Rate at which the weight of a pixel falls with its squared difference in levels.
    damping : float32
        Added to the squared gradients; prevents steps in flat areas.
    largest : float32
        Maximum step along x and y, pixels.
    steps : int
        Maximum number of steps: a vector whose rounded value changes is rounded and refined again.
    known : (points down, points across, 2) float32
        Vectors that were refined before; a vector that rounds to the same whole pixels takes the known value. It may be
        empty.
    flow : (points down, points across, 2) float32
        Motion, rounded to whole pixels at first; updated in place.
    """
    planes0, planes1, padding, height, width, _ = pair
    _, plane_height, stride = planes0.shape
    flat0, flat1 = planes0.reshape(planes0.size), planes1.reshape(planes1.size)
    plane, products = plane_height * stride, np.empty(PRODUCT_COUNT, np.float32)
    for row in range(flow.shape[0]):
        for point in range(flow.shape[1]):
            y0 = min(row * step + step // 2, height - 1) - WINDOW_SIDE // 2 + padding
            x0 = min(point * step + step // 2, width - 1) - WINDOW_SIDE // 2 + padding
            dx, dy = np.rint(flow[row, point, 0]), np.rint(flow[row, point, 1])
            if known.size > 0 and dx == np.rint(known[row, point, 0]) and dy == np.rint(known[row, point, 1]):
                flow[row, point, 0], flow[row, point, 1] = known[row, point, 0], known[row, point, 1]
                continue
            for _ in range(steps):
                # limited to the padding, beyond which the repeated edges do not change
                y1 = min(max(y0 + int(dy), 1), plane_height - WINDOW_SIDE - 1)
                x1 = min(max(x0 + int(dx), 1), stride - 2 * WINDOW_SIDE)
                start0, start1 = (y0 - 1) * stride + x0 - 1, (y1 - 1) * stride + x1 - 1
                # the point after the next one usually has a similar motion
                prefetch_rows(flat0, start0 + 2 * step + WINDOW_SIDE, stride, plane)
                prefetch_rows(flat1, start1 + 2 * step + WINDOW_SIDE, stride, plane)
                window_products(flat0, start0, flat1, start1, stride, plane, tail, products)
                xx, xy, yy = products[0] + damping, products[1], products[2] + damping
                xt, yt, tt = products[3], products[4], products[5]
                # along a straight edge, rounding could make the determinant zero or negative
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


@njit(cache=True, **FINITE_JIT)
def refine_bidirectional(pair, step, tail, damping, largest, steps, known, flow):
    """Refine the vectors of both frames like `refine_points`; `known` and `flow` have both directions."""
    for direction in range(2):
        refine_points(pair, step, tail, damping, largest, steps, known[direction], flow[direction])
        pair = opposite(pair)
