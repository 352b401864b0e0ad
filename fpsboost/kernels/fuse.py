"""The in-between frame as a weighted mean of both frames along every candidate motion of a cell.

A candidate is one motion for a whole cell, so that all its samples lie on a grid of their own: both frames are read in
rows, without looking any pixel up. Every pixel then weighs the candidates by the report's patch similarity of what they
bring together at time t. That is the non-local mean again, over motions instead of pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from fpsboost.kernels.candidates import CELL
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.spline import MARGIN, spline_weights

PATCH_RADIUS = 4
"""Of the patches that are compared at time t, pixels."""

REGION = CELL + 2 * PATCH_RADIUS
ROW = (REGION + LANES - 1) // LANES * LANES
SPARE = ROW - REGION + LANES
"""Columns that planes need beyond the right margin."""

HEARD = np.float32(0.02)
"""Share of all votes below which a candidate is not tried: about what two or three points have that agree."""

UNASKED = np.float32(0.25)
"""Votes of no motion at all, in every corner."""

ALIKE = np.float32(1e-30)
"""Keeps the sum of weights above zero."""


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
def fetch(plane, coefficients, y, x, lanes, rows, out):
    """Sample a region whose first pixel lies at (y, x), in coordinates of the plane; whole places are copied."""
    top, left = math.floor(y), math.floor(x)
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    if fraction_y == 0 and fraction_x == 0:
        for j in range(REGION):
            source, target = plane[top + j, left : left + ROW], out[j]
            for i in range(lanes):
                target[i] = source[i]
        return
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(REGION + 3):
        source, target = coefficients[top - 1 + j, left - 1 : left + 2 + ROW], rows[j]
        for i in range(lanes):
            target[i] = fma(w3, source[i + 3], fma(w2, source[i + 2], fma(w1, source[i + 1], w0 * source[i])))
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for j in range(REGION):
        first, second, third, fourth, target = rows[j], rows[j + 1], rows[j + 2], rows[j + 3], out[j]
        for i in range(lanes):
            target[i] = fma(w3, fourth[i], fma(w2, third[i], fma(w1, second[i], w0 * first[i])))


@njit(**FINITE_JIT)
def mark_inside(start, size, marks):
    """1 where the samples of a region lie inside of a frame along one axis, else 0."""
    for i in range(marks.shape[0]):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


@njit(parallel=True, cache=True, **FINITE_JIT)
def fuse_candidates(
    planes0, coefficients0, planes1, coefficients1, height, width, t, count, votes, corners, sums, bend, scale,
    sharpness, enough, cell, lanes, mean, confidence,
):  # fmt: skip
    """Make the in-between frame.

    Parameters
    ----------
    planes0, coefficients0, planes1, coefficients1 : (C, height + 2 MARGIN, width + 2 MARGIN + SPARE or more) float32
        Both frames; see `fpsboost.kernels.spline`.
    height, width : int
    t : float32
    count : (rows, columns) int32
    votes : (rows, columns, capacity) float32
    corners : (rows, columns, capacity, 2, 2) float32
    sums : (rows, columns, capacity, 2) float32
        See `fpsboost.kernels.candidates`.
    bend : (rows, columns, 2) float32
        How far the path through each cell lies off the straight line at time t, pixels, reversed.
    scale : float32
        Factor on squared colour differences.
    sharpness : float32
        How fast a candidate's weight falls with its similarity.
    enough : float32
        Once every pixel of a cell has found this similarity, the candidates with fewer votes are left out.
    mean : (C, height, width) float32 out
    confidence : (height, width) float32 out
        Weighted mean similarity to the eighth power: what it would be with a v of about a third.
    """
    channels = planes0.shape[0]
    rows_of_cells, columns_of_cells = count.shape
    share, per_cell = np.float32(1 / (2 * PATCH_RADIUS + 1) ** 2), np.float32(1 / CELL)
    half, one = np.float32(0.5), np.float32(1)
    for number in prange(rows_of_cells * columns_of_cells):
        row, column = np.int64(number) // columns_of_cells, np.int64(number) % columns_of_cells
        top, left = row * CELL, column * CELL
        total = np.zeros((channels, CELL, CELL), np.float32)
        weight_sum = np.full((CELL, CELL), ALIKE)
        similarity_sum = np.zeros((CELL, CELL), np.float32)
        rows = np.empty((REGION + 3, ROW), np.float32)
        values0, values1 = np.empty((REGION, ROW), np.float32), np.empty((REGION, ROW), np.float32)
        distance = np.empty((REGION, ROW), np.float32)
        mixed = np.empty((channels, REGION, ROW), np.float32)
        column_sum, weight = np.empty(ROW, np.float32), np.empty(CELL, np.float32)
        marks = np.empty((4, ROW), np.float32)
        most_similar = np.zeros((CELL, CELL), np.float32)
        waiting = votes[row, column].copy()
        favour = np.empty((2, 2), np.float32)
        fewest = HEARD * waiting.sum()
        for turn in range(count[row, column] + 1):
            # by falling votes; the last candidate is no motion at all, hardly with a vote
            dx, dy = np.float32(0), np.float32(0)
            favour[:] = UNASKED
            if turn < count[row, column]:
                k = np.argmax(waiting)
                if waiting[k] < fewest:
                    continue
                waiting[k] = 0
                dx, dy = (
                    sums[row, column, k, 0] / votes[row, column, k],
                    sums[row, column, k, 1] / votes[row, column, k],
                )
                favour[:] = corners[row, column, k]
            # what stands still is left alone, whatever its surroundings do
            moves = min(np.float32(4) * (abs(dx) + abs(dy)), one)
            x0 = np.float32(left - PATCH_RADIUS) + moves * bend[row, column, 0] - t * dx
            y0 = np.float32(top - PATCH_RADIUS) + moves * bend[row, column, 1] - t * dy
            x1, y1 = x0 + dx, y0 + dy
            within = (
                min(x0, x1) >= 0
                and min(y0, y1) >= 0
                and max(x0, x1) <= width - REGION
                and max(y0, y1) <= height - REGION
            )
            if not within:
                mark_inside(x0, width, marks[0])
                mark_inside(y0, height, marks[1])
                mark_inside(x1, width, marks[2])
                mark_inside(y1, height, marks[3])
            # beyond the margin nothing changes any more
            lowest, margin = np.float32(2 - MARGIN), np.float32(MARGIN)
            highest_x, highest_y = np.float32(width + 2), np.float32(height + 2)
            x0, x1 = min(max(x0, lowest), highest_x) + margin, min(max(x1, lowest), highest_x) + margin
            y0, y1 = min(max(y0, lowest), highest_y) + margin, min(max(y1, lowest), highest_y) + margin
            distance[:] = 0
            for c in range(channels):
                fetch(planes0[c], coefficients0[c], y0, x0, lanes, rows, values0)
                fetch(planes1[c], coefficients1[c], y1, x1, lanes, rows, values1)
                for j in range(REGION):
                    first, second, apart, target = values0[j], values1[j], distance[j], mixed[c, j]
                    for i in range(lanes):
                        difference = second[i] - first[i]
                        apart[i] = fma(difference, difference, apart[i])
                        target[i] = fma(t, difference, first[i])
                    if not within:
                        in0, in1 = marks[0], marks[2]
                        for i in range(lanes):
                            share0, share1 = (one - t) * in0[i] * marks[1, j], t * in1[i] * marks[3, j]
                            both = share0 + share1
                            if both > 0:
                                target[i] = (share0 * first[i] + share1 * second[i]) / both
            for j in range(REGION):
                apart = distance[j]
                for i in range(lanes):
                    apart[i] = decay(apart[i] * scale)
            for y in range(CELL):
                for i in range(lanes):
                    column_sum[i] = distance[y, i]
                for j in range(1, 2 * PATCH_RADIUS + 1):
                    apart = distance[y + j]
                    for i in range(lanes):
                        column_sum[i] += apart[i]
                sum_of_weights, sum_of_similarities, best = weight_sum[y], similarity_sum[y], most_similar[y]
                # between its corners a cell has votes like its neighbours, or borders would show
                down = (np.float32(y) + half) * per_cell
                left_favour = favour[0, 0] + down * (favour[1, 0] - favour[0, 0])
                right_favour = favour[0, 1] + down * (favour[1, 1] - favour[0, 1])
                slope = (right_favour - left_favour) * per_cell
                for x in range(cell):
                    similarity = np.float32(0)
                    for i in range(2 * PATCH_RADIUS + 1):
                        similarity += column_sum[x + i]
                    similarity *= share
                    w = fma(slope, np.float32(x) + half, left_favour) * decay(sharpness * (one - similarity))
                    sum_of_weights[x] += w
                    sum_of_similarities[x] += w * similarity
                    weight[x] = w
                    best[x] = max(best[x], similarity)
                for c in range(channels):
                    target, source = total[c, y], mixed[c, y + PATCH_RADIUS, PATCH_RADIUS : PATCH_RADIUS + CELL]
                    for x in range(cell):
                        target[x] = fma(weight[x], source[x], target[x])
            if most_similar.min() >= enough:
                break
        for y in range(min(CELL, height - top)):
            for x in range(min(CELL, width - left)):
                # a few levels of difference are nothing to the weights, but something to the eye
                trust = similarity_sum[y, x] / weight_sum[y, x]
                trust *= trust
                trust *= trust
                confidence[top + y, left + x] = trust * trust
                for c in range(channels):
                    mean[c, top + y, left + x] = total[c, y, x] / weight_sum[y, x]


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
