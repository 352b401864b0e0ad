"""The in-between frame as a weighted mean of both frames along every candidate motion.

Each node has a window, which overlaps those of its neighbours. A candidate is one motion for a whole window, so that
all its samples lie on a grid of their own: both frames are read in rows, without looking any pixel up. Every pixel then
weighs the candidates by the report's patch similarity of what they bring together at time t: the non-local mean again,
over motions instead of pixels. Windows fade into each other, so that no border between them can be seen (overlapped
block motion compensation, Orchard and Sullivan 1994, doi:10.1109/83.334974).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fpsboost.kernels.candidates import CELL
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.lanes import EIGHT, filter_eight
from fpsboost.kernels.spline import MARGIN, spline_weights
from fpsboost.kernels.tiles import Index


class Samples(NamedTuple):
    """An image as planes with repeated edges, and the spline through them; see `fpsboost.kernels.spline`."""

    planes: NDArray[Any]
    """(C, H + 2 MARGIN, W + 2 MARGIN or more) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """float32, shaped like the planes: of their values times `unit`."""
    unit: np.float32


WINDOW = 2 * CELL
"""Side of a window, pixels."""

AREA = WINDOW * WINDOW
"""Pixels of a window: what is done to each alike is one loop over all of them."""

BLOCK = EIGHT
"""Side of the parts of a window that move as their middle does, pixels."""

RIGID = np.float32(0.05)
"""Change of motion from pixel to pixel below which a window moves as a whole."""

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
def locate_window(top, left, motion, t, height, width, marks):
    """Where a window at time t lies in both frames.

    Parameters
    ----------
    top, left : int
        Its first pixel.
    motion : (MOTION,) float32
    t : float32
    height, width : int
        Of the frames.
    marks : (4, WINDOW) float32 out
        Where a part lies outside: 1 for each column inside of frame 0, each row, and the same for frame 1, else 0.

    Returns
    -------
    y0, x0, y1, x1 : float32
        In coordinates of the planes, no farther out than they go: beyond their margin nothing changes any more.
    within : bool
        Whether all of it lies inside of both frames.
    """
    curve = t * (np.float32(1) - t) * np.float32(0.5)
    x0 = np.float32(left) + curve * motion[2] - t * motion[0]
    y0 = np.float32(top) + curve * motion[3] - t * motion[1]
    x1, y1 = x0 + motion[0], y0 + motion[1]
    within = min(x0, x1) >= 0 and min(y0, y1) >= 0 and max(x0, x1) <= width - WINDOW and max(y0, y1) <= height - WINDOW
    if not within:
        mark_inside(x0, width, marks[0])
        mark_inside(y0, height, marks[1])
        mark_inside(x1, width, marks[2])
        mark_inside(y1, height, marks[3])
    lowest, margin = np.float32(2 - MARGIN), np.float32(MARGIN)
    highest_x, highest_y = np.float32(width + 2), np.float32(height + 2)
    x0, x1 = min(max(x0, lowest), highest_x) + margin, min(max(x1, lowest), highest_x) + margin
    y0, y1 = min(max(y0, lowest), highest_y) + margin, min(max(y1, lowest), highest_y) + margin
    return y0, x0, y1, x1, within


@njit(**FINITE_JIT)
def fetch_window(planes, coefficients, unit, begin, stride, end, y, x, share, motion, rows, out):
    """Sample a window whose middle moves with its first pixel at (y, x), in coordinates of the plane.

    Parameters
    ----------
    planes : (size,) uint8, uint16 or float32
    coefficients : (size,) float32
        Of the spline through the planes times `unit`.
    unit : float32
    begin : int
        Where in both a plane begins.
    stride : int
        Distance of their rows.
    end : int
        Rows of a plane.
    y, x : float32
        At least 1, and WINDOW + 2 pixels from the ends.
    share : float32
        Of the motion that leads from time t to this frame: below 0 against it.
    motion : (MOTION,) float32
    rows : ((WINDOW + 3) * WINDOW,) float32
        Room.
    out : (AREA,) float32 out
    """
    if abs(motion[4]) + abs(motion[5]) + abs(motion[6]) + abs(motion[7]) < RIGID:
        fetch_rigid(planes, coefficients, unit, begin, stride, y, x, rows, out)
    else:
        fetch_affine(coefficients, begin, stride, end, y, x, share, motion, rows, out)


@njit(**FINITE_JIT)
def fetch_rigid(planes, coefficients, unit, begin, stride, y, x, rows, out):
    """Sample a window that moves as a whole; whole places are copied. See `fetch_window`."""
    top, left = int(y), int(x)  # never below 1
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    if fraction_y == 0 and fraction_x == 0:
        for j in range(WINDOW):
            place, to = Index(begin + (top + j) * stride + left), Index(j * WINDOW)
            for i in range(Index(WINDOW)):
                out[to + i] = np.float32(planes[place + i]) * unit
        return
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(WINDOW + 3):
        place, to = Index(begin + (top - 1 + j) * stride + left - 1), Index(j * WINDOW)
        for i in range(Index(WINDOW)):
            p = place + i
            near = fma(w1, coefficients[p + Index(1)], w0 * coefficients[p])
            rows[to + i] = fma(w3, coefficients[p + Index(3)], fma(w2, coefficients[p + Index(2)], near))
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for i in range(Index(AREA)):
        near = fma(w1, rows[i + Index(WINDOW)], w0 * rows[i])
        out[i] = fma(w3, rows[i + Index(3 * WINDOW)], fma(w2, rows[i + Index(2 * WINDOW)], near))


@njit(**FINITE_JIT)
def fetch_affine(coefficients, begin, stride, end, y, x, share, motion, rows, out):
    """Sample a window that is zoomed or turned: each of its blocks moves as its middle does. See `fetch_window`."""
    one, last_y, last_x = np.float32(1), np.float32(end - BLOCK - 3), np.float32(stride - BLOCK - 3)
    for down in range(0, WINDOW, BLOCK):
        for across in range(0, WINDOW, BLOCK):
            from_x, from_y = np.float32(across + (BLOCK - WINDOW) // 2), np.float32(down + (BLOCK - WINDOW) // 2)
            place_x = x + np.float32(across) + share * (from_x * motion[4] + from_y * motion[6])
            place_y = y + np.float32(down) + share * (from_x * motion[5] + from_y * motion[7])
            place_x, place_y = min(max(place_x, one), last_x), min(max(place_y, one), last_y)
            top, left = int(place_y), int(place_x)
            place, to = begin + (top - 1) * stride + left - 1, down * WINDOW + across
            w0, w1, w2, w3 = spline_weights(place_x - np.float32(left))
            for j in range(BLOCK + 3):
                filter_eight(coefficients, place + j * stride, 1, w0, w1, w2, w3, rows, j * BLOCK)
            w0, w1, w2, w3 = spline_weights(place_y - np.float32(top))
            for j in range(BLOCK):
                filter_eight(rows, j * BLOCK, BLOCK, w0, w1, w2, w3, out, to + j * WINDOW)


@njit(**FINITE_JIT)
def mark_inside(start, size, marks):
    """1 where the samples of a window lie inside of a frame along one axis, else 0."""
    for i in range(WINDOW):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


@njit(**FINITE_JIT)
def mix_inside(t, marks, first, second, mixed):
    """Mix two windows, of which parts lie outside of their frames: those have no share unless both do."""
    share0 = np.float32(1) - t
    for j in range(WINDOW):
        for i in range(WINDOW):
            weight0, weight1 = share0 * marks[0, i] * marks[1, j], t * marks[2, i] * marks[3, j]
            both = weight0 + weight1
            if both > 0:
                place = j * WINDOW + i
                mixed[place] = (weight0 * first[place] + weight1 * second[place]) / both


@njit(**FINITE_JIT)
def compare_window(distance, scale, padded):
    """Similarity of every pixel of a window, padded by zeros."""
    for j in range(WINDOW):
        begin, to = Index(j * WINDOW), Index((j + PATCH_RADIUS) * PADDED + PATCH_RADIUS)
        for i in range(Index(WINDOW)):
            padded[to + i] = decay(distance[begin + i] * scale)


@njit(**FINITE_JIT)
def sum_patches(values, half_way, sums):
    """Sums over the patch around each pixel of a window; `values` and `half_way` are padded by zeros.

    First down, over the whole window at once, then across.
    """
    for i in range(Index(PADDED * WINDOW)):
        half_way[i] = (
            (values[i] + values[i + Index(PADDED)] + values[i + Index(2 * PADDED)])
            + (values[i + Index(3 * PADDED)] + values[i + Index(4 * PADDED)] + values[i + Index(5 * PADDED)])
            + (values[i + Index(6 * PADDED)] + values[i + Index(7 * PADDED)] + values[i + Index(8 * PADDED)])
        )
    for j in range(WINDOW):
        begin, to = Index(j * PADDED), Index(j * WINDOW)
        for i in range(Index(WINDOW)):
            p = begin + i
            sums[to + i] = (
                (half_way[p] + half_way[p + Index(1)] + half_way[p + Index(2)])
                + (half_way[p + Index(3)] + half_way[p + Index(4)] + half_way[p + Index(5)])
                + (half_way[p + Index(6)] + half_way[p + Index(7)] + half_way[p + Index(8)])
            )


@njit(inline="always", **FINITE_JIT)
def add_row(weight, values, sums, here, there, length):
    """Add the products of two windows, from place `here` on, to a plane from place `there` on."""
    for i in range(Index(length)):
        place = Index(here) + i
        sums[Index(there) + i] += weight[place] * values[place]


@njit(**FINITE_JIT)
def smallest(values, room):
    """The least of a window's values, by halves: a compiler does not reorder comparisons, and one by one they wait."""
    size = AREA // 2
    for i in range(size):
        room[i] = min(values[i], values[i + size])
    while size > LANES:
        size //= 2
        for i in range(size):
            room[i] = min(room[i], room[i + size])
    least = room[0]
    for i in range(1, LANES):
        least = min(least, room[i])
    return least


@njit(**FINITE_JIT)
def finish_rows(band, first, last, top, white, half, lowest, highest, straight_alpha, image, confidence):
    """Write rows of the frame, which no window adds to any more.

    Parameters
    ----------
    band : (C + 2, rows, width) float32
        Weighted sums of the planes, sums of the weights and of weighted similarities; the first to be divided.
    first, last, top : int
        Rows of the band to write, from `first` to before `last`, and the row of the frame where the band begins.
    white, half, lowest, highest : float32
        What 1 becomes, what is added before the fraction is cut off, and the range of the image's values.
    straight_alpha : bool
        Whether all other planes are to be divided by the last.
    image : (height, width, C) out
    confidence : (height, width) float32 out
        Weighted mean similarity to the eighth power: what it would be with a v of about a third. Or without columns.
    """
    channels, width = band.shape[0] - 2, image.shape[1]
    flat, weights, similarities = image.reshape(image.size), band[channels], band[channels + 1]
    for j in range(first, last):
        weight, y = weights[j], top + j
        for c in range(channels):
            values = band[c, j]
            for x in range(width):
                values[x] /= weight[x]
        for c in range(channels):
            values, alpha, to = band[c, j], band[channels - 1, j], y * width * channels + c
            divides = straight_alpha and c < channels - 1
            for x in range(Index(width)):
                value = values[x]
                if divides:
                    value /= max(alpha[x], np.float32(1e-6))
                value = min(max(value * white + half, lowest), highest)
                flat[Index(to) + x * Index(channels)] = image.dtype.type(value)
        if confidence.shape[1]:
            for x in range(width):
                # a few levels of difference are nothing to the weights, but something to the eye
                trust = min(similarities[j, x] / weight[x], np.float32(1))
                trust *= trust
                trust *= trust
                confidence[y, x] = trust * trust


@njit(cache=True, **FINITE_JIT)
def fuse_candidates(
    samples0, samples1, t, count, motions, weights, scale, sharpness, enough, negligible, shape, inverse, white, half,
    lowest, highest, straight_alpha, image, confidence,
):  # fmt: skip
    """Make the in-between frame, row of nodes by row of nodes.

    Parameters
    ----------
    samples0, samples1 : Samples
        Of both frames, with at least SPARE columns beyond the right margin.
    t : float32
    count : (rows, columns) int32
    motions : (rows, columns, room, MOTION) float32
    weights : (rows, columns, room) float32
        See `fpsboost.kernels.candidates`.
    scale : float32
        Factor on squared colour differences.
    sharpness : float32
        How fast a candidate's weight falls with its similarity.
    enough : float32
        Once every pixel of a window has found this similarity, the candidates with fewer votes are left out.
    negligible : float32
        So are they once the votes of the next are less than this share of the weight that every pixel has by then.
    shape, inverse : (AREA,) float32
        What `window_shape` and `patch_shares` give.
    white, half, lowest, highest, straight_alpha
        As for `finish_rows`.
    image : (height, width, C) out
    confidence : (height, width) float32 out
        Or without columns, where nobody asks.
    """
    channels, end, stride = samples0.planes.shape
    flat0, spline0, unit = samples0.planes.ravel(), samples0.coefficients.ravel(), samples0.unit
    flat1, spline1 = samples1.planes.ravel(), samples1.coefficients.ravel()
    height, width, _ = image.shape
    rows_of_nodes, columns_of_nodes = count.shape
    # what the windows of a row of nodes add up to: the weighted mean of each plane, weights and weighted similarities
    band = np.zeros((channels + 2, WINDOW, width), np.float32)
    sums, plane_of_band = band.reshape(band.size), WINDOW * width
    one = np.float32(1)
    rows = np.empty((WINDOW + 3) * WINDOW, np.float32)
    first, second = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    distance, mixed = np.empty(AREA, np.float32), np.empty((channels, AREA), np.float32)
    padded, half_way = np.zeros(PADDED * PADDED, np.float32), np.zeros(PADDED * PADDED, np.float32)
    similarity, weight = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    total, node_weights = np.empty((channels, AREA), np.float32), np.empty(AREA, np.float32)
    node_similarities, most_similar = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    marks = np.empty((4, WINDOW), np.float32)
    for row in range(rows_of_nodes):
        top = row * CELL - (WINDOW - CELL) // 2
        begin_y, end_y = max(-top, 0), min(height - top, WINDOW)
        for column in range(columns_of_nodes):
            left = column * CELL - (WINDOW - CELL) // 2
            begin_x, end_x = max(-left, 0), min(width - left, WINDOW)
            total[:] = 0
            node_weights[:] = TINY
            node_similarities[:] = 0
            most_similar[:] = 0
            least_weight, least_similar = np.float32(0), np.float32(0)
            for k in range(count[row, column]):
                prior = weights[row, column, k]
                if prior <= 0:
                    continue
                if prior < negligible * least_weight or least_similar >= enough:
                    break
                motion = motions[row, column, k]
                y0, x0, y1, x1, within = locate_window(top, left, motion, t, height, width, marks)
                distance[:] = 0
                for c in range(channels):
                    begin = c * end * stride
                    fetch_window(flat0, spline0, unit, begin, stride, end, y0, x0, -t, motion, rows, first)
                    fetch_window(flat1, spline1, unit, begin, stride, end, y1, x1, one - t, motion, rows, second)
                    target = mixed[c]
                    for i in range(AREA):
                        difference = second[i] - first[i]
                        distance[i] = fma(difference, difference, distance[i])
                        target[i] = fma(t, difference, first[i])
                    if not within:
                        mix_inside(t, marks, first, second, target)
                compare_window(distance, scale, padded)
                sum_patches(padded, half_way, similarity)
                for i in range(AREA):
                    alike = similarity[i] * inverse[i]
                    w = prior * decay(sharpness * (one - alike))
                    weight[i] = w
                    node_weights[i] += w
                    node_similarities[i] = fma(w, alike, node_similarities[i])
                    most_similar[i] = max(most_similar[i], alike)
                least_weight, least_similar = smallest(node_weights, distance), smallest(most_similar, distance)
                for c in range(channels):
                    target, source = total[c], mixed[c]
                    for i in range(AREA):
                        target[i] = fma(weight[i], source[i], target[i])
            # between neighbours, too, the more similar one counts more, but not so much that its border shows
            for i in range(AREA):
                weight[i] = shape[i] / math.sqrt(node_weights[i])
            for j in range(begin_y, end_y):
                here, there = j * WINDOW + begin_x, j * width + left + begin_x
                for c in range(channels):
                    add_row(weight, total[c], sums, here, there + c * plane_of_band, end_x - begin_x)
                there += channels * plane_of_band
                add_row(weight, node_weights, sums, here, there, end_x - begin_x)
                add_row(weight, node_similarities, sums, here, there + plane_of_band, end_x - begin_x)
        # the next row of nodes reaches over the lower half
        ready = CELL if row < rows_of_nodes - 1 else end_y
        finish_rows(band, begin_y, ready, top, white, half, lowest, highest, straight_alpha, image, confidence)
        for c in range(channels + 2):
            upper, half_a_plane = c * plane_of_band, CELL * width
            for i in range(Index(half_a_plane)):
                sums[Index(upper) + i] = sums[Index(upper + half_a_plane) + i]
                sums[Index(upper + half_a_plane) + i] = 0


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
