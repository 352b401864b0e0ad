"""Samples of both frames along a candidate: where a window lies in either at time t, and what is seen there.

Each node of an in-between frame has a window, which overlaps those of its neighbours. A candidate is one motion for a
whole window, so that all its samples lie on a regular grid: both frames are read in rows, without looking up single
pixels. A window that is zoomed or turned is sampled in blocks, each of which moves as its centre does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import EIGHT, SIXTEEN, Index, fma
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.spline import MARGIN, filter_eight, filter_sixteen, spline_weights
from fpsboost.kernels.window_rows import PIXELS_PER_ROW, SplinePair, mix_eight, mix_sixteen

WINDOW = PIXELS_PER_ROW
"""Side of a window, pixels."""

AREA = WINDOW * WINDOW
"""Pixels of a window: an operation that is the same for all of them is one loop."""

BLOCK = EIGHT
"""Side of the blocks of a window that move as their centre does, pixels."""

MIN_GRADIENT, MAX_GRADIENT = np.float32(0.05), np.float32(0.5)
"""Minimum and maximum motion gradient of a window that is zoomed or rotated, pixels per pixel; the sum over both axes.

Below the minimum, its blocks would move by less than windows overlap anyway. A gradient above the maximum is not zoom
or rotation, by half or by 30 degrees from frame to frame, but the boundary of two motions.
"""


class Samples(NamedTuple):
    """Planes of an image, and their spline coefficients; see `fpsboost.kernels.spline`."""

    planes: NDArray[Any]
    """Values, (C, H, W) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """Coefficients of the values times `unit`, with repeated edges, (C, H + 2 MARGIN, W + 2 MARGIN or more) float32."""
    unit: np.float32


class FlatPlanes(NamedTuple):
    """Planes of an image in flat arrays, of `height` x `width` values and `rows` x `stride` coefficients each."""

    values: NDArray[Any]
    """(size,) uint8, uint16 or float32."""
    coefficients: NDArray[Any]
    """Spline coefficients of the values times `unit`, with repeated edges, (size,) float32."""
    unit: np.float32
    height: int
    width: int
    rows: int
    stride: int


class WindowPlace(NamedTuple):
    """Row and column of a window's first pixel in both frames at time t, the share of frame 1, in plane coordinates."""

    y0: np.float32
    x0: np.float32
    y1: np.float32
    x1: np.float32
    t: np.float32
    within: bool
    """Whether the whole window lies inside of both frames."""


class Room(NamedTuple):
    """Work arrays for sampling a window, float32."""

    rows: NDArray[Any]
    """Rows filtered horizontally, ((WINDOW + 3) * WINDOW,)."""
    first: NDArray[Any]
    """Window of frame 0, then of frame 1, (AREA,)."""
    second: NDArray[Any]
    taps: NDArray[Any]
    """Horizontal and vertical weights in frame 0, then in frame 1, (16,)."""
    marks: NDArray[Any]
    """1 for each column inside of frame 0, else 0, each row, and the same for frame 1, (4, WINDOW); written for windows
    that are partly outside."""


class Layer(NamedTuple):
    """Planes of one resolution: samples of both frames, work arrays for one window, and sums over windows.

    A sample stands for `across` columns and `down` rows of pixels, and a window has `wide` columns and `tall` rows of
    samples.
    """

    planes0: FlatPlanes
    planes1: FlatPlanes
    across: int
    down: int
    wide: int
    tall: int
    distance: NDArray[Any]
    """Squared differences of a candidate, summed over the planes, (tall * wide,) float32."""
    mixed: NDArray[Any]
    """Samples of a candidate, blended by time, (C, tall * wide) float32."""
    change: NDArray[Any]
    """Samples of frame 1 minus those of frame 0, likewise; 0 where either lies outside of its frame."""
    total: NDArray[Any]
    """Weighted sums of the samples over the candidates of a node, (C, tall * wide) float32."""
    band: NDArray[Any]
    """Sums over the windows of a row of nodes, (C + 1 or C + 2, tall, width) float32: weighted values of each plane,
    weights, and, for the confidence, weighted similarities."""


@njit(**FINITE_JIT)
def locate_window(top, left, motion, t, height, width, marks):
    """Return the `WindowPlace` of a window that begins at (top, left), and mark which samples lie inside of the frames.

    Positions are limited to the margin, beyond which the repeated edges do not change.
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
def mark_inside(start, size, marks):
    """Write 1 for the samples of a window that lie inside of a frame along one axis, else 0."""
    for i in range(WINDOW):
        place = start + np.float32(i)
        marks[i] = np.float32(1) if place >= 0 and place <= size - 1 else np.float32(0)


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
def is_rigid(motion):
    """Return whether a window moves as a whole."""
    gradient = abs(motion[4]) + abs(motion[5]) + abs(motion[6]) + abs(motion[7])
    return gradient < MIN_GRADIENT or gradient > MAX_GRADIENT


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


@njit(inline="always", **FINITE_JIT)
def sample_layer(layer, place, motion, room):
    """Sample a window of both frames along a motion, blend the samples by time, and sum their squared differences.

    Samples outside of their frame, as the marks of the place tell, have no weight unless both are outside.
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
def mix_rigid(layer, place, taps):
    """Do the same as `sample_layer` for a window that moves as a whole and lies inside of both frames."""
    stride = layer.planes0.stride
    pair = SplinePair(layer.planes0.coefficients, layer.planes1.coefficients, stride, taps)
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    place0 = set_taps(stride, place.y0, place.x0, 0, taps)
    place1 = set_taps(stride, place.y1, place.x1, 1, taps)
    for c in range(mixed.shape[0]):
        to = mixed[c]
        for i in range(0, wide, SIXTEEN):
            mix_sixteen(pair, place0 + i, place1 + i, tall, t, wide, to, layer.change[c], distance, i)
        place0 += layer.planes0.rows * stride
        place1 += layer.planes0.rows * stride


@njit(**FINITE_JIT)
def mix_blocks(layer, place, motion, taps):
    """Do the same as `sample_layer` for a zoomed or rotated window that lies inside of both frames."""
    rows, stride, size = layer.planes0.rows, layer.planes0.stride, layer.planes0.rows * layer.planes0.stride
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    y0, x0, y1, x1 = place.y0, place.x0, place.y1, place.x1
    pair = SplinePair(layer.planes0.coefficients, layer.planes1.coefficients, stride, taps)
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
                mix_eight(pair, place0, place1, BLOCK, t, wide, to, layer.change[c], distance, target)


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
    wide, tall, distance, mixed, t = layer.wide, layer.tall, layer.distance, layer.mixed, place.t
    filtered, first, second = room.rows, room.first, room.second
    for c in range(mixed.shape[0]):
        to, change = mixed[c], layer.change[c]
        fetch_window(layer.planes0, c, place.y0, place.x0, -t, motion, wide, tall, filtered, first)
        fetch_window(layer.planes1, c, place.y1, place.x1, np.float32(1) - t, motion, wide, tall, filtered, second)
        for i in range(Index(to.size)):
            difference = second[i] - first[i]
            distance[i] = fma(difference, difference, distance[i])
            to[i] = fma(t, difference, first[i])
            change[i] = difference
        if not place.within:
            mix_inside(t, room.marks, WINDOW // wide, WINDOW // tall, first, second, to, change)


@njit(**FINITE_JIT)
def mix_inside(t, marks, across, down, first, second, mixed, change):
    """Blend two windows that are partly outside; samples outside have no weight unless both are.

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
                if weight0 * weight1 == 0:
                    change[place] = 0


@njit(**FINITE_JIT)
def fetch_window(planes, number, y, x, share, motion, wide, tall, rows, out):
    """Sample a window of a plane; the motion at its centre places its first pixel at (y, x), in plane coordinates.

    The position is at least 1, and at least a window and 2 pixels from the ends; `share` is that of the motion from
    time t to this frame, negative against its direction. `rows` is a work array, ((tall + 3) * wide,) float32.
    """
    coefficients, plane_rows, stride = planes.coefficients, planes.rows, planes.stride
    begin = number * plane_rows * stride
    if not is_rigid(motion):
        filter_blocks(coefficients, begin, plane_rows, stride, y, x, share, motion, wide, tall, rows, out, 0)
    elif y == int(y) and x == int(x):
        copy_window(planes, number, int(y) - MARGIN, int(x) - MARGIN, wide, tall, out)
    else:
        filter_rigid(coefficients, begin, stride, y, x, wide, tall, rows, out, 0)


@njit(**FINITE_JIT)
def filter_blocks(coefficients, begin, plane_rows, stride, y, x, share, motion, wide, tall, rows, out, first):
    """Sample a window whose blocks move as their centres do; the plane begins at `begin`, the samples at `first`."""
    for down in range(0, tall, BLOCK):
        for across in range(0, wide, BLOCK):
            block = down, across, wide, tall
            place_y, place_x = locate_block(y, x, share, motion, block, plane_rows, stride)
            top, left = int(place_y), int(place_x)
            place, to = begin + (top - 1) * stride + left - 1, first + down * wide + across
            w0, w1, w2, w3 = spline_weights(place_x - np.float32(left))
            for j in range(BLOCK + 3):
                filter_eight(coefficients, place + j * stride, 1, w0, w1, w2, w3, rows, j * BLOCK)
            w0, w1, w2, w3 = spline_weights(place_y - np.float32(top))
            for j in range(BLOCK):
                filter_eight(rows, j * BLOCK, BLOCK, w0, w1, w2, w3, out, to + j * wide)


@njit(**FINITE_JIT)
def filter_rigid(coefficients, begin, stride, y, x, wide, tall, rows, out, first):
    """Sample a window that moves as a whole; the plane begins at `begin`, the samples at `first`."""
    top, left = int(y), int(x)  # never below 1
    fraction_y, fraction_x = y - np.float32(top), x - np.float32(left)
    w0, w1, w2, w3 = spline_weights(fraction_x)
    for j in range(tall + 3):
        place, to = begin + (top - 1 + j) * stride + left - 1, j * wide
        for i in range(0, wide, SIXTEEN):
            filter_sixteen(coefficients, place + i, 1, w0, w1, w2, w3, rows, to + i)
    w0, w1, w2, w3 = spline_weights(fraction_y)
    for i in range(0, tall * wide, SIXTEEN):
        filter_sixteen(rows, i, wide, w0, w1, w2, w3, out, first + i)


@njit(**FINITE_JIT)
def copy_window(planes, number, top, left, wide, tall, out):
    """Copy a window that begins at a pixel, which may lie outside of the frame: its edges are repeated."""
    values, unit, height, width = planes.values, planes.unit, planes.height, planes.width
    for j in range(tall):
        begin, to = (number * height + min(max(top + j, 0), height - 1)) * width, Index(j * wide)
        if left >= 0 and left + wide <= width:
            place = Index(begin + left)
            for i in range(Index(wide)):
                out[to + i] = np.float32(values[place + i]) * unit
        else:
            for i in range(wide):
                out[to + Index(i)] = np.float32(values[Index(begin + min(max(left + i, 0), width - 1))]) * unit


def make_layer(
    samples0: Samples, samples1: Samples, subsampling: tuple[int, int], band_planes: int, width: int
) -> Layer:
    """Return the layer of a frame's planes, of so many columns, with a band of so many planes."""
    down, across = subsampling
    channels, wide, tall = samples0.planes.shape[0], WINDOW // across, WINDOW // down
    return Layer(
        flat_planes(samples0),
        flat_planes(samples1),
        across,
        down,
        wide,
        tall,
        np.empty(tall * wide, np.float32),
        np.empty((channels, tall * wide), np.float32),
        np.empty((channels, tall * wide), np.float32),
        np.empty((channels, tall * wide), np.float32),
        np.zeros((band_planes, tall, width), np.float32),
    )


def flat_planes(samples: Samples) -> FlatPlanes:
    """Return an image's samples in flat arrays."""
    planes, coefficients, unit = samples
    return FlatPlanes(planes.ravel(), coefficients.ravel(), unit, *planes.shape[1:], *coefficients.shape[1:])
