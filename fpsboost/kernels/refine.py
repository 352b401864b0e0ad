"""Subpixel refinement of motion: weighted least-squares steps at every point.

The vector of each point is moved to minimise the difference of the two frames in a window around the point (Lucas and
Kanade 1981). Each pixel of the window is weighted by its similarity, as in the search, so that another object in the
window has no influence.
"""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.instruction import (
    AS_GIVEN,
    BYTE,
    FLOAT,
    INDEX,
    INTEGER,
    PLACE,
    REAL,
    SIXTEEN,
    WORD,
    instruction,
    prefetch,
    vector,
)
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.planes import flatten, opposite

WINDOW_SIDE = 8
"""Side of the window, pixels."""

PRODUCT_COUNT = 6
"""Number of sums: gradients along x and y: xx, xy, yy; gradients and temporal difference: xt, yt; temporal difference:
tt."""

_BYTES, _WORDS = vector(BYTE, SIXTEEN), vector(WORD, SIXTEEN)
_INTEGERS, _FLOATS = vector(INTEGER, WINDOW_SIDE), vector(REAL, WINDOW_SIDE)


def window_products(first, start0, second, start1, stride, plane, tail, sums):
    """Sum the products of a window's pixels, each weighted by its similarity, ``(1 + tail tt)^-4``.

    - `first`, `second`: three planes of both frames, (size,) uint8
    - `start0`, `start1`: index of the pixel above and to the left of the window's first one, in the first plane; no
      bounds are checked
    - `stride`, `plane`: distances between rows and between planes
    - `sums`: (PRODUCT_COUNT,) float32 out; gradients are sums of four one-pixel differences: over two pixels, in both
      frames
    """
    products = np.zeros((PRODUCT_COUNT, WINDOW_SIDE, WINDOW_SIDE), np.float32)
    for c in range(3):
        windows = []
        for frame, start in ((first, start0), (second, start1)):
            rows = [frame[start + c * plane + j * stride :][: WINDOW_SIDE + 2] for j in range(WINDOW_SIDE + 2)]
            windows.append(np.array(rows).astype(np.float32))
        both, change = windows[0] + windows[1], (windows[1] - windows[0])[1:-1, 1:-1]
        along_x, along_y = both[1:-1, 2:] - both[1:-1, :-2], both[2:, 1:-1] - both[:-2, 1:-1]
        factors = (along_x, along_x), (along_x, along_y), (along_y, along_y)
        for k, (one, other) in enumerate((*factors, (along_x, change), (along_y, change), (change, change))):
            products[k] += one * other
    weights = (1 + tail * products[-1]) ** -4
    sums[:] = (weights * products).sum(axis=(1, 2))


@instruction(window_products, AS_GIVEN, INDEX, AS_GIVEN, INDEX, INDEX, INDEX, FLOAT, AS_GIVEN)
def _build_window_products(code, first, start0, second, start1, stride, plane, tail, sums):
    builder, one = code.builder, code.fill(1.0, _FLOATS)

    def read(place0, place1):
        """Return the sum and the difference of both frames in a row of a plane; integers until they are multiplied."""
        level0 = builder.zext(first.load(place0, _BYTES), _WORDS)
        level1 = builder.zext(second.load(place1, _BYTES), _WORDS)
        return builder.add(level0, level1), builder.sub(level1, level0)

    def choose(words, place):
        return code.choose(words, range(place, place + WINDOW_SIDE))

    def as_floats(words):
        return builder.sitofp(builder.sext(words, _INTEGERS), _FLOATS)

    planes = [
        list(map(read, *(code.steps(start, stride, WINDOW_SIDE + 2) for start in starts)))
        for starts in zip(code.steps(start0, plane, 3), code.steps(start1, plane, 3), strict=True)
    ]
    tails, totals = code.broadcast(tail, _FLOATS), [code.fill(0.0, _FLOATS)] * PRODUCT_COUNT
    for j in range(1, WINDOW_SIDE + 1):
        products = [None] * PRODUCT_COUNT
        for rows in planes:
            (above, _), (here, change), (below, _) = rows[j - 1 : j + 2]
            x = as_floats(builder.sub(choose(here, 2), choose(here, 0)))
            y = as_floats(builder.sub(choose(below, 1), choose(above, 1)))
            t = as_floats(choose(change, 1))
            for k, (a, b) in enumerate(((x, x), (x, y), (y, y), (x, t), (y, t), (t, t))):
                products[k] = builder.fmul(a, b) if products[k] is None else code.fma(a, b, products[k])
        falls = code.fma(products[-1], tails, one)
        falls = builder.fmul(falls, falls)
        weights = builder.fdiv(one, builder.fmul(falls, falls))
        totals = [code.fma(weights, product, total) for product, total in zip(products, totals, strict=True)]
    for k, total in enumerate(totals):
        sums.store(_sum_lanes(code, total), PLACE(k))


def _sum_lanes(code, values):
    """Return the sum of a vector's elements, by repeated halving."""
    length = values.type.count
    while length > 1:
        length //= 2
        values = code.builder.fadd(code.choose(values, range(length)), code.choose(values, range(length, 2 * length)))
    return code.builder.extract_element(values, INTEGER(0))


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
def refine_points(pair, step, tail, damping, largest, steps, refined, flow):
    """Refine the vector of every point by least-squares steps on its window.

    - `pair`: in levels, with at least 8 columns more on the right
    - `step`: distance between points, pixels
    - `tail`: rate at which the weight of a pixel falls with its squared difference in levels
    - `damping`: added to the squared gradients; prevents steps in flat areas
    - `largest`: maximum step along x and y, pixels
    - `steps`: maximum number of steps: a vector whose rounded value changes is rounded and refined again
    - `refined`: vectors that were refined before, (points down, points across, 2) float32, or empty; a vector that
      rounds to the same whole pixels takes that value
    - `flow`: motion, rounded to whole pixels at first, (points down, points across, 2) float32; updated in place
    """
    planes0, _, padding, height, width, _ = pair
    flat0, flat1, distance, stride = flatten(pair)
    plane, plane_height = np.int64(distance), planes0.shape[1]  # signed, as all indices here are
    products = np.empty(PRODUCT_COUNT, np.float32)
    for row in range(flow.shape[0]):
        for point in range(flow.shape[1]):
            y0 = min(row * step + step // 2, height - 1) - WINDOW_SIDE // 2 + padding
            x0 = min(point * step + step // 2, width - 1) - WINDOW_SIDE // 2 + padding
            dx, dy = np.rint(flow[row, point, 0]), np.rint(flow[row, point, 1])
            if refined.size > 0 and dx == np.rint(refined[row, point, 0]) and dy == np.rint(refined[row, point, 1]):
                flow[row, point, 0], flow[row, point, 1] = refined[row, point, 0], refined[row, point, 1]
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
def refine_bidirectional(pair, step, tail, damping, largest, steps, refined, flow):
    """Refine the vectors of both frames like `refine_points`; `refined` and `flow` have both directions."""
    for direction in range(2):
        refine_points(pair, step, tail, damping, largest, steps, refined[direction], flow[direction])
        pair = opposite(pair)
