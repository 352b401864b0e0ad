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

from fpsboost.kernels.candidates import CELL, MOTION
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.lanes import EIGHT, filter_eight, filter_sixteen
from fpsboost.kernels.spline import MARGIN, spline_weights
from fpsboost.kernels.tiles import Index
from fpsboost.kernels.window_rows import (
    END,
    SQUARES,
    add_row,
    blend_rows,
    mix_eight,
    mix_sixteen,
    pool_row,
    spread_rows,
    sum_five,
)


class Samples(NamedTuple):
    """An image as planes with repeated edges, and the spline through them; see `fpsboost.kernels.spline`."""

    planes: NDArray[Any]
    """(C, H + 2 MARGIN, W + 2 MARGIN or more) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """float32, shaped like the planes: of their values times `unit`."""
    unit: np.float32


class Room(NamedTuple):
    """What is written to while a window is sampled."""

    rows: NDArray[Any]
    """((WINDOW + 3) * WINDOW,) float32."""
    first: NDArray[Any]
    """(AREA,) float32, a window of frame 0."""
    second: NDArray[Any]
    """(AREA,) float32, a window of frame 1."""
    taps: NDArray[Any]
    """(16,) float32, weights across and down in frame 0, and in frame 1."""


WINDOW = 2 * CELL
"""Side of a window, pixels."""

AREA = WINDOW * WINDOW
"""Pixels of a window: what is done to each alike is one loop over all of them."""

HALF = WINDOW // 2
"""Weights across a window: one for two pixels, as of chroma. They are means over patches, which change slowly."""

QUADS = HALF * HALF
"""Squares of two by two pixels of a window, which have one weight."""

BLOCK = EIGHT
"""Side of the parts of a window that move as their middle does, pixels."""

MIN_GRADIENT, MAX_GRADIENT = np.float32(0.05), np.float32(0.5)
"""Changes of motion from pixel to pixel between which a window is zoomed or turned; the sum along both axes.

Below them the parts of a window would be moved by less than windows overlap anyway. Above them there is no zoom and no
turn, which would have to be by half or by 30 degrees from frame to frame, but the border of two motions, and the parts
would be torn apart at their edges.
"""

PATCH_RADIUS = 2
"""Of the patches that are compared at time t, squares; beyond their window they are cut off."""

PADDED = HALF + 2 * PATCH_RADIUS
"""Squares of a window's row with zeros on both sides, for sums over patches."""

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
def fetch_rigid(planes, coefficients, unit, begin, stride, y, x, wide, tall, rows, out):
    """Sample a window that moves as a whole; whole places are copied. See `fetch_window`."""
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
        for i in range(0, wide, SQUARES):
            filter_sixteen(coefficients, place + i, 1, w0, w1, w2, w3, rows, to + i)
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for i in range(0, tall * wide, SQUARES):
        filter_sixteen(rows, i, wide, w0, w1, w2, w3, out, i)


@njit(**FINITE_JIT)
def locate_block(y, x, down, across, share, motion, wide, tall, end, stride):
    """Where a block of a window that is zoomed or turned lies: it moves as its middle does."""
    one, last_y, last_x = np.float32(1), np.float32(end - BLOCK - 3), np.float32(stride - BLOCK - 3)
    from_x, from_y = np.float32(across + (BLOCK - wide) // 2), np.float32(down + (BLOCK - tall) // 2)
    place_x = x + np.float32(across) + share * (from_x * motion[4] + from_y * motion[6])
    place_y = y + np.float32(down) + share * (from_x * motion[5] + from_y * motion[7])
    return min(max(place_y, one), last_y), min(max(place_x, one), last_x)


@njit(**FINITE_JIT)
def is_rigid(motion):
    """Whether a window moves as a whole."""
    gradient = abs(motion[4]) + abs(motion[5]) + abs(motion[6]) + abs(motion[7])
    return gradient < MIN_GRADIENT or gradient > MAX_GRADIENT


@njit(**FINITE_JIT)
def fetch_window(planes, coefficients, unit, begin, stride, end, y, x, share, motion, wide, tall, rows, out):
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
        At least 1, and a window and 2 pixels from the ends.
    share : float32
        Of the motion that leads from time t to this frame: below 0 against it.
    motion : (MOTION,) float32
    wide, tall : int
        Columns and rows of the window.
    rows : ((tall + 3) * wide,) float32
        Room.
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
    """The weights of a place in one of two frames; return its first coefficient's row and column."""
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
    """Sample a window of both frames, mix them by time, and add up their squared differences.

    Parameters
    ----------
    planes0, spline0, planes1, spline1, unit, begin, stride, end, y0, x0, y1, x1, motion, wide, tall
        As for `fetch_window`, of both frames.
    t : float32
    within, marks
        As `locate_window` gives them: what lies outside has no share, unless both samples do.
    room : Room
    distance : (tall * wide,) float32
        In and out.
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
        for i in range(0, wide, SQUARES):
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
    """1 where the samples of a window lie inside of a frame along one axis, else 0."""
    for i in range(WINDOW):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


@njit(**FINITE_JIT)
def mix_inside(t, marks, across, down, first, second, mixed):
    """Mix two windows, of which parts lie outside of their frames: those have no share unless both do.

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
    """Add to each square of a window the mean of its samples of chroma, of which there are one or two."""
    if down == 2:
        for i in range(Index(QUADS)):
            pooled[i] += values[i]
    else:
        for j in range(HALF):
            begin, to = Index(2 * j * HALF), Index(j * HALF)
            for i in range(Index(HALF)):
                pooled[to + i] += np.float32(0.5) * (values[begin + i] + values[begin + Index(HALF) + i])


@njit(**FINITE_JIT)
def sum_patches(values, padded, half_way, sums):
    """Sums over the patch around each square of a window; `padded` and `half_way` have zeros around it.

    First down, then across.
    """
    for i in range(Index(QUADS)):
        padded[Index(PATCH_RADIUS * HALF) + i] = values[i]
    for j in range(HALF):
        sum_five(padded, j * HALF, HALF, half_way, j * PADDED + PATCH_RADIUS)
    for j in range(HALF):
        sum_five(half_way, j * PADDED, 1, sums, j * HALF)


@njit(**FINITE_JIT)
def spread_squares(squares, across, down, spread):
    """Give each sample of a window what lies there between the squares: steps would show where nothing fits.

    A sample stands for `across` columns and `down` rows of pixels.
    """
    for j in range(WINDOW // down):
        row = j * down // 2
        near, far = row * HALF, min(max(row + 2 * (j % 2) - 1, 0), HALF - 1) * HALF
        if across == 1:
            spread_rows(squares, near, far, spread, j * WINDOW)
        elif down == 1:
            blend_rows(squares, near, far, spread, j * HALF)
        else:
            blend_rows(squares, near, near, spread, j * HALF)


@njit(**FINITE_JIT)
def add_window(weight, wide, values, first_y, last_y, first_x, last_x, left, band):
    """Add a window to a plane of a band.

    Parameters
    ----------
    weight, values : (size,) float32
    wide : int
        Of the window.
    first_y, last_y, first_x, last_x : int
        The part of it that lies within the frame.
    left : int
        Column of the plane where it begins.
    band : (rows, columns) float32
        In and out.
    """
    columns, flat = band.shape[1], band.reshape(band.size)
    for j in range(first_y, last_y):
        here, there = j * wide, j * columns + left
        if last_x - first_x < wide:
            for i in range(first_x, last_x):
                flat[there + i] += weight[here + i] * values[here + i]
        else:
            for i in range(0, wide, SQUARES):
                add_row(weight, here + i, values, here + i, flat, there + i)


@njit(**FINITE_JIT)
def smallest(values, room):
    """The least of a window's values, by halves: a compiler does not reorder comparisons, and one by one they wait."""
    size = QUADS // 2
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
    """Write rows of the frame, which no window adds to any more.

    Parameters
    ----------
    band : (C + 1 or more, rows, width) float32
        Weighted sums of the planes, and sums of the weights; the first to be divided.
    first, last, top : int
        Rows of the band to write, from `first` to before `last`, and the row of the frame where the band begins.
    white, half, lowest, highest : float32
        What 1 becomes, what is added before the fraction is cut off, and the range of the image's values.
    straight_alpha : bool
        Whether all other planes are to be divided by the last.
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
    """Write rows of the confidence, which no window adds to any more: weighted mean similarity to the eighth power.

    That is what it would be with a v of about a third: a few levels of difference are nothing to the weights, but
    something to the eye.
    """
    for j in range(first, last):
        for x in range(confidence.shape[1]):
            trust = min(similarities[j, x] / weights[j, x], np.float32(1))
            trust *= trust
            trust *= trust
            confidence[top + j, x] = trust * trust


@njit(**FINITE_JIT)
def move_up(band, rows):
    """The rows of a band below become its first ones, and those below zero."""
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
    """Make the in-between frame, row of nodes by row of nodes.

    Parameters
    ----------
    samples0, samples1 : Samples
        Of both frames, with at least SPARE columns beyond the right margin.
    chroma0, chroma1 : Samples
        Of planes that have one sample for two columns of pixels; none where all planes are full.
    down : int
        Rows of pixels for a row of these, 1 or 2.
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
    shape, inverse : (QUADS,) float32
        What `window_shape` and `patch_shares` give.
    white, half, lowest, highest, straight_alpha
        As for `finish_rows`.
    image : (C, height, width) out
    chroma : (0 or 2, rows of chroma, columns of chroma) out
    confidence : (height, width) float32 out
        Or without columns, where nobody asks.
    """
    channels, end, stride = samples0.planes.shape
    flat0, spline0, unit = samples0.planes.ravel(), samples0.coefficients.ravel(), samples0.unit
    flat1, spline1 = samples1.planes.ravel(), samples1.coefficients.ravel()
    _, height, width = image.shape
    rows_of_nodes, columns_of_nodes = count.shape
    # what the windows of a row of nodes add up to: the weighted mean of each plane, weights and weighted similarities
    told = 1 if confidence.shape[1] else 0
    band = np.zeros((channels + 1 + told, WINDOW, width), np.float32)
    one, margin = np.float32(1), np.float32(MARGIN)
    rows = np.empty((WINDOW + 3) * WINDOW, np.float32)
    room = Room(rows, np.empty(AREA, np.float32), np.empty(AREA, np.float32), np.empty(16, np.float32))
    distance, mixed = np.empty(AREA, np.float32), np.empty((channels, AREA), np.float32)
    apart, half_way = np.empty(QUADS, np.float32), np.zeros(HALF * PADDED, np.float32)
    padded = np.zeros((HALF + 2 * PATCH_RADIUS) * HALF, np.float32)
    similarity, weight = np.empty(QUADS, np.float32), np.empty(QUADS, np.float32)
    total, node_weights = np.empty((channels, AREA), np.float32), np.empty(QUADS, np.float32)
    node_similarities, most_similar = np.empty(QUADS, np.float32), np.empty(QUADS, np.float32)
    of_pixels, of_node = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    marks = np.empty((4, WINDOW), np.float32)
    # the same for chroma
    differences, end_of_chroma, stride_of_chroma = chroma0.planes.shape
    chroma_flat0, chroma_spline0 = chroma0.planes.ravel(), chroma0.coefficients.ravel()
    chroma_flat1, chroma_spline1 = chroma1.planes.ravel(), chroma1.coefficients.ravel()
    chroma_width = chroma.shape[2]
    # no constants, for which everything below would be compiled once more
    pixels, samples = marks.shape[1], marks.shape[1] // 2
    tall, has_alpha, cell = pixels // down, straight_alpha, pixels // 2
    chroma_area, by_row = tall * HALF, one / np.float32(down)
    chroma_band = np.zeros((differences + 1, tall, chroma_width), np.float32)
    chroma_distance = np.empty(chroma_area, np.float32)
    chroma_mixed = np.empty((differences, chroma_area), np.float32)
    chroma_total = np.empty((differences, chroma_area), np.float32)
    chroma_motion = np.empty(MOTION, np.float32)
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
                for j in range(HALF):
                    pool_row(distance, 2 * j * WINDOW, WINDOW, np.float32(0.25), apart, j * HALF)
                if differences:
                    # a sample lies as far from its place half a motion away whatever pixel it belongs to
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
                for i in range(QUADS):
                    apart[i] = decay(apart[i] * scale)
                sum_patches(apart, padded, half_way, similarity)
                for i in range(QUADS):
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
            # between neighbours, too, the more similar one counts more, but not so much that its border shows
            for i in range(QUADS):
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
        # the next row of nodes reaches over the lower half
        ready = CELL if row < rows_of_nodes - 1 else end_y
        if told:
            finish_confidence(band[channels], band[channels + 1], begin_y, ready, top, confidence)
        finish_rows(band, begin_y, ready, top, white, half, lowest, highest, has_alpha, image)
        move_up(band, cell)
        if differences:
            begin, ready = begin_y // down, (ready + down - 1) // down
            finish_rows(chroma_band, begin, ready, top // down, white, half, lowest, highest, has_alpha, chroma)
            move_up(chroma_band, cell // down)


def window_shape() -> np.ndarray:
    """How much each square of a window counts, (QUADS,) float32: from 0 at its border to 1, smooth at both ends.

    The windows that overlap at a square add up to 1.
    """
    way = 1 - np.abs(np.arange(HALF) + 0.5 - HALF / 2) / (HALF / 2)
    smooth = way * way * (3 - 2 * way)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


def patch_shares() -> np.ndarray:
    """One over what the squares of the patch around each one count that its window has, (QUADS,) float32."""
    length = np.convolve(np.ones(HALF), [END, 1, 1, 1, END], mode="same")
    return (1 / np.outer(length, length)).ravel().astype(np.float32)
