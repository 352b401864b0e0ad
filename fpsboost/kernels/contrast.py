"""Conversion of images to the padded 8-bit component planes that the searches compare, in a single pass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.levels import WHITE
from fpsboost.kernels.tiles import Index


class CodeLevels(NamedTuple):
    """Meaning of the code values of luma and chroma."""

    black: np.float32
    """Code value of black."""
    luma_unit: np.float32
    """Luma per code value, where white is 1."""
    neutral: np.float32
    """Code value of neutral chroma."""
    chroma_unit: np.float32
    """Chroma per code value."""


@njit(inline="always", **FINITE_JIT)
def as_level(value):
    """Return a value rounded and clipped to a byte."""
    return np.uint8(min(max(value + np.float32(0.5), np.float32(0)), np.float32(WHITE)))


@njit(forceinline=True, **FINITE_JIT)
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
def split_colours(image, normalise, scale, padding, luma, planes):
    """Write the luma, and the first and third plane: half luma and mean chroma.

    Parameters
    ----------
    image : (H, W, C)
        Gray or BGR; the planes are multiplied by alpha if there is a second or a fourth channel.
    normalise : float32
        Factor that scales the image's white to 1.
    scale : float32
        Levels that represent a difference of 1.
    padding : int
        Pixels on every side of the planes.
    luma : (H, W) float32 out
    planes : (3, H + 2 padding, W + 2 padding or more) uint8 out
        Only the frame area of the first and third plane is written.
    """
    height, width, channels = image.shape
    rows = np.ascontiguousarray(image).reshape(height, width * channels)
    for y in range(height):
        first, third = planes[0, padding + y, padding:], planes[2, padding + y, padding:]
        if channels == 3:  # a compile-time constant: pixels three values apart can be vectorised
            split_row(rows[y], 3, normalise, scale, luma[y], first, third)
        else:
            split_row(rows[y], channels, normalise, scale, luma[y], first, third)


@njit(cache=True, **FINITE_JIT)
def split_planes(y_plane, cb_plane, cr_plane, code_levels, scale, padding, luma, planes):
    """Do the same as `split_colours` for an image in planes of luma and chroma.

    Parameters
    ----------
    y_plane : (H, W) uint8 or uint16
    cb_plane, cr_plane : (H, W), or subsampled by 2 along x or along both axes
    code_levels : CodeLevels
    scale, padding, luma, planes
        As for `split_colours`.
    """
    black, luma_unit, neutral, chroma_unit = code_levels
    height, width = y_plane.shape
    rows, columns = cb_plane.shape
    half, down, mean = np.float32(0.5), 1 if rows == height else 2, np.empty(columns, np.uint8)
    for y in range(height):
        codes, to = y_plane[y], luma[y]
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


@njit(cache=True, **FINITE_JIT)
def finish_planes(luma, local_mean, scale, middle, padding, planes):
    """Write the second plane, twice the luma minus its local mean, and repeat the edges of all three planes.

    Parameters
    ----------
    luma, local_mean : (H, W) float32
    scale, middle : float32
        Levels that represent a difference of 1, and the level of zero difference: differences have both signs.
    padding : int
    planes : (3, H + 2 padding, W + 2 padding or more) uint8
        Updated in place.
    """
    height, width = luma.shape
    columns, twice = planes.shape[2], np.float32(2) * scale
    for y in range(height):
        here, mean_row, second = luma[y], local_mean[y], planes[1, padding + y, padding:]
        for x in range(width):
            second[x] = as_level(twice * (here[x] - mean_row[x]) + middle)
        for c in range(3):
            row = planes[c, padding + y]
            first, last = row[padding], row[padding + width - 1]
            for x in range(padding):
                row[x] = first
            for x in range(padding + width, columns):
                row[x] = last
    for c in range(3):
        above, below = planes[c, padding], planes[c, padding + height - 1]
        for y in range(padding):
            first, last = planes[c, y], planes[c, y + padding + height]
            for x in range(columns):
                first[x] = above[x]
                last[x] = below[x]
