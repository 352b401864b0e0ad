"""In-between frame as a weighted mean of both frames along every candidate motion.

Each node has a window, which overlaps those of its neighbours. A candidate is one motion for a whole window, so that
all its samples lie on a regular grid: both frames are read in rows, without looking up single pixels. At every pixel,
the candidates are weighted by the report's patch similarity of the two samples at time t: non-local means over motions
instead of pixels. Windows are faded into each other, so that no borders are visible (overlapped block motion
compensation, Orchard and Sullivan 1994, doi:10.1109/83.334974).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import VALUES_PER_MOTION, Candidates
from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import BORROWING, FINITE_JIT, LANES, njit
from fpsboost.kernels.lanes import EIGHT, filter_eight, filter_sixteen
from fpsboost.kernels.levels import SIXTEEN
from fpsboost.kernels.spline import MARGIN, spline_weights
from fpsboost.kernels.tiles import Index
from fpsboost.kernels.window_rows import (
    END_WEIGHT,
    PIXELS_PER_ROW,
    SQUARES_PER_ROW,
    add_row,
    blend_rows,
    mix_eight,
    mix_sixteen,
    pool_row,
    sum_five,
    upsample_rows,
)


class Samples(NamedTuple):
    """Planes of an image, and their spline coefficients; see `fpsboost.kernels.spline`."""

    planes: NDArray[Any]
    """Values, (C, H, W) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """Coefficients of the values times `unit`, with repeated edges, (C, H + 2 MARGIN, W + 2 MARGIN or more) float32."""
    unit: np.float32


class SampledImage(NamedTuple):
    """Image as `blend_hypotheses` reads it; its coefficients have at least SPARE columns beyond the right margin."""

    full: Samples
    """Planes at full resolution."""
    further: Samples
    """Planes that are sampled along, if any: subsampled chroma, with one sample for two columns of pixels, whose
    differences weigh like those of the full planes; or layers of full resolution, which have no say in the weights."""


class Plane(NamedTuple):
    """Plane of an image, in flat arrays that hold all its planes."""

    values: NDArray[Any]
    """(size,) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """Spline coefficients of the values times `unit`, with repeated edges, (size,) float32."""
    unit: np.float32
    number: int
    """Number of the plane, from 0."""
    height: int
    """Rows of values."""
    width: int
    """Columns of values."""
    rows: int
    """Rows of coefficients."""
    stride: int
    """Columns of coefficients."""


class WindowPlace(NamedTuple):
    """Position of a window in both frames at time t."""

    y0: np.float32
    """Row of the first pixel in frame 0, in plane coordinates."""
    x0: np.float32
    y1: np.float32
    """Row of the first pixel in frame 1."""
    x1: np.float32
    t: np.float32
    """Time, 0 to 1: the share of frame 1."""
    within: bool
    """Whether the whole window lies inside of both frames."""


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
    marks: NDArray[Any]
    """(4, WINDOW) float32, written for windows that are partly outside: 1 for each column inside of frame 0, else 0,
    each row, and the same for frame 1."""


class Weighting(NamedTuple):
    """How the candidates of a node are weighted."""

    scale: np.float32
    """Factor on squared colour differences."""
    sharpness: np.float32
    """Rate at which a candidate's weight decays as its similarity falls."""
    sufficient_similarity: np.float32
    """Similarity at which, once every pixel of a window has it, the candidates with fewer votes are skipped."""
    min_vote_share: np.float32
    """Remaining candidates are also skipped once the votes of the next one are below this share of the least
    accumulated weight of any pixel."""
    window_shape: NDArray[Any]
    """(SQUARES_PER_WINDOW,) float32; see `window_shape`."""
    patch_shares: NDArray[Any]
    """(SQUARES_PER_WINDOW,) float32; see `patch_shares`."""


class ValueRange(NamedTuple):
    """Values of an image."""

    white: np.float32
    """Factor on the blended values."""
    rounding_offset: np.float32
    """Added before truncation."""
    lowest: np.float32
    highest: np.float32
    straight_alpha: bool
    """Whether to divide all other planes by the last one."""


class Blended(NamedTuple):
    """Generated frame."""

    image: NDArray[Any]
    """Planes at full resolution, (C, height, width)."""
    further: NDArray[Any]
    """Planes that are sampled along, (any number, rows, columns)."""
    confidence: NDArray[Any]
    """(height, width) float32; has no columns if the confidence is not requested."""


class Layer(NamedTuple):
    """Planes of one resolution: samples of both frames, work arrays for one window, and sums over windows."""

    plane0: Plane
    """First plane of frame 0."""
    plane1: Plane
    """First plane of frame 1."""
    across: int
    """Columns of pixels per sample."""
    down: int
    """Rows of pixels per sample."""
    wide: int
    """Columns of samples in a window."""
    tall: int
    """Rows of samples in a window."""
    distance: NDArray[Any]
    """Squared differences of a candidate, summed over the planes, (tall * wide,) float32."""
    mixed: NDArray[Any]
    """Samples of a candidate, blended by time, (C, tall * wide) float32."""
    total: NDArray[Any]
    """Weighted sums of the samples over the candidates of a node, (C, tall * wide) float32."""
    band: NDArray[Any]
    """Sums over the windows of a row of nodes, (C + 1 or C + 2, tall, width) float32: weighted values of each plane,
    weights, and, for the confidence, weighted similarities."""


class Window(NamedTuple):
    """Window of a node."""

    top: int
    """First row, may be outside of the frame."""
    left: int
    """First column."""
    height: int
    """Rows of the frame."""
    width: int
    """Columns of the frame."""


class NodeSums(NamedTuple):
    """Sums over the candidates of a node, each (SQUARES_PER_WINDOW,) float32."""

    weights: NDArray[Any]
    similarities: NDArray[Any]
    """Weighted sum."""
    most_similar: NDArray[Any]
    """Largest similarity of any candidate."""


class Work(NamedTuple):
    """Work arrays for a node; those without a shape are (SQUARES_PER_WINDOW,) float32."""

    room: Room
    squared: NDArray[Any]
    """Squared difference of each square along a candidate."""
    padded: NDArray[Any]
    half_way: NDArray[Any]
    """Both for `sum_patches`."""
    similarity: NDArray[Any]
    """Sum of the similarities in the patch around each square."""
    weight: NDArray[Any]
    """Weight of a candidate, or of the window."""
    upsampled: NDArray[Any]
    """Weight of each sample of a window, (AREA,) float32."""
    values: NDArray[Any]
    """Sums of each sample of a window, (AREA,) float32."""
    further_motion: NDArray[Any]
    """(VALUES_PER_MOTION,) float32."""


WINDOW = PIXELS_PER_ROW
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
"""Columns of coefficients that are needed beyond the right margin."""

CONFIDENCE_POWER = 8
"""Power of the similarity that is the confidence; see `finish_confidence`."""

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
    """Return the position of a window in both frames at time t, a `WindowPlace`.

    Positions are limited to the margin, beyond which the repeated edges do not change.

    Parameters
    ----------
    top, left : int
        First pixel of the window.
    motion : (VALUES_PER_MOTION,) float32
    t : float32
    height, width : int
        Size of the frames.
    marks : (4, WINDOW) float32 out
        See `Room`.
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
    return WindowPlace(y0, x0, y1, x1, t, within)


@njit(**FINITE_JIT)
def copy_window(plane, top, left, wide, tall, out):
    """Copy a window that begins at a pixel, which may lie outside of the frame: its edges are repeated."""
    values, unit, height, width = plane.values, plane.unit, plane.height, plane.width
    for j in range(tall):
        begin, to = (plane.number * height + min(max(top + j, 0), height - 1)) * width, Index(j * wide)
        if left >= 0 and left + wide <= width:
            place = Index(begin + left)
            for i in range(Index(wide)):
                out[to + i] = np.float32(values[place + i]) * unit
        else:
            for i in range(wide):
                out[to + Index(i)] = np.float32(values[Index(begin + min(max(left + i, 0), width - 1))]) * unit


@njit(**FINITE_JIT)
def fetch_rigid(plane, y, x, wide, tall, rows, out):
    """Sample a window that moves as a whole; integer positions are copied. See `fetch_window`."""
    top, left = int(y), int(x)  # never below 1
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    if fraction_y == 0 and fraction_x == 0:
        copy_window(plane, top - MARGIN, left - MARGIN, wide, tall, out)
        return
    coefficients, stride = plane.coefficients, plane.stride
    begin = plane.number * plane.rows * stride
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(tall + 3):
        place, to = begin + (top - 1 + j) * stride + left - 1, j * wide
        for i in range(0, wide, SIXTEEN):
            filter_sixteen(coefficients, place + i, 1, w0, w1, w2, w3, rows, to + i)
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for i in range(0, tall * wide, SIXTEEN):
        filter_sixteen(rows, i, wide, w0, w1, w2, w3, out, i)


@njit(**FINITE_JIT)
def locate_block(y, x, share, motion, block, rows, stride):
    """Return the position of a block of a zoomed or rotated window; a block moves as its centre does.

    `block` is its first row and column in the window, and the columns and rows of the window.
    """
    down, across, wide, tall = block
    one, last_y, last_x = np.float32(1), np.float32(rows - BLOCK - 3), np.float32(stride - BLOCK - 3)
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
def fetch_window(plane, y, x, share, motion, wide, tall, rows, out):
    """Sample a window whose motion at the centre places its first pixel at (y, x), in plane coordinates.

    Parameters
    ----------
    plane : Plane
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
        fetch_rigid(plane, y, x, wide, tall, rows, out)
        return
    coefficients, plane_rows, stride = plane.coefficients, plane.rows, plane.stride
    begin = plane.number * plane_rows * stride
    for down in range(0, tall, BLOCK):
        for across in range(0, wide, BLOCK):
            block = down, across, wide, tall
            place_y, place_x = locate_block(y, x, share, motion, block, plane_rows, stride)
            top, left = int(place_y), int(place_x)
            place, to = begin + (top - 1) * stride + left - 1, down * wide + across
            w0, w1, w2, w3 = spline_weights(place_x - np.float32(left))
            for j in range(BLOCK + 3):
                filter_eight(coefficients, place + j * stride, 1, w0, w1, w2, w3, rows, j * BLOCK)
            w0, w1, w2, w3 = spline_weights(place_y - np.float32(top))
            for j in range(BLOCK):
                filter_eight(rows, j * BLOCK, BLOCK, w0, w1, w2, w3, out, to + j * wide)


@njit(**FINITE_JIT)
def set_taps(stride, y, x, number, taps):
    """Write the weights of a position in one of two frames; return the index of its first coefficient."""
    top, left = int(y), int(x)
    for k, fraction in enumerate((x - np.float32(left), y - np.float32(top))):
        w0, w1, w2, w3 = spline_weights(fraction)
        at = 8 * number + 4 * k
        taps[at], taps[at + 1], taps[at + 2], taps[at + 3] = w0, w1, w2, w3
    return (top - 1) * stride + left - 1


@njit(**FINITE_JIT)
def mix_fetched(layer, place, motion, room):
    """Do the same as `sample_layer` for any window, in several passes."""
    values0, coefficients0, unit, _, height, width, rows, stride = layer.plane0
    values1, coefficients1 = layer.plane1.values, layer.plane1.coefficients
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    filtered, first, second = room.rows, room.first, room.second
    for c in range(mixed.shape[0]):
        to = mixed[c]
        plane = Plane(values0, coefficients0, unit, c, height, width, rows, stride)
        fetch_window(plane, place.y0, place.x0, -t, motion, wide, tall, filtered, first)
        plane = Plane(values1, coefficients1, unit, c, height, width, rows, stride)
        fetch_window(plane, place.y1, place.x1, np.float32(1) - t, motion, wide, tall, filtered, second)
        for i in range(Index(to.size)):
            difference = second[i] - first[i]
            distance[i] = fma(difference, difference, distance[i])
            to[i] = fma(t, difference, first[i])
        if not place.within:
            mix_inside(t, room.marks, WINDOW // wide, WINDOW // tall, first, second, to)


@njit(**FINITE_JIT)
def mix_rigid(layer, place, taps):
    """Do the same as `sample_layer` for a window that moves as a whole and lies inside of both frames."""
    coefficients0, coefficients1, stride = layer.plane0.coefficients, layer.plane1.coefficients, layer.plane0.stride
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    place0 = set_taps(stride, place.y0, place.x0, 0, taps)
    place1 = set_taps(stride, place.y1, place.x1, 1, taps)
    for c in range(mixed.shape[0]):
        to = mixed[c]
        for i in range(0, wide, SIXTEEN):
            mix_sixteen(
                coefficients0, place0 + i, coefficients1, place1 + i, stride, tall, taps, t, wide, to, distance, i
            )
        place0 += layer.plane0.rows * stride
        place1 += layer.plane0.rows * stride


@njit(**FINITE_JIT)
def mix_blocks(layer, place, motion, taps):
    """Do the same as `sample_layer` for a zoomed or rotated window that lies inside of both frames."""
    coefficients0, coefficients1 = layer.plane0.coefficients, layer.plane1.coefficients
    rows, stride, size = layer.plane0.rows, layer.plane0.stride, layer.plane0.rows * layer.plane0.stride
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    y0, x0, y1, x1 = place.y0, place.x0, place.y1, place.x1
    for c in range(mixed.shape[0]):
        to, begin = mixed[c], c * size
        for down in range(0, tall, BLOCK):
            for across in range(0, wide, BLOCK):
                block = down, across, wide, tall
                v0, u0 = locate_block(y0, x0, -t, motion, block, rows, stride)
                v1, u1 = locate_block(y1, x1, np.float32(1) - t, motion, block, rows, stride)
                place0 = begin + set_taps(stride, v0, u0, 0, taps)
                place1 = begin + set_taps(stride, v1, u1, 1, taps)
                target = down * wide + across
                mix_eight(
                    coefficients0, place0, coefficients1, place1, stride, BLOCK, taps, t, wide, to, distance, target
                )


@njit(inline="always", **FINITE_JIT)
def sample_layer(layer, place, motion, room):
    """Sample a window of both frames along a motion, blend the samples by time, and sum their squared differences.

    Parameters
    ----------
    layer : Layer
        Its work arrays for a candidate are written.
    place : WindowPlace
    motion : (VALUES_PER_MOTION,) float32
    room : Room
        Its marks are those of the place: samples outside of their frame have no weight unless both are outside.
    """
    rigid, y0, x0, y1, x1 = is_rigid(motion), place.y0, place.x0, place.y1, place.x1
    is_whole = (y0 == int(y0) and x0 == int(x0)) or (y1 == int(y1) and x1 == int(x1))
    layer.distance[:] = 0
    if not place.within or (rigid and is_whole):
        mix_fetched(layer, place, motion, room)
    elif rigid:
        mix_rigid(layer, place, room.taps)
    else:
        mix_blocks(layer, place, motion, room.taps)


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
def upsample_squares(squares, across, down, upsampled):
    """Interpolate the values of the squares at each sample of a window.

    Without interpolation, steps would be visible where no candidate fits.

    A sample stands for `across` columns and `down` rows of pixels.
    """
    for j in range(WINDOW // down):
        row = j * down // 2
        near, far = row * SQUARES_PER_ROW, min(max(row + 2 * (j % 2) - 1, 0), SQUARES_PER_ROW - 1) * SQUARES_PER_ROW
        if across == 1:
            upsample_rows(squares, near, far, upsampled, j * WINDOW)
        elif down == 1:
            blend_rows(squares, near, far, upsampled, j * SQUARES_PER_ROW)
        else:
            blend_rows(squares, near, near, upsampled, j * SQUARES_PER_ROW)


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
def finish_rows(band, first, last, top, value_range, image):
    """Normalise and write rows of the frame that no further window contributes to.

    Parameters
    ----------
    band : (C + 1 or more, rows, width) float32
        Weighted sums of the planes, and sums of the weights; the weighted sums are divided in place.
    first, last, top : int
        Rows of the band to write, from `first` to before `last`, and the row of the frame at which the band begins.
    value_range : ValueRange
    image : (C, height, width) out
    """
    white, offset, lowest, highest, straight_alpha = value_range
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
                value = min(max(value * white + offset, lowest), highest)
                to[x] = image.dtype.type(value)


@njit(**FINITE_JIT)
def finish_confidence(weights, similarities, first, last, top, confidence):
    """Write rows of the confidence that no further window contributes to: mean similarity to the eighth power.

    The mean is weighted. The power corresponds to a bandwidth of about a third: a few levels of difference hardly
    change the weights, but are visible.
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


@njit(inline="always", **FINITE_JIT)
def locate_further(place, motion, down, across, scaled):
    """Return the position of a window in further planes, and write its motion in their samples.

    The chroma siting has no influence on displacements.
    """
    margin, by_row, by_column = np.float32(MARGIN), np.float32(1) / np.float32(down), np.float32(1) / np.float32(across)
    y0, y1 = (place.y0 - margin) * by_row + margin, (place.y1 - margin) * by_row + margin
    x0, x1 = (place.x0 - margin) * by_column + margin, (place.x1 - margin) * by_column + margin
    scaled[4], scaled[7] = motion[4], motion[7]
    scaled[5], scaled[6] = motion[5] * by_row * across, motion[6] * down * by_column
    return WindowPlace(y0, x0, y1, x1, place.t, place.within)


@njit(**FINITE_JIT)
def weigh_squares(prior, sharpness, similarity, patch_shares, weight, sums):
    """Compute the weights of a candidate from the similarities in its patches, and add them to the sums of the node."""
    weights, similarities, most_similar = sums
    for i in range(SQUARES_PER_WINDOW):
        alike = similarity[i] * patch_shares[i]
        w = prior * decay(sharpness * (np.float32(1) - alike))
        weight[i] = w
        weights[i] += w
        similarities[i] = fma(w, alike, similarities[i])
        most_similar[i] = max(most_similar[i], alike)


@njit(**FINITE_JIT)
def add_samples(mixed, weight, across, down, upsampled, total):
    """Add the samples of a candidate, times their weights, to the sums of the node."""
    upsample_squares(weight, across, down, upsampled)
    for c in range(Index(mixed.shape[0])):
        for i in range(Index(upsampled.size // (across * down))):
            total[c, i] = fma(upsampled[i], mixed[c, i], total[c, i])


@njit(inline="always", **FINITE_JIT)
def sum_candidates(full, further, window, t, motions, priors, weighting, work, sums):
    """Sum the samples of a window over the candidates of its node.

    Parameters
    ----------
    full, further : Layer
    window : Window
    t : float32
    motions : (candidates, VALUES_PER_MOTION) float32
    priors : (candidates,) float32
        Weights of the candidates by their votes; see `fpsboost.kernels.candidates`.
    weighting : Weighting
    work : Work
    sums : NodeSums
    """
    room, squared, padded, half_way, similarity, weight, upsampled, _, further_motion = work
    top, left, height, width = window
    distance, mixed, total, further_mixed, further_total = (
        full.distance,
        full.mixed,
        full.total,
        further.mixed,
        further.total,
    )
    weights, similarities, most_similar = sums
    marks, patch_shares = room.marks, weighting.patch_shares
    total[:] = 0
    further_total[:] = 0
    weights[:] = MIN_WEIGHT_SUM
    similarities[:] = 0
    most_similar[:] = 0
    least_weight, least_similar = np.float32(0), np.float32(0)
    for k in range(priors.size):
        prior = priors[k]
        if prior <= 0:
            continue
        if prior < weighting.min_vote_share * least_weight or least_similar >= weighting.sufficient_similarity:
            break
        motion = motions[k]
        place = locate_window(top, left, motion, t, height, width, marks)
        sample_layer(full, place, motion, room)
        squared[:] = 0
        for j in range(SQUARES_PER_ROW):
            pool_row(distance, 2 * j * WINDOW, WINDOW, np.float32(0.25), squared, j * SQUARES_PER_ROW)
        if further_mixed.shape[0]:
            there = locate_further(place, motion, further.down, further.across, further_motion)
            sample_layer(further, there, further_motion, room)
            if further.across > 1:
                pool_chroma(further.distance, further.down, squared)
        for i in range(SQUARES_PER_WINDOW):
            squared[i] = decay(squared[i] * weighting.scale)
        sum_patches(squared, padded, half_way, similarity)
        weigh_squares(prior, weighting.sharpness, similarity, patch_shares, weight, sums)
        least_weight, least_similar = smallest(weights, squared), smallest(most_similar, squared)
        add_samples(mixed, weight, full.across, full.down, upsampled, total)
        if further_mixed.shape[0]:
            add_samples(further_mixed, weight, further.across, further.down, upsampled, further_total)


@njit(**FINITE_JIT)
def weigh_window(shape, sums, weight):
    """Compute the weight of a node's window: larger where it is more similar than neighbouring windows.

    It is not so much larger that the border of the window would be visible.
    """
    for i in range(SQUARES_PER_WINDOW):
        weight[i] = shape[i] / math.sqrt(sums[i])


@njit(**FINITE_JIT)
def add_node(layer, window, weight, sums, upsampled, values):
    """Add the mean of a node's window to the band of a layer, and the sums of its weights and similarities."""
    channels, across, down = layer.mixed.shape[0], layer.across, layer.down
    if channels == 0:
        return
    first_y, last_y = max(-window.top, 0) // down, (min(window.height - window.top, WINDOW) + down - 1) // down
    first_x, last_x = max(-window.left, 0) // across, (min(window.width - window.left, WINDOW) + across - 1) // across
    left = window.left // across
    upsample_squares(weight, across, down, upsampled)
    for c in range(channels):
        add_window(upsampled, layer.wide, layer.total[c], first_y, last_y, first_x, last_x, left, layer.band[c])
    upsample_squares(sums.weights, across, down, values)
    add_window(upsampled, layer.wide, values, first_y, last_y, first_x, last_x, left, layer.band[channels])
    if layer.band.shape[0] > channels + 1:
        upsample_squares(sums.similarities, across, down, values)
        add_window(upsampled, layer.wide, values, first_y, last_y, first_x, last_x, left, layer.band[channels + 1])


@njit(**FINITE_JIT)
def finish_layer(layer, first, last, top, rows, value_range, image):
    """Write rows of pixels of a layer that no further window contributes to, and shift its band up by `rows`."""
    down = layer.down
    finish_rows(layer.band, first // down, (last + down - 1) // down, top // down, value_range, image)
    shift_rows_up(layer.band, rows // down)


@njit(cache=True, **FINITE_JIT, **BORROWING)
def blend_nodes(full, further, t, candidates, weighting, value_range, work, sums, blended):
    """Write the in-between frame, one row of nodes at a time; see `blend_hypotheses`.

    Parameters
    ----------
    full, further : Layer
    t, candidates, weighting, value_range, blended
        See `blend_hypotheses`.
    work : Work
    sums : NodeSums
    """
    (channels, height, width), (rows, columns) = blended.image.shape, candidates.listed.shape
    has_confidence, further_planes = blended.confidence.shape[1] > 0, blended.further.shape[0]
    spacing, before = candidates.spacing, (WINDOW - candidates.spacing) // 2
    for row in range(rows):
        top = row * spacing - before
        for column in range(columns):
            window = Window(top, column * spacing - before, height, width)
            count = candidates.listed[row, column]
            motions, priors = candidates.motions[row, column, :count], candidates.weights[row, column, :count]
            sum_candidates(full, further, window, t, motions, priors, weighting, work, sums)
            weigh_window(weighting.window_shape, sums.weights, work.weight)
            add_node(full, window, work.weight, sums, work.upsampled, work.values)
            add_node(further, window, work.weight, sums, work.upsampled, work.values)
        # the windows of the next row of nodes overlap the rows below
        first, last = max(-top, 0), spacing if row < rows - 1 else min(height - top, WINDOW)
        if has_confidence:
            finish_confidence(full.band[channels], full.band[channels + 1], first, last, top, blended.confidence)
        finish_layer(full, first, last, top, spacing, value_range, blended.image)
        if further_planes:
            finish_layer(further, first, last, top, spacing, value_range, blended.further)


def blend_hypotheses(
    frame0: SampledImage,
    frame1: SampledImage,
    subsampling: tuple[int, int],
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    value_range: ValueRange,
    blended: Blended,
) -> None:
    """Write the in-between frame.

    Parameters
    ----------
    frame0, frame1 : SampledImage
    subsampling : (int, int)
        Rows and columns of pixels per sample of the further planes: (1, 1) for layers, (1 or 2, 2) for chroma.
    t : float32
    candidates : fpsboost.kernels.candidates.Candidates
    weighting : Weighting
    value_range : ValueRange
    blended : Blended
        Written.
    """
    (channels, _, width), has_confidence = blended.image.shape, blended.confidence.shape[1] > 0
    full = make_layer(frame0.full, frame1.full, (1, 1), channels + 1 + has_confidence, width)
    further_channels, _, further_width = blended.further.shape
    further = make_layer(frame0.further, frame1.further, subsampling, further_channels + 1, further_width)
    blend_nodes(full, further, t, candidates, weighting, value_range, make_work(), make_sums(), blended)


def make_layer(
    samples0: Samples, samples1: Samples, subsampling: tuple[int, int], band_planes: int, width: int
) -> Layer:
    """Return the layer of a frame's planes, of so many columns, with a band of so many planes."""
    down, across = subsampling
    channels, wide, tall = samples0.planes.shape[0], WINDOW // across, WINDOW // down
    return Layer(
        first_plane(samples0),
        first_plane(samples1),
        across,
        down,
        wide,
        tall,
        np.empty(tall * wide, np.float32),
        np.empty((channels, tall * wide), np.float32),
        np.empty((channels, tall * wide), np.float32),
        np.zeros((band_planes, tall, width), np.float32),
    )


def first_plane(samples: Samples) -> Plane:
    """Return the first plane of an image's samples."""
    planes, coefficients, unit = samples
    return Plane(planes.ravel(), coefficients.ravel(), unit, 0, *planes.shape[1:], *coefficients.shape[1:])


def make_work() -> Work:
    """Return the work arrays for a node."""
    room = Room(*(np.empty(size, np.float32) for size in ((WINDOW + 3) * WINDOW, AREA, AREA, 16, (4, WINDOW))))
    return Work(
        room,
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.zeros((SQUARES_PER_ROW + 2 * PATCH_RADIUS) * SQUARES_PER_ROW, np.float32),
        np.zeros(SQUARES_PER_ROW * PADDED, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.empty(AREA, np.float32),
        np.empty(AREA, np.float32),
        np.empty(VALUES_PER_MOTION, np.float32),
    )


def make_sums() -> NodeSums:
    """Return the sums over the candidates of a node."""
    return NodeSums(*(np.empty(SQUARES_PER_WINDOW, np.float32) for _ in range(3)))


@cache
def window_shape(spacing: int) -> np.ndarray:
    """Return the weight of each square of a window: from 0 at its border to 1 where no other window overlaps it.

    The weight is smooth at both ends, and the weights of the windows that overlap at a square add up to 1.
    Where fewer squares overlap, it rises more slowly at first, so that the first one is no visible step.

    Parameters
    ----------
    spacing : int
        Distance between nodes, pixels.

    Returns
    -------
    (SQUARES_PER_WINDOW,) float32
    """
    from_border = SQUARES_PER_ROW / 2 - np.abs(np.arange(SQUARES_PER_ROW) + 0.5 - SQUARES_PER_ROW / 2)
    way = np.minimum(from_border * 2 / (WINDOW - spacing), 1)
    smooth = way**2 * (3 - 2 * way) if spacing <= WINDOW // 2 else way**3 * (10 - 15 * way + 6 * way**2)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


@cache
def patch_shares() -> np.ndarray:
    """Return 1 over the total weight of the squares of each patch that lie within its window.

    Returns
    -------
    (SQUARES_PER_WINDOW,) float32
    """
    length = np.convolve(np.ones(SQUARES_PER_ROW), [END_WEIGHT, 1, 1, 1, END_WEIGHT], mode="same")
    return (1 / np.outer(length, length)).ravel().astype(np.float32)
