"""The in-between frame as a weighted mean of both frames along every candidate motion.

Each node has a window, which overlaps those of its neighbours. A candidate is one motion for a whole window, so that
all its samples lie on a grid of their own: both frames are read in rows, without looking any pixel up. Every pixel then
weighs the candidates by the report's patch similarity of what they bring together at time t: the non-local mean again,
over motions instead of pixels. Windows fade into each other, so that no border between them can be seen (overlapped
block motion compensation, Orchard and Sullivan 1994, doi:10.1109/83.334974).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from fpsboost.kernels.candidates import CELL
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.spline import MARGIN, spline_weights

WINDOW = 2 * CELL
"""Side of a window, pixels."""

AREA = WINDOW * WINDOW
"""Pixels of a window: what is done to each alike is one loop over all of them."""

PATCH_RADIUS = 4
"""Of the patches that are compared at time t, pixels; beyond their window they are cut off."""

PADDED = WINDOW + 2 * PATCH_RADIUS
"""Side of a window with zeros around it, for sums over patches."""

SPARE = LANES
"""Columns that planes need beyond the right margin."""

TINY = np.float32(1e-30)
"""Keeps sums of weights above zero."""


@njit(**FINITE_JIT)
def decay(x):
    """exp(-x) for x >= 0, to a millionth: a polynomial of x / 64, squared six times."""
    x = min(x, np.float32(60)) * np.float32(1 / 64)
    half, sixth, one = np.float32(0.5), np.float32(1 / 6), np.float32(1)
    p = fma(x, np.float32(-1 / 120), np.float32(1 / 24))
    p = fma(fma(fma(fma(p, x, -sixth), x, half), x, -one), x, one)
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p * p


@njit(**FINITE_JIT)
def fetch(plane, coefficients, y, x, rows, out):
    """Sample a window whose first pixel lies at (y, x), in coordinates of the plane; whole places are copied.

    Parameters
    ----------
    plane, coefficients : (H, W) float32
    y, x : float32
        At least 1, and WINDOW + 2 pixels from the ends.
    rows : ((WINDOW + 3) * WINDOW,) float32
        Room.
    out : (AREA,) float32 out
    """
    top, left = math.floor(y), math.floor(x)
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    if fraction_y == 0 and fraction_x == 0:
        for j in range(WINDOW):
            source, target = plane[top + j, left : left + WINDOW], out[j * WINDOW :]
            for i in range(WINDOW):
                target[i] = source[i]
        return
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(WINDOW + 3):
        source, target = coefficients[top - 1 + j, left - 1 : left + 2 + WINDOW], rows[j * WINDOW :]
        for i in range(WINDOW):
            target[i] = fma(w3, source[i + 3], fma(w2, source[i + 2], fma(w1, source[i + 1], w0 * source[i])))
    w0, w1, w2, w3 = spline_weights(fraction_y)
    second, third, fourth = rows[WINDOW:], rows[2 * WINDOW :], rows[3 * WINDOW :]
    for i in range(AREA):
        out[i] = fma(w3, fourth[i], fma(w2, third[i], fma(w1, second[i], w0 * rows[i])))


@njit(**FINITE_JIT)
def mark_inside(start, size, marks):
    """1 where the samples of a window lie inside of a frame along one axis, else 0."""
    for i in range(WINDOW):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


@njit(**FINITE_JIT)
def mix_inside(share0, share1, marks, first, second, mixed):
    """Mix two windows, of which parts lie outside of their frames: those have no share unless both do."""
    for j in range(WINDOW):
        for i in range(WINDOW):
            weight0, weight1 = share0 * marks[0, i] * marks[1, j], share1 * marks[2, i] * marks[3, j]
            both = weight0 + weight1
            if both > 0:
                place = j * WINDOW + i
                mixed[place] = (weight0 * first[place] + weight1 * second[place]) / both


@njit(**FINITE_JIT)
def sum_patches(values, half_way, sums):
    """Sums over the patch around each pixel of a window; `values` and `half_way` are padded by zeros.

    First down, over the whole window at once, then across.
    """
    row, size = PADDED, PADDED * WINDOW
    for i in range(size):
        half_way[i] = (
            (values[i] + values[i + row] + values[i + 2 * row])
            + (values[i + 3 * row] + values[i + 4 * row] + values[i + 5 * row])
            + (values[i + 6 * row] + values[i + 7 * row] + values[i + 8 * row])
        )
    for j in range(WINDOW):
        source, target = half_way[j * PADDED :], sums[j * WINDOW :]
        for i in range(WINDOW):
            target[i] = (
                (source[i] + source[i + 1] + source[i + 2])
                + (source[i + 3] + source[i + 4] + source[i + 5])
                + (source[i + 6] + source[i + 7] + source[i + 8])
            )


@njit(parallel=True, cache=True, **FINITE_JIT)
def fuse_candidates(
    planes0, coefficients0, planes1, coefficients1, height, width, t, count, motions, weights, parity, scale,
    sharpness, enough, shape, inverse, mean, weight_sum, similarity_sum,
):  # fmt: skip
    """Add the windows of every second row of nodes to the in-between frame.

    Parameters
    ----------
    planes0, coefficients0, planes1, coefficients1 : (C, height + 2 MARGIN, width + 2 MARGIN + SPARE or more) float32
        Both frames; see `fpsboost.kernels.spline`.
    height, width : int
    t : float32
    count : (rows, columns) int32
    motions : (rows, columns, room, 4) float32
    weights : (rows, columns, room) float32
        See `fpsboost.kernels.candidates`.
    parity : int
        0 for the even rows, 1 for the odd ones, whose windows overlap those.
    scale : float32
        Factor on squared colour differences.
    sharpness : float32
        How fast a candidate's weight falls with its similarity.
    enough : float32
        Once every pixel of a window has found this similarity, the candidates with fewer votes are left out.
    shape, inverse : (AREA,) float32
        What `window_shape` and `patch_shares` give.
    mean : (C, height, width) float32
        Weighted sum; in and out.
    weight_sum, similarity_sum : (height, width) float32
        Sums of the weights and of weighted similarities; in and out.
    """
    channels = planes0.shape[0]
    rows_of_nodes, columns_of_nodes = count.shape
    half, one = np.float32(0.5), np.float32(1)
    curve = t * (one - t) * half
    # beyond the margin nothing changes any more
    lowest, margin = np.float32(2 - MARGIN), np.float32(MARGIN)
    highest_x, highest_y = np.float32(width + 2), np.float32(height + 2)
    for number in prange((rows_of_nodes - parity + 1) // 2):
        row = 2 * np.int64(number) + parity
        rows = np.empty((WINDOW + 3) * WINDOW, np.float32)
        first, second = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
        distance, mixed = np.empty(AREA, np.float32), np.empty((channels, AREA), np.float32)
        padded, half_way = np.zeros(PADDED * PADDED, np.float32), np.zeros(PADDED * PADDED, np.float32)
        similarity, weight = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
        total, node_weights = np.empty((channels, AREA), np.float32), np.empty(AREA, np.float32)
        node_similarities, most_similar = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
        marks = np.empty((4, WINDOW), np.float32)
        top = row * CELL - (WINDOW - CELL) // 2
        begin_y, end_y = max(-top, 0), min(height - top, WINDOW)
        for column in range(columns_of_nodes):
            left = column * CELL - (WINDOW - CELL) // 2
            begin_x, end_x = max(-left, 0), min(width - left, WINDOW)
            total[:] = 0
            node_weights[:] = TINY
            node_similarities[:] = 0
            most_similar[:] = 0
            for k in range(count[row, column]):
                prior = weights[row, column, k]
                if prior <= 0:
                    continue
                dx, dy = motions[row, column, k, 0], motions[row, column, k, 1]
                x0 = np.float32(left) + curve * motions[row, column, k, 2] - t * dx
                y0 = np.float32(top) + curve * motions[row, column, k, 3] - t * dy
                x1, y1 = x0 + dx, y0 + dy
                within = (
                    min(x0, x1) >= 0
                    and min(y0, y1) >= 0
                    and max(x0, x1) <= width - WINDOW
                    and max(y0, y1) <= height - WINDOW
                )
                if not within:
                    mark_inside(x0, width, marks[0])
                    mark_inside(y0, height, marks[1])
                    mark_inside(x1, width, marks[2])
                    mark_inside(y1, height, marks[3])
                x0, x1 = min(max(x0, lowest), highest_x) + margin, min(max(x1, lowest), highest_x) + margin
                y0, y1 = min(max(y0, lowest), highest_y) + margin, min(max(y1, lowest), highest_y) + margin
                for c in range(channels):
                    fetch(planes0[c], coefficients0[c], y0, x0, rows, first)
                    fetch(planes1[c], coefficients1[c], y1, x1, rows, second)
                    target = mixed[c]
                    if c == 0:
                        distance[:] = 0
                    for i in range(AREA):
                        difference = second[i] - first[i]
                        distance[i] = fma(difference, difference, distance[i])
                        target[i] = fma(t, difference, first[i])
                    if not within:
                        mix_inside(one - t, t, marks, first, second, target)
                for j in range(WINDOW):
                    source = distance[j * WINDOW :]
                    target = padded[(j + PATCH_RADIUS) * PADDED + PATCH_RADIUS :]
                    for i in range(WINDOW):
                        target[i] = decay(source[i] * scale)
                sum_patches(padded, half_way, similarity)
                for i in range(AREA):
                    alike = similarity[i] * inverse[i]
                    w = prior * decay(sharpness * (one - alike))
                    weight[i] = w
                    node_weights[i] += w
                    node_similarities[i] = fma(w, alike, node_similarities[i])
                    most_similar[i] = max(most_similar[i], alike)
                for c in range(channels):
                    target, source = total[c], mixed[c]
                    for i in range(AREA):
                        target[i] = fma(weight[i], source[i], target[i])
                if most_similar.min() >= enough:
                    break
            # between neighbours, too, the more similar one counts more, but not so much that its border shows
            for i in range(AREA):
                weight[i] = shape[i] / math.sqrt(node_weights[i])
            for j in range(begin_y, end_y):
                y, place = top + j, j * WINDOW
                for i in range(begin_x, end_x):
                    weight_sum[y, left + i] += weight[place + i] * node_weights[place + i]
                    similarity_sum[y, left + i] += weight[place + i] * node_similarities[place + i]
                for c in range(channels):
                    for i in range(begin_x, end_x):
                        mean[c, y, left + i] += weight[place + i] * total[c, place + i]


def window_shape() -> np.ndarray:
    """How much each pixel of a window counts, (AREA,) float32: from 0 at its border to 1, smooth at both ends.

    The windows that overlap at a pixel add up to 1.
    """
    way = 1 - np.abs(np.arange(WINDOW) + 0.5 - WINDOW / 2) / (WINDOW / 2)
    smooth = way * way * (3 - 2 * way)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


def patch_shares() -> np.ndarray:
    """One over the number of pixels that the patch around each pixel has within its window, (AREA,) float32."""
    place = np.arange(WINDOW)
    length = np.minimum(place + PATCH_RADIUS, WINDOW - 1) - np.maximum(place - PATCH_RADIUS, 0) + 1
    return (1 / np.outer(length, length)).ravel().astype(np.float32)


@njit(parallel=True, cache=True, **FINITE_JIT)
def finish_mean(weight_sum, similarity_sum, mean, confidence):
    """Divide by the weights.

    Parameters
    ----------
    weight_sum, similarity_sum : (H, W) float32
    mean : (C, H, W) float32
        In and out.
    confidence : (H, W) float32 out
        Weighted mean similarity to the eighth power: what it would be with a v of about a third.
    """
    channels, height, width = mean.shape
    for row in prange(height):
        y = np.int64(row)
        for x in range(width):
            # a few levels of difference are nothing to the weights, but something to the eye
            trust = min(similarity_sum[y, x] / weight_sum[y, x], np.float32(1))
            trust *= trust
            trust *= trust
            confidence[y, x] = trust * trust
        for c in range(channels):
            for x in range(width):
                mean[c, y, x] /= weight_sum[y, x]


@njit(parallel=True, cache=True, **FINITE_JIT)
def write_pixels(mean, scale, half, lowest, highest, straight_alpha, image):
    """Planes as an image of its own type.

    Parameters
    ----------
    mean : (C, H, W) float32
    scale, half, lowest, highest : float32
        What 1 becomes, what is added before the fraction is cut off, and the range of the image's values.
    straight_alpha : bool
        Whether all other planes are to be divided by the last.
    image : (H, W, C) out
    """
    channels, height, width = mean.shape
    for row in prange(height):
        y = np.int64(row)
        for c in range(channels):
            for x in range(width):
                value = mean[c, y, x]
                if straight_alpha and c < channels - 1:
                    value /= max(mean[channels - 1, y, x], np.float32(1e-6))
                image[y, x, c] = image.dtype.type(min(max(value * scale + half, lowest), highest))
