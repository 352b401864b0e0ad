"""Motion moved to an in-between time, and both frames fetched along it."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import JIT

SPREAD_PENALTY = np.float32(0.05)
"""What a landing loses in similarity for each squared pixel between it and the pixel it is written to."""


@njit(cache=True, **JIT)
def splat_motion(flow, similarity, sign, t, motion, score):
    """Carry motion vectors forward to time t: each lands on four pixels, the most similar stays.

    Parameters
    ----------
    flow : (H, W, 2) float32
        Motion of the source frame.
    similarity : (H, W) float32
    sign : float32
        1 for the flow of frame 0, -1 for the flow of frame 1: what is written always leads from frame 0 to frame 1.
    t : float32
        Distance in time from the source frame, in intervals.
    motion : (H, W, 2) float32
        In and out.
    score : (H, W) float32
        In and out; negative where nothing has landed yet.
    """
    height, width = flow.shape[:2]
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            landing_x, landing_y = np.float32(x) + t * dx, np.float32(y) + t * dy
            left, top = int(np.floor(landing_x)), int(np.floor(landing_y))
            for target_y in range(max(top, 0), min(top + 2, height)):
                for target_x in range(max(left, 0), min(left + 2, width)):
                    off_x, off_y = landing_x - np.float32(target_x), landing_y - np.float32(target_y)
                    value = similarity[y, x] - SPREAD_PENALTY * (off_x * off_x + off_y * off_y)
                    if value > score[target_y, target_x]:
                        score[target_y, target_x] = value
                        motion[target_y, target_x, 0] = sign * dx
                        motion[target_y, target_x, 1] = sign * dy


@njit(**JIT)
def cubic_weights(fraction):
    """Weights of the four neighbours, Catmull-Rom: Keys 1981 with a = -1/2 (doi:10.1109/TASSP.1981.1163711)."""
    f = fraction
    one, half = np.float32(1), np.float32(0.5)
    g = one - f
    return (
        -half * f * g * g,
        one + half * f * f * (np.float32(3) * f - np.float32(5)),
        one + half * g * g * (np.float32(3) * g - np.float32(5)),
        -half * g * f * f,
    )


@njit(**JIT)
def add_cubic(image, y, x, weight, sums):
    """Add the image's value at a place between its pixels, times a weight, to one sum a channel; edges repeat."""
    height, width, channels = image.shape
    left, top = int(np.floor(x)), int(np.floor(y))
    across = cubic_weights(x - np.float32(left))
    down = cubic_weights(y - np.float32(top))
    for j in range(4):
        row = min(max(top + j - 1, 0), height - 1)
        row_weight = weight * down[j]
        for i in range(4):
            column = min(max(left + i - 1, 0), width - 1)
            tap = row_weight * across[i]
            for c in range(channels):
                sums[c] += tap * np.float32(image[row, column, c])


@njit(parallel=True, cache=True, **JIT)
def blend_along(image0, image1, motion, t, half, lowest, highest, out):
    """Fetch both frames along the motion through each pixel and blend them in time.

    Where one end lies outside of its frame, the other end is taken alone.

    Parameters
    ----------
    image0, image1 : (H, W, C)
    motion : (H, W, 2) float32
        From frame 0 to frame 1, through each pixel at time t.
    t : float32
    half : float32
        0.5 where the output is rounded to integers, else 0.
    lowest, highest : float32
        Range of the output: cubic weights overshoot.
    out : (H, W, C), dtype of the images
    """
    height, width, channels = image0.shape
    for y in prange(height):
        sums = np.empty(channels, np.float32)
        for x in range(width):
            dx, dy = motion[y, x, 0], motion[y, x, 1]
            x0, y0 = np.float32(x) - t * dx, np.float32(y) - t * dy
            x1, y1 = x0 + dx, y0 + dy
            inside0 = x0 >= 0 and y0 >= 0 and x0 <= width - 1 and y0 <= height - 1
            inside1 = x1 >= 0 and y1 >= 0 and x1 <= width - 1 and y1 <= height - 1
            weight = t
            if inside0 and not inside1:
                weight = np.float32(0)
            elif inside1 and not inside0:
                weight = np.float32(1)
            sums[:] = half
            if weight < 1:
                add_cubic(image0, y0, x0, np.float32(1) - weight, sums)
            if weight > 0:
                add_cubic(image1, y1, x1, weight, sums)
            for c in range(channels):
                out[y, x, c] = out.dtype.type(min(max(sums[c], lowest), highest))
