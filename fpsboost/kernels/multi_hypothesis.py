"""In-between frame as a weighted mean of both frames along every candidate motion.

Each node has a window, which overlaps those of its neighbours. A candidate is one motion for a whole window, so that
all its samples lie on a regular grid: both frames are read in rows, without looking up single pixels. At every pixel,
the candidates are weighted by the report's patch similarity of the two samples at time t: non-local means over motions
instead of pixels. Windows are faded into each other, so that no borders are visible (overlapped block motion
compensation, Orchard and Sullivan 1994, doi:10.1109/83.334974).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fpsboost.kernels.candidates import NODE_SPACING, VALUES_PER_MOTION
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.lanes import EIGHT, filter_eight, filter_sixteen
from fpsboost.kernels.levels import SIXTEEN
from fpsboost.kernels.spline import MARGIN, spline_weights
from fpsboost.kernels.tiles import Index
from fpsboost.kernels.window_rows import (
    END_WEIGHT,
    SQUARES_PER_ROW,
    add_row,
    blend_rows,
    mix_eight,
    mix_sixteen,
    pool_row,
    spread_rows,
    sum_five,
)


class Samples(NamedTuple):
    """Planes of an image with repeated edges, and their spline coefficients; see `fpsboost.kernels.spline`."""

    planes: NDArray[Any]
    """Values, (C, H + 2 MARGIN, W + 2 MARGIN or more) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """float32, shaped like the planes: coefficients of their values times `unit`."""
    unit: np.float32


class Room(NamedTuple):
    """Work arrays for sampling a window."""

    rows: NDArray[Any]
    """((WINDOW + 3) * WINDOW,) float32, rows filtered horizontally."""
    first: NDArray[Any]
    """Window of frame 0, (AREA,) float32."""
    second: NDArray[Any]
    """Window of frame 1, (AREA,) float32."""
    taps: NDArray[Any]
    """(16,) float32, horizontal and vertical weights in frame 0, then in frame 1."""


WINDOW = 2 * NODE_SPACING
"""Side of a window, pixels."""

AREA = WINDOW * WINDOW
"""Pixels of a window: an operation that is the same for all of them is one loop."""

SQUARES_PER_WINDOW = SQUARES_PER_ROW * SQUARES_PER_ROW
"""Number of squares of two by two pixels in a window; each square has one weight."""

BLOCK = EIGHT
"""Side of the blocks of a window that move as their centre does, pixels."""

MIN_GRADIENT, MAX_GRADIENT = np.float32(0.05), np.float32(0.5)
"""Minimum and maximum motion gradient of a window that is zoomed or rotated, pixels per pixel; the sum over both axes.

Below the minimum, the blocks of a window would move by less than windows overlap anyway. A gradient above the maximum
is not zoom or rotation, which would have to be by half or by 30 degrees from frame to frame, but the boundary of two
motions, where the blocks would be torn apart.
"""

PATCH_RADIUS = 2
"""Radius of the patches that are compared at time t, squares; patches are truncated at the border of their window."""

PADDED = SQUARES_PER_ROW + 2 * PATCH_RADIUS
"""Squares in a row of a window with zero padding on both sides, for sums over patches."""

SPARE = LANES
"""Columns that planes need beyond the right margin."""

MIN_WEIGHT_SUM = np.float32(1e-30)
"""Initial value of sums of weights, which keeps them above zero."""


@njit(**FINITE_JIT)
def decay(x):
    """Return exp(-x) for x >= 0, accurate to a millionth: a polynomial of x / 64, squared six times."""
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
    """Return the position of a window in both frames at time t.

    Parameters
    ----------
    top, left : int
        First pixel of the window.
    motion : (VALUES_PER_MOTION,) float32
    t : float32
    height, width : int
        Size of the frames.
    marks : (4, WINDOW) float32 out
        Written if the window is partly outside: 1 for each column inside of frame 0, else 0, each row, and the same
        for frame 1.

    Returns
    -------
    y0, x0, y1, x1 : float32
        Position of the first pixel in plane coordinates, limited to the margin, beyond which the repeated edges do not
        change.
    within : bool
        Whether the whole window lies inside of both frames.
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
def fetch_rigid(planes, coefficients, unit, begin, stride, y, x, wide, tall, rows, out):
    """Sample a window that moves as a whole; integer positions are copied. See `fetch_window`."""
    top, left = int(y), int(x)  # never below 1
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    if fraction_y == 0 and fraction_x == 0:
        for j in range(tall):
            place, to = Index(begin + (top + j) * stride + left), Index(j * wide)
            for i in range(Index(wide)):
                out[to + i] = np.float32(planes[place + i]) * unit
        return
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(tall + 3):
        place, to = begin + (top - 1 + j) * stride + left - 1, j * wide
        for i in range(0, wide, SIXTEEN):
            filter_sixteen(coefficients, place + i, 1, w0, w1, w2, w3, rows, to + i)
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for i in range(0, tall * wide, SIXTEEN):
        filter_sixteen(rows, i, wide, w0, w1, w2, w3, out, i)


@njit(**FINITE_JIT)
def locate_block(y, x, down, across, share, motion, wide, tall, end, stride):
    """Return the position of a block of a zoomed or rotated window; a block moves as its centre does."""
    one, last_y, last_x = np.float32(1), np.float32(end - BLOCK - 3), np.float32(stride - BLOCK - 3)
    from_x, from_y = np.float32(across + (BLOCK - wide) // 2), np.float32(down + (BLOCK - tall) // 2)
    place_x = x + np.float32(across) + share * (from_x * motion[4] + from_y * motion[6])
    place_y = y + np.float32(down) + share * (from_x * motion[5] + from_y * motion[7])
    return min(max(place_y, one), last_y), min(max(place_x, one), last_x)


@njit(**FINITE_JIT)
def is_rigid(motion):
    """Return whether a window moves as a whole."""
    gradient = abs(motion[4]) + abs(motion[5]) + abs(motion[6]) + abs(motion[7])
    return gradient < MIN_GRADIENT or gradient > MAX_GRADIENT


@njit(**FINITE_JIT)
def fetch_window(planes, coefficients, unit, begin, stride, end, y, x, share, motion, wide, tall, rows, out):
    """Sample a window whose motion at the centre places its first pixel at (y, x), in plane coordinates.

    Parameters
    ----------
    planes : (size,) uint8, uint16 or float32
    coefficients : (size,) float32
        Spline coefficients of the planes times `unit`.
    unit : float32
    begin : int
        Index of the first element of a plane, in both arrays.
    stride : int
        Distance between rows.
    end : int
        Rows of a plane.
    y, x : float32
        Position, at least 1, and at least a window and 2 pixels from the ends.
    share : float32
        Share of the motion from time t to this frame; negative against its direction.
    motion : (VALUES_PER_MOTION,) float32
    wide, tall : int
        Columns and rows of the window.
    rows : ((tall + 3) * wide,) float32
        Work array.
    out : (tall * wide,) float32 out
    """
    if is_rigid(motion):
        fetch_rigid(planes, coefficients, unit, begin, stride, y, x, wide, tall, rows, out)
        return
    for down in range(0, tall, BLOCK):
        for across in range(0, wide, BLOCK):
            place_y, place_x = locate_block(y, x, down, across, share, motion, wide, tall, end, stride)
            top, left = int(place_y), int(place_x)
            place, to = begin + (top - 1) * stride + left - 1, down * wide + across
            w0, w1, w2, w3 = spline_weights(place_x - np.float32(left))
            for j in range(BLOCK + 3):
                filter_eight(coefficients, place + j * stride, 1, w0, w1, w2, w3, rows, j * BLOCK)
            w0, w1, w2, w3 = spline_weights(place_y - np.float32(top))
            for j in range(BLOCK):
                filter_eight(rows, j * BLOCK, BLOCK, w0, w1, w2, w3, out, to + j * wide)


@njit(**FINITE_JIT)
def set_taps(y, x, number, taps):
    """Write the weights of a position in one of two frames; return the row and column of its first coefficient."""
    top, left = int(y), int(x)
    for k, fraction in enumerate((x - np.float32(left), y - np.float32(top))):
        w0, w1, w2, w3 = spline_weights(fraction)
        at = 8 * number + 4 * k
        taps[at], taps[at + 1], taps[at + 2], taps[at + 3] = w0, w1, w2, w3
    return top - 1, left - 1


@njit(**FINITE_JIT)
def mix_fetched(
    planes0, spline0, planes1, spline1, unit, begin, stride, end, y0, x0, y1, x1, t, motion, wide, tall, within, marks,
    room, distance, mixed,
):  # fmt: skip
    """Sample a window of both frames, blend the samples by time, and add up their squared differences.

    Parameters
    ----------
    planes0, spline0, planes1, spline1, unit, begin, stride, end, y0, x0, y1, x1, motion, wide, tall
        As for `fetch_window`, for both frames.
    t : float32
    within, marks
        As returned by `locate_window`: samples outside of their frame have no weight unless both are outside.
    room : Room
    distance : (tall * wide,) float32
        Sums of squared differences; updated in place.
    mixed : (tall * wide,) float32 out
    """
    one, rigid = np.float32(1), is_rigid(motion)
    is_whole = (y0 == int(y0) and x0 == int(x0)) or (y1 == int(y1) and x1 == int(x1))
    if not within or (rigid and is_whole):
        first, second = room.first, room.second
        fetch_window(planes0, spline0, unit, begin, stride, end, y0, x0, -t, motion, wide, tall, room.rows, first)
        fetch_window(planes1, spline1, unit, begin, stride, end, y1, x1, one - t, motion, wide, tall, room.rows, second)
        for i in range(Index(mixed.size)):
            difference = second[i] - first[i]
            distance[i] = fma(difference, difference, distance[i])
            mixed[i] = fma(t, difference, first[i])
        if not within:
            mix_inside(t, marks, WINDOW // wide, WINDOW // tall, first, second, mixed)
    elif rigid:
        row0, column0 = set_taps(y0, x0, 0, room.taps)
        row1, column1 = set_taps(y1, x1, 1, room.taps)
        place0, place1 = begin + row0 * stride + column0, begin + row1 * stride + column1
        for i in range(0, wide, SIXTEEN):
            mix_sixteen(spline0, place0 + i, spline1, place1 + i, stride, tall, room.taps, t, wide, mixed, distance, i)
    else:
        for down in range(0, tall, BLOCK):
            for across in range(0, wide, BLOCK):
                v0, u0 = locate_block(y0, x0, down, across, -t, motion, wide, tall, end, stride)
                v1, u1 = locate_block(y1, x1, down, across, one - t, motion, wide, tall, end, stride)
                row0, column0 = set_taps(v0, u0, 0, room.taps)
                row1, column1 = set_taps(v1, u1, 1, room.taps)
                place0, place1 = begin + row0 * stride + column0, begin + row1 * stride + column1
                to = down * wide + across
                mix_eight(spline0, place0, spline1, place1, stride, BLOCK, room.taps, t, wide, mixed, distance, to)


@njit(**FINITE_JIT)
def mark_inside(start, size, marks):
    """Write 1 for the samples of a window that lie inside of a frame along one axis, else 0."""
    for i in range(WINDOW):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


@njit(**FINITE_JIT)
def mix_inside(t, marks, across, down, first, second, mixed):
    """Blend two windows that are partly outside; samples outside have no weight unless both are outside.

    Each sample stands for `across` columns and `down` rows of pixels.
    """
    share0, wide = np.float32(1) - t, WINDOW // across
    for j in range(WINDOW // down):
        for i in range(wide):
            x, y = i * across, j * down
            weight0, weight1 = share0 * marks[0, x] * marks[1, y], t * marks[2, x] * marks[3, y]
            both = weight0 + weight1
            if both > 0:
                place = j * wide + i
                mixed[place] = (weight0 * first[place] + weight1 * second[place]) / both


@njit(**FINITE_JIT)
def pool_chroma(values, down, pooled):
    """Add the mean of its one or two chroma samples to each square of a window."""
    if down == 2:
        for i in range(Index(SQUARES_PER_WINDOW)):
            pooled[i] += values[i]
    else:
        for j in range(SQUARES_PER_ROW):
            begin, to = Index(2 * j * SQUARES_PER_ROW), Index(j * SQUARES_PER_ROW)
            for i in range(Index(SQUARES_PER_ROW)):
                pooled[to + i] += np.float32(0.5) * (values[begin + i] + values[begin + Index(SQUARES_PER_ROW) + i])


@njit(**FINITE_JIT)
def sum_patches(values, padded, half_way, sums):
    """Sum the values over the patch around each square of a window, vertically, then horizontally.

    `padded` and `half_way` have zeros around the window.
    """
    for i in range(Index(SQUARES_PER_WINDOW)):
        padded[Index(PATCH_RADIUS * SQUARES_PER_ROW) + i] = values[i]
    for j in range(SQUARES_PER_ROW):
        sum_five(padded, j * SQUARES_PER_ROW, SQUARES_PER_ROW, half_way, j * PADDED + PATCH_RADIUS)
    for j in range(SQUARES_PER_ROW):
        sum_five(half_way, j * PADDED, 1, sums, j * SQUARES_PER_ROW)


@njit(**FINITE_JIT)
def spread_squares(squares, across, down, spread):
    """Interpolate the values of the squares at each sample of a window.

    Without interpolation, steps would be visible where no candidate fits.

    A sample stands for `across` columns and `down` rows of pixels.
    """
    for j in range(WINDOW // down):
        row = j * down // 2
        near, far = row * SQUARES_PER_ROW, min(max(row + 2 * (j % 2) - 1, 0), SQUARES_PER_ROW - 1) * SQUARES_PER_ROW
        if across == 1:
            spread_rows(squares, near, far, spread, j * WINDOW)
        elif down == 1:
            blend_rows(squares, near, far, spread, j * SQUARES_PER_ROW)
        else:
            blend_rows(squares, near, near, spread, j * SQUARES_PER_ROW)


@njit(**FINITE_JIT)
def add_window(weight, wide, values, first_y, last_y, first_x, last_x, left, band):
    """Add a weighted window to a plane of a band.

    Parameters
    ----------
    weight, values : (size,) float32
    wide : int
        Columns of the window.
    first_y, last_y, first_x, last_x : int
        Part of the window that lies within the frame.
    left : int
        Column of the plane at which the window begins.
    band : (rows, columns) float32
        Updated in place.
    """
    columns, flat = band.shape[1], band.reshape(band.size)
    for j in range(first_y, last_y):
        here, there = j * wide, j * columns + left
        if last_x - first_x < wide:
            for i in range(first_x, last_x):
                flat[there + i] += weight[here + i] * values[here + i]
        else:
            for i in range(0, wide, SIXTEEN):
                add_row(weight, here + i, values, here + i, flat, there + i)


@njit(**FINITE_JIT)
def smallest(values, room):
    """Return the minimum of a window's values, computed by repeated halving.

    A compiler does not reorder comparisons, and a sequential minimum would be limited by their latency.
    """
    size = SQUARES_PER_WINDOW // 2
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
def finish_rows(band, first, last, top, white, half, lowest, highest, straight_alpha, image):
    """Normalise and write rows of the frame that no further window contributes to.

    Parameters
    ----------
    band : (C + 1 or more, rows, width) float32
        Weighted sums of the planes, and sums of the weights; the weighted sums are divided in place.
    first, last, top : int
        Rows of the band to write, from `first` to before `last`, and the row of the frame at which the band begins.
    white, half, lowest, highest : float32
        Factor on the values, offset added before truncation, and range of the image's values.
    straight_alpha : bool
        Whether to divide all other planes by the last one.
    image : (C, height, width) out
    """
    channels, _, width = image.shape
    for j in range(first, last):
        weight = band[channels, j]
        for c in range(channels):
            values = band[c, j]
            for x in range(width):
                values[x] /= weight[x]
        for c in range(channels):
            values, alpha, to = band[c, j], band[channels - 1, j], image[c, top + j]
            divides = straight_alpha and c < channels - 1
            for x in range(Index(width)):
                value = values[x]
                if divides:
                    value /= max(alpha[x], np.float32(1e-6))
                value = min(max(value * white + half, lowest), highest)
                to[x] = image.dtype.type(value)


@njit(**FINITE_JIT)
def finish_confidence(weights, similarities, first, last, top, confidence):
    """Write rows of the confidence that no further window contributes to: mean similarity to the eighth power.

    The mean is weighted. The power corresponds to a bandwidth of about a third: a few levels of difference hardly change the
    weights, but are visible.
    """
    for j in range(first, last):
        for x in range(confidence.shape[1]):
            trust = min(similarities[j, x] / weights[j, x], np.float32(1))
            trust *= trust
            trust *= trust
            confidence[top + j, x] = trust * trust


@njit(**FINITE_JIT)
def shift_rows_up(band, rows):
    """Shift the rows of a band up by `rows`, and fill the rows below with zeros."""
    planes, height, width = band.shape
    for c in range(planes):
        for j in range(height - rows):
            for x in range(width):
                band[c, j, x] = band[c, j + rows, x]
        for j in range(height - rows, height):
            for x in range(width):
                band[c, j, x] = 0


@njit(cache=True, **FINITE_JIT)
def blend_hypotheses(
    samples0, samples1, chroma0, chroma1, down, t, count, motions, weights, scale, sharpness, enough, negligible,
    shape, inverse, white, half, lowest, highest, straight_alpha, image, chroma, confidence,
):  # fmt: skip
    """Write the in-between frame, one row of nodes at a time.

    Parameters
    ----------
    samples0, samples1 : Samples
        Samples of both frames, with at least SPARE columns beyond the right margin.
    chroma0, chroma1 : Samples
        Samples of planes that have one sample for two columns of pixels; empty without chroma subsampling.
    down : int
        Rows of pixels per row of chroma, 1 or 2.
    t : float32
    count : (rows, columns) int32
    motions : (rows, columns, room, VALUES_PER_MOTION) float32
    weights : (rows, columns, room) float32
        See `fpsboost.kernels.candidates`.
    scale : float32
        Factor on squared colour differences.
    sharpness : float32
        Rate at which a candidate's weight decays as its similarity falls.
    enough : float32
        Similarity at which, once every pixel of a window has it, the candidates with fewer votes are skipped.
    negligible : float32
        Remaining candidates are also skipped once the votes of the next one are below this share of the least
        accumulated weight of any pixel.
    shape, inverse : (SQUARES_PER_WINDOW,) float32
        As returned by `window_shape` and `patch_shares`.
    white, half, lowest, highest, straight_alpha
        As for `finish_rows`.
    image : (C, height, width) out
    chroma : (0 or 2, rows of chroma, columns of chroma) out
    confidence : (height, width) float32 out
        Has no columns if the confidence is not requested.
    """
    channels, end, stride = samples0.planes.shape
    flat0, spline0, unit = samples0.planes.ravel(), samples0.coefficients.ravel(), samples0.unit
    flat1, spline1 = samples1.planes.ravel(), samples1.coefficients.ravel()
    _, height, width = image.shape
    rows_of_nodes, columns_of_nodes = count.shape
    # sums over the windows of a row of nodes: weighted values of each plane, weights and weighted similarities
    told = 1 if confidence.shape[1] else 0
    band = np.zeros((channels + 1 + told, WINDOW, width), np.float32)
    one, margin = np.float32(1), np.float32(MARGIN)
    rows = np.empty((WINDOW + 3) * WINDOW, np.float32)
    room = Room(rows, np.empty(AREA, np.float32), np.empty(AREA, np.float32), np.empty(16, np.float32))
    distance, mixed = np.empty(AREA, np.float32), np.empty((channels, AREA), np.float32)
    apart, half_way = np.empty(SQUARES_PER_WINDOW, np.float32), np.zeros(SQUARES_PER_ROW * PADDED, np.float32)
    padded = np.zeros((SQUARES_PER_ROW + 2 * PATCH_RADIUS) * SQUARES_PER_ROW, np.float32)
    similarity, weight = np.empty(SQUARES_PER_WINDOW, np.float32), np.empty(SQUARES_PER_WINDOW, np.float32)
    total, node_weights = np.empty((channels, AREA), np.float32), np.empty(SQUARES_PER_WINDOW, np.float32)
    node_similarities, most_similar = np.empty(SQUARES_PER_WINDOW, np.float32), np.empty(SQUARES_PER_WINDOW, np.float32)
    of_pixels, of_node = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    marks = np.empty((4, WINDOW), np.float32)
    # work arrays for chroma
    differences, end_of_chroma, stride_of_chroma = chroma0.planes.shape
    chroma_flat0, chroma_spline0 = chroma0.planes.ravel(), chroma0.coefficients.ravel()
    chroma_flat1, chroma_spline1 = chroma1.planes.ravel(), chroma1.coefficients.ravel()
    chroma_width = chroma.shape[2]
    # not constants, for which all kernels below would be compiled again
    pixels, samples = marks.shape[1], marks.shape[1] // 2
    tall, has_alpha, cell = pixels // down, straight_alpha, pixels // 2
    chroma_area, by_row = tall * SQUARES_PER_ROW, one / np.float32(down)
    chroma_band = np.zeros((differences + 1, tall, chroma_width), np.float32)
    chroma_distance = np.empty(chroma_area, np.float32)
    chroma_mixed = np.empty((differences, chroma_area), np.float32)
    chroma_total = np.empty((differences, chroma_area), np.float32)
    chroma_motion = np.empty(VALUES_PER_MOTION, np.float32)
    for row in range(rows_of_nodes):
        top = row * NODE_SPACING - (WINDOW - NODE_SPACING) // 2
        begin_y, end_y = max(-top, 0), min(height - top, WINDOW)
        for column in range(columns_of_nodes):
            left = column * NODE_SPACING - (WINDOW - NODE_SPACING) // 2
            begin_x, end_x = max(-left, 0), min(width - left, WINDOW)
            total[:] = 0
            node_weights[:] = MIN_WEIGHT_SUM
            node_similarities[:] = 0
            most_similar[:] = 0
            chroma_total[:] = 0
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
                    mix_fetched(
                        flat0, spline0, flat1, spline1, unit, c * end * stride, stride, end, y0, x0, y1, x1, t, motion,
                        pixels, pixels, within, marks, room, distance, mixed[c],
                    )  # fmt: skip
                apart[:] = 0
                for j in range(SQUARES_PER_ROW):
                    pool_row(distance, 2 * j * WINDOW, WINDOW, np.float32(0.25), apart, j * SQUARES_PER_ROW)
                if differences:
                    # in units of chroma samples; the chroma siting has no influence on displacements
                    y0, y1 = (y0 - margin) * by_row + margin, (y1 - margin) * by_row + margin
                    x0, x1 = (x0 - margin) * np.float32(0.5) + margin, (x1 - margin) * np.float32(0.5) + margin
                    chroma_motion[4], chroma_motion[7] = motion[4], motion[7]
                    chroma_motion[5], chroma_motion[6] = motion[5] * by_row * 2, motion[6] * down * np.float32(0.5)
                    chroma_distance[:] = 0
                for c in range(differences):
                    begin = c * end_of_chroma * stride_of_chroma
                    mix_fetched(
                        chroma_flat0, chroma_spline0, chroma_flat1, chroma_spline1, unit, begin, stride_of_chroma,
                        end_of_chroma, y0, x0, y1, x1, t, chroma_motion, samples, tall, within, marks, room,
                        chroma_distance, chroma_mixed[c],
                    )  # fmt: skip
                if differences:
                    pool_chroma(chroma_distance, down, apart)
                for i in range(SQUARES_PER_WINDOW):
                    apart[i] = decay(apart[i] * scale)
                sum_patches(apart, padded, half_way, similarity)
                for i in range(SQUARES_PER_WINDOW):
                    alike = similarity[i] * inverse[i]
                    w = prior * decay(sharpness * (one - alike))
                    weight[i] = w
                    node_weights[i] += w
                    node_similarities[i] = fma(w, alike, node_similarities[i])
                    most_similar[i] = max(most_similar[i], alike)
                least_weight, least_similar = smallest(node_weights, apart), smallest(most_similar, apart)
                spread_squares(weight, 1, 1, of_pixels)
                for c in range(channels):
                    target, source = total[c], mixed[c]
                    for i in range(AREA):
                        target[i] = fma(of_pixels[i], source[i], target[i])
                if differences:
                    spread_squares(weight, 2, down, of_pixels)
                for c in range(differences):
                    target, source = chroma_total[c], chroma_mixed[c]
                    for i in range(chroma_area):
                        target[i] = fma(of_pixels[i], source[i], target[i])
            # the more similar of neighbouring windows has more weight, but not so much that its border is visible
            for i in range(SQUARES_PER_WINDOW):
                weight[i] = shape[i] / math.sqrt(node_weights[i])
            spread_squares(weight, 1, 1, of_pixels)
            for c in range(channels):
                add_window(of_pixels, pixels, total[c], begin_y, end_y, begin_x, end_x, left, band[c])
            spread_squares(node_weights, 1, 1, of_node)
            add_window(of_pixels, pixels, of_node, begin_y, end_y, begin_x, end_x, left, band[channels])
            if told:
                spread_squares(node_similarities, 1, 1, of_node)
                add_window(of_pixels, pixels, of_node, begin_y, end_y, begin_x, end_x, left, band[channels + 1])
            if differences:
                first_y, last_y = begin_y // down, (end_y + down - 1) // down
                first_x, last_x = begin_x // 2, (end_x + 1) // 2
                spread_squares(weight, 2, down, of_pixels)
                spread_squares(node_weights, 2, down, of_node)
                for c in range(differences + 1):
                    source = chroma_total[c] if c < differences else of_node
                    add_window(of_pixels, samples, source, first_y, last_y, first_x, last_x, left // 2, chroma_band[c])
        # the windows of the next row of nodes overlap the lower half
        ready = NODE_SPACING if row < rows_of_nodes - 1 else end_y
        if told:
            finish_confidence(band[channels], band[channels + 1], begin_y, ready, top, confidence)
        finish_rows(band, begin_y, ready, top, white, half, lowest, highest, has_alpha, image)
        shift_rows_up(band, cell)
        if differences:
            begin, ready = begin_y // down, (ready + down - 1) // down
            finish_rows(chroma_band, begin, ready, top // down, white, half, lowest, highest, has_alpha, chroma)
            shift_rows_up(chroma_band, cell // down)


def window_shape() -> np.ndarray:
    """Return the weight of each square of a window: from 0 at its border to 1 at its centre.

    The weight is smooth at both ends, and the weights of the windows that overlap at a square add up to 1.

    Returns
    -------
    (SQUARES_PER_WINDOW,) float32
    """
    way = 1 - np.abs(np.arange(SQUARES_PER_ROW) + 0.5 - SQUARES_PER_ROW / 2) / (SQUARES_PER_ROW / 2)
    smooth = way * way * (3 - 2 * way)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


def patch_shares() -> np.ndarray:
    """Return 1 over the total weight of the squares of each patch that lie within its window.

    Returns
    -------
    (SQUARES_PER_WINDOW,) float32
    """
    length = np.convolve(np.ones(SQUARES_PER_ROW), [END_WEIGHT, 1, 1, 1, END_WEIGHT], mode="same")
    return (1 / np.outer(length, length)).ravel().astype(np.float32)
