"""Images as the padded component planes that the tile search compares, in one go."""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.levels import WHITE
from fpsboost.kernels.tiles import Index


@njit(forceinline=True, **FINITE_JIT)
def split_row(pixels, channels, normalise, scale, luma, first, third):
    """One row of `split_colours`; pixels is (W C,)."""
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
        first[x] = value * half * scale
        third[x] = chroma * scale


@njit(cache=True, **FINITE_JIT)
def split_colours(image, normalise, scale, padding, luma, planes):
    """Luma, and the first and third plane: half luma and mean chroma.

    Parameters
    ----------
    image : (H, W, C)
        Gray or BGR, multiplied by alpha where there is a second or a fourth channel.
    normalise : float32
        Factor that brings the image's white to 1.
    scale : float32
        Factor on the planes.
    padding : int
    luma : (H, W) float32 out
    planes : (3, H + 2 padding, W + 2 padding or more) float32 out
        Only the frame itself is written, and nothing of the second plane.
    """
    height, width, channels = image.shape
    rows = np.ascontiguousarray(image).reshape(height, width * channels)
    for y in range(height):
        first, third = planes[0, padding + y, padding:], planes[2, padding + y, padding:]
        if channels == 3:  # a constant for the compiler: pixels three values apart make vectors
            split_row(rows[y], 3, normalise, scale, luma[y], first, third)
        else:
            split_row(rows[y], channels, normalise, scale, luma[y], first, third)


@njit(cache=True, **FINITE_JIT)
def split_planes(y_plane, cb_plane, cr_plane, black, luma_unit, neutral, chroma_unit, scale, padding, luma, planes):
    """`split_colours` for an image in planes of luma and chroma.

    Parameters
    ----------
    y_plane : (H, W) uint8 or uint16
    cb_plane, cr_plane : (H, W), or half of it along x or along both
    black, luma_unit : float32
        Code value of black, and what one more adds, with 1 for white.
    neutral, chroma_unit : float32
        The same of gray's chroma.
    scale, padding, luma, planes
        As for `split_colours`.
    """
    height, width = y_plane.shape
    rows, columns = cb_plane.shape
    half, down, mean = np.float32(0.5), 1 if rows == height else 2, np.empty(columns, np.float32)
    for y in range(height):
        codes, to, first, third = (
            y_plane[y],
            luma[y],
            planes[0, padding + y, padding:],
            planes[2, padding + y, padding:],
        )
        for x in range(width):
            value = (np.float32(codes[x]) - black) * luma_unit
            to[x] = value
            first[x] = value * half * scale
        if y % down == 0:
            cb, cr = cb_plane[y // down], cr_plane[y // down]
            for x in range(columns):
                chroma = np.float32(cb[x]) + np.float32(cr[x])
                mean[x] = ((chroma * half - neutral) * chroma_unit + half) * scale
        if columns == width:
            for x in range(width):
                third[x] = mean[x]
        else:
            for x in range(Index(width // 2)):
                third[Index(2) * x] = mean[x]
                third[Index(2) * x + Index(1)] = mean[x]
            third[width - 1] = mean[columns - 1]


@njit(cache=True, **FINITE_JIT)
def finish_planes(luma, local_mean, scale, padding, planes):
    """The second plane, twice the luma less its local mean, and repeated edges on all three.

    Parameters
    ----------
    luma, local_mean : (H, W) float32
    scale, padding
        As for `split_colours`.
    planes : (3, H + 2 padding, W + 2 padding or more) float32
        In and out.
    """
    height, width = luma.shape
    twice = np.float32(2) * scale
    for row in range(height):
        y = row + padding
        for x in range(width):
            planes[1, y, padding + x] = twice * (luma[row, x] - local_mean[row, x])
        for c in range(3):
            for x in range(padding):
                planes[c, y, x] = planes[c, y, padding]
            for x in range(padding + width, planes.shape[2]):
                planes[c, y, x] = planes[c, y, padding + width - 1]
    for row in range(padding):
        below = row + padding + height
        for c in range(3):
            for x in range(planes.shape[2]):
                planes[c, row, x] = planes[c, padding, x]
                planes[c, below, x] = planes[c, padding + height - 1, x]


@njit(cache=True, **FINITE_JIT)
def quantise_planes(planes, inner, height, width, scale, shifts, outer, levels):
    """Planes in bytes, rounded and clipped, with repeated edges.

    Parameters
    ----------
    planes : (C, height + 2 inner, width + 2 inner or more) float32
    inner, height, width : int
        How far in the frame begins, and its size.
    scale : float32
        Levels of 1.
    shifts : (C,) float32
        Level of 0 in each plane.
    outer : int
        How far in the frame begins in the levels.
    levels : (C, height + 2 outer, width + 2 outer or more) uint8 out
    """
    count, rows, columns = levels.shape
    nothing, white = np.float32(0), np.float32(WHITE)
    for c, y in np.ndindex(count, height):
        values, row = planes[c, inner + y, inner:], levels[c, outer + y]
        frame, shift = row[outer:], shifts[c] + np.float32(0.5)
        for x in range(width):
            frame[x] = np.uint8(min(max(values[x] * scale + shift, nothing), white))
        first, last = frame[0], frame[width - 1]
        for x in range(outer):
            row[x] = first
        for x in range(outer + width, columns):
            row[x] = last
    for c, y in np.ndindex(count, rows - height):
        beyond, edge = (y, outer) if y < outer else (y + height, outer + height - 1)
        source, target = levels[c, edge], levels[c, beyond]
        for x in range(columns):
            target[x] = source[x]
