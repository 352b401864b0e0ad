"""What stands still in front of a moving picture: titles, logos, the car that a camera follows."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import JIT

STAYS, STANDS_OUT = 1, 2


@njit(parallel=True, cache=True, **JIT)
def mark_overlay(image0, image1, before, after, channels, motion, spacing, shortest, same, different, marks):
    """Find the pixels that stay as they are although what surrounds them moves.

    Parameters
    ----------
    image0, image1 : (H, W channels)
    before, after : (H, W channels)
        Further frames in which the pixel must be the same.
    channels : int
    motion : (rows, columns, 2) float32
        How the surroundings of each block of `spacing` pixels move from frame 0 to frame 1.
    spacing : int
    shortest : float32
        Motion below which surroundings count as still, pixels.
    same, different : float32
        Differences of colour in the image's own units: at most `same` stays, more than `different` changes.
    marks : (H, W) uint8 out
        STAYS where a pixel keeps its colour; STANDS_OUT where, besides, it would not if it moved; else 0.
    """
    height, width = marks.shape
    for row in prange(height):
        y = np.int64(row)
        change = np.empty(width * channels, np.float32)
        for i in range(width * channels):
            here = np.float32(image0[y, i])
            change[i] = max(
                abs(np.float32(image1[y, i]) - here),
                abs(np.float32(before[y, i]) - here),
                abs(np.float32(after[y, i]) - here),
            )
        for x in range(width):
            largest = np.float32(0)
            for c in range(channels):
                largest = max(largest, change[x * channels + c])
            marks[y, x] = STAYS if largest <= same else 0
        for column in range(motion.shape[1]):
            left, right = column * spacing, min((column + 1) * spacing, width)
            dx, dy = motion[y // spacing, column]
            if max(abs(dx), abs(dy)) < shortest:
                marks[y, left:right] = 0
                continue
            rounded_x, rounded_y = int(np.rint(dx)), int(np.rint(dy))
            for x in range(left, right):
                if marks[y, x] == 0:
                    continue
                # had it moved with its surroundings, its colour would be on this side or that in one of the frames
                stands_out = True
                for sign in (-1, 1):
                    v = min(max(y + sign * rounded_y, 0), height - 1)
                    u = min(max(x + sign * rounded_x, 0), width - 1)
                    for frame in (image0, image1, before, after):
                        apart = np.float32(0)
                        if stands_out:
                            for c in range(channels):
                                here = np.float32(image0[y, x * channels + c])
                                apart = max(apart, abs(np.float32(frame[v, u * channels + c]) - here))
                            stands_out = apart > different
                if stands_out:
                    marks[y, x] = STANDS_OUT
