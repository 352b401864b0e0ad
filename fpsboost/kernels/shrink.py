"""Reduction of images by area averaging: every pixel is the mean over the area it covers, in a single pass."""

from __future__ import annotations

import math

import numpy as np

from fpsboost.kernels.jit import JIT, njit


@njit(cache=True, **JIT)
def shrink(rows, small):
    """Write the mean over the area of each pixel of a reduced image; partly covered pixels count in part.

    Parameters
    ----------
    rows : (H, W * C) uint8, uint16 or float32
        Rows of pixels.
    small : (h, w, C) float32 out
        With h and w at least 1 and at most H and W.
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
