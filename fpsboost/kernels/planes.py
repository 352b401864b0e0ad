"""Planes in which the searches compare two frames: padded 8-bit components, and copies of a frame made smaller."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fpsboost.kernels.instruction import Index
from fpsboost.kernels.jit import FINITE_JIT, JIT, njit
from fpsboost.kernels.similarity import WHITE

CACHE_LINE = 64
"""Bytes; a vector that straddles two lines costs two accesses."""

HIGH_PASS_SIZE = 9
"""Side of the box whose mean luma is subtracted, pixels."""

SHARE = 1 / HIGH_PASS_SIZE**2
"""Weight of each pixel of the box."""

RADIUS = HIGH_PASS_SIZE // 2
KEPT_ROWS = HIGH_PASS_SIZE + 1
"""Rows of luma that a running sum over boxes needs: those of the box, and the one that leaves it."""


class PlanePair(NamedTuple):
    """Component planes of two frames of `height` x `width` pixels, with edges repeated over `padding` pixels."""

    planes0: NDArray[Any]
    """(3, H + 2 padding, W + 2 padding or more) uint8 or float32, both."""
    planes1: NDArray[Any]
    padding: int
    height: int
    width: int
    max_similarity: int | np.uint8
    """Similarity of two equal pixels: `truncation` or `UNIT` of `fpsboost.kernels.similarity`."""


class FlatPair(NamedTuple):
    """Planes of two frames as flat arrays, and the distances between planes and between rows."""

    flat0: NDArray[Any]
    flat1: NDArray[Any]
    plane: np.uint64
    stride: int


@njit(**FINITE_JIT)
def flatten(pair):
    """Return the planes of a pair as flat arrays."""
    planes0, planes1 = pair.planes0, pair.planes1
    _, rows, stride = planes0.shape
    return FlatPair(planes0.reshape(planes0.size), planes1.reshape(planes1.size), Index(rows * stride), stride)


@njit(**FINITE_JIT)
def opposite(pair):
    """Return the pair from frame 1 to frame 0."""
    return PlanePair(pair.planes1, pair.planes0, pair.padding, pair.height, pair.width, pair.max_similarity)


def aligned_empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array like `numpy.empty`, its last axis rounded up to whole cache lines and its first byte aligned."""
    itemsize = np.dtype(dtype).itemsize
    lanes = CACHE_LINE // itemsize
    rounded = (*shape[:-1], -(-shape[-1] // lanes) * lanes)
    raw = np.empty(math.prod(rounded) * itemsize + CACHE_LINE, np.uint8)
    return np.ndarray(rounded, dtype, raw, -raw.ctypes.data % CACHE_LINE)


class CodeLevels(NamedTuple):
    """Code values of black and of neutral chroma, and luma, where white is 1, and chroma per code value."""

    black: np.float32
    luma_unit: np.float32
    neutral: np.float32
    chroma_unit: np.float32


class Room(NamedTuple):
    """Work arrays. The high-pass filter follows the conversion by RADIUS rows."""

    rows: NDArray[Any]
    """Ring buffer of the latest rows of luma, (KEPT_ROWS, W) float32."""
    sums: NDArray[Any]
    """Sum of each column over the rows of the box, with RADIUS reflected columns on either side, (W + 2 RADIUS,)
    float64: sums of integer codes are exact."""
    chroma: NDArray[Any]
    """A row of the third plane at the resolution of chroma, (W,) uint8."""


@njit(**FINITE_JIT)
def as_level(value):
    """Return a value rounded and clipped to a byte."""
    return np.uint8(min(max(value + np.float32(0.5), np.float32(0)), np.float32(WHITE)))


@njit(**FINITE_JIT)
def reflected(place, size):
    """Return the index that stands for one beyond the ends of an axis, mirrored at the first and last element."""
    if size == 1:
        return 0
    while place < 0 or place >= size:
        place = -place if place < 0 else 2 * (size - 1) - place
    return place


@njit(**FINITE_JIT)
def write_high_pass(room, y, height, scale, middle, second):
    """Write row y of the second plane, twice the luma minus its local mean, once the room has all rows to y + RADIUS.

    Must be called in order. Differences have both signs: `scale` levels represent 1, and `middle` represents 0.
    """
    rows, sums = room.rows, room.sums
    width = rows.shape[1]
    if y == 0:
        sums[:] = 0
    else:
        leaves = rows[reflected(y - RADIUS - 1, height) % KEPT_ROWS]
        for x in range(width):
            sums[RADIUS + x] -= np.float64(leaves[x])
    for n in range(-RADIUS if y == 0 else RADIUS, RADIUS + 1):
        enters = rows[reflected(y + n, height) % KEPT_ROWS]
        for x in range(width):
            sums[RADIUS + x] += np.float64(enters[x])
    for n in range(1, RADIUS + 1):
        sums[RADIUS - n] = sums[RADIUS + reflected(-n, width)]
        sums[RADIUS + width - 1 + n] = sums[RADIUS + reflected(width - 1 + n, width)]
    luma, twice = rows[y % KEPT_ROWS], np.float32(2) * scale
    for x in range(width):
        total = sums[x]
        for n in range(1, HIGH_PASS_SIZE):
            total += sums[x + n]
        second[x] = as_level(twice * (luma[x] - np.float32(total * SHARE)) + middle)


@njit(**FINITE_JIT)
def repeat_edges(height, width, padding, planes):
    """Repeat the edges of the frame on all sides of the planes."""
    channels, _, columns = planes.shape
    for c in range(channels):
        for y in range(padding, padding + height):
            row = planes[c, y]
            first, last = row[padding], row[padding + width - 1]
            for x in range(padding):
                row[x] = first
            for x in range(padding + width, columns):
                row[x] = last
        above, below = planes[c, padding], planes[c, padding + height - 1]
        for y in range(padding):
            first, last = planes[c, y], planes[c, y + padding + height]
            for x in range(columns):
                first[x] = above[x]
                last[x] = below[x]


@njit(inline="always", **FINITE_JIT)
def split_row(pixels, channels, normalise, scale, luma, first, third):
    """Split one row for `split_colours`; `pixels` is (W C,)."""
    half, chroma_red, chroma_blue = np.float32(0.5), np.float32(0.713 / 2), np.float32(0.564 / 2)
    for x in range(Index(luma.size)):
        place = x * Index(channels)
        blue = np.float32(pixels[place]) * normalise
        alpha = np.float32(1)
        if channels in (2, 4):
            alpha = np.float32(pixels[place + Index(channels - 1)]) * normalise
        value, chroma = blue, np.float32(0)
        if channels >= 3:
            green = np.float32(pixels[place + Index(1)]) * normalise
            red = np.float32(pixels[place + Index(2)]) * normalise
            value = np.float32(0.299) * red + np.float32(0.587) * green + np.float32(0.114) * blue
            chroma = (chroma_red * (red - value) + chroma_blue * (blue - value)) * alpha + half
        value *= alpha
        luma[x] = value
        first[x] = as_level(value * half * scale)
        third[x] = as_level(chroma * scale)


@njit(cache=True, **FINITE_JIT)
def split_colours(image, normalise, scale, middle, padding, room, planes):
    """Write half the luma, twice its difference from the local mean, and mean chroma.

    - `image`: (H, W, C), gray or BGR; the planes are multiplied by alpha if there is a second or a fourth channel
    - `normalise`: factor that scales the image's white to 1
    - `scale`, `middle`: levels that represent a difference of 1, and the level of zero difference from the mean
    - `padding`: pixels on every side of the planes
    - `planes`: (3, H + 2 padding, W + 2 padding or more) uint8 out, with repeated edges
    """
    height, width, channels = image.shape
    rows = np.ascontiguousarray(image).reshape(height, width * channels)
    for y in range(height + RADIUS):
        if y < height:
            luma = room.rows[y % KEPT_ROWS]
            first, third = planes[0, padding + y, padding:], planes[2, padding + y, padding:]
            if channels == 3:  # a compile-time constant: pixels three values apart can be vectorised
                split_row(rows[y], 3, normalise, scale, luma, first, third)
            else:
                split_row(rows[y], channels, normalise, scale, luma, first, third)
        done = y - RADIUS
        if done >= 0:
            write_high_pass(room, done, height, scale, middle, planes[1, padding + done, padding:])
    repeat_edges(height, width, padding, planes)


@njit(cache=True, **FINITE_JIT)
def split_planes(y_plane, cb_plane, cr_plane, code_levels, scale, middle, padding, room, planes):
    """Do the same as `split_colours` for an image in planes of luma and chroma.

    Luma is (H, W) uint8 or uint16, chroma of the same shape or subsampled by 2 along x or along both axes.
    """
    black, luma_unit, neutral, chroma_unit = code_levels
    height, width = y_plane.shape
    rows, columns = cb_plane.shape
    half, down, mean = np.float32(0.5), 1 if rows == height else 2, room.chroma
    for y in range(height + RADIUS):
        if y < height:
            codes, to = y_plane[y], room.rows[y % KEPT_ROWS]
            first, third = planes[0, padding + y, padding:], planes[2, padding + y, padding:]
            for x in range(width):
                value = (np.float32(codes[x]) - black) * luma_unit
                to[x] = value
                first[x] = as_level(value * half * scale)
            if y % down == 0:
                cb, cr = cb_plane[y // down], cr_plane[y // down]
                for x in range(columns):
                    chroma = np.float32(cb[x]) + np.float32(cr[x])
                    mean[x] = as_level(((chroma * half - neutral) * chroma_unit + half) * scale)
            if columns == width:
                for x in range(width):
                    third[x] = mean[x]
            else:
                for x in range(Index(width // 2)):
                    third[Index(2) * x] = mean[x]
                    third[Index(2) * x + Index(1)] = mean[x]
                third[width - 1] = mean[columns - 1]
        done = y - RADIUS
        if done >= 0:
            write_high_pass(room, done, height, scale, middle, planes[1, padding + done, padding:])
    repeat_edges(height, width, padding, planes)


def make_room(width: int) -> Room:
    """Return the work arrays for images of some columns."""
    return Room(
        np.empty((KEPT_ROWS, width), np.float32), np.empty(width + 2 * RADIUS, np.float64), np.empty(width, np.uint8)
    )


@njit(cache=True, **JIT)
def shrink(rows, small):
    """Write the mean over the area of each pixel of a reduced image; partly covered pixels count in part.

    The image is (H, W * C) uint8, uint16 or float32, the reduced one (h, w, C) float32 with h from 1 to H and w from 1
    to W.
    """
    height, (down, across, channels) = rows.shape[0], small.shape
    width = rows.shape[1] // channels
    area = height / down * (width / across)
    line = np.empty(rows.shape[1], np.float32)
    for v in range(down):
        top, bottom = v * height / down, (v + 1) * height / down
        line[:] = 0
        for y in range(int(top), min(math.ceil(bottom), height)):
            share, row = np.float32(min(bottom, y + 1) - max(top, y)), rows[y]
            for x in range(line.size):
                line[x] += share * np.float32(row[x])
        for u in range(across):
            left, right = u * width / across, (u + 1) * width / across
            for c in range(channels):
                total = 0.0
                for x in range(int(left), min(math.ceil(right), width)):
                    total += (min(right, x + 1) - max(left, x)) * line[x * channels + c]
                small[v, u, c] = total / area
