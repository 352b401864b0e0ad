"""Both frames sampled along one motion per pixel of the frame between them, as a renderer's vectors give it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.spline import MARGIN, spline_weights


class Source(NamedTuple):
    """One of the two frames, as seen from the frame between them."""

    coefficients: NDArray[Any]
    """Spline coefficients, (C, H + 2 MARGIN, W + 2 MARGIN or more) float32; see `fpsboost.kernels.spline`."""
    motion: NDArray[Any]
    """Motion from each pixel of the frame between to this frame, (H, W, 2) float32."""
    is_visible: NDArray[Any]
    """Whether this frame shows the surface that the pixel belongs to, (H, W) bool."""


@njit(**FINITE_JIT)
def locate(source, i, j):
    """Return the first of the 4 x 4 coefficients around the end of a pixel's motion, and their weights in y and x.

    Beyond the frame, edges are repeated.
    """
    height, width, _ = source.motion.shape
    margin, beyond = np.float32(MARGIN), np.float32(-1)
    y = min(max(np.float32(i) + source.motion[i, j, 1], beyond), np.float32(height)) + margin
    x = min(max(np.float32(j) + source.motion[i, j, 0], beyond), np.float32(width)) + margin
    top, left = int(y), int(x)
    return top - 1, left - 1, spline_weights(y - np.float32(top)), spline_weights(x - np.float32(left))


@njit(**FINITE_JIT)
def sample_spline(plane, place):
    """Return the value of a plane of coefficients at a position; see `locate`."""
    top, left, down, across = place
    value = np.float32(0)
    for j in range(4):
        row, part = plane[top + j], np.float32(0)
        for i in range(4):
            part = fma(across[i], row[left + i], part)
        value = fma(down[j], part, value)
    return value


@njit(cache=True, **FINITE_JIT)
def mix_along(source0, source1, t, mixed, squared):
    """Mix both frames in time along their motions; a frame that does not show the surface has no weight.

    Parameters
    ----------
    source0, source1 : Source
    t : float32
        Weight of frame 1 where both are visible, or none is.
    mixed : (C, H, W) float32 out
    squared : (H, W) float32 out
        Squared difference of the two frames, summed over the planes; 0 where one of them is not visible.
    """
    channels, height, width = mixed.shape
    for i, j in np.ndindex(height, width):
        seen0, seen1 = source0.is_visible[i, j], source1.is_visible[i, j]
        share = t if seen0 == seen1 else np.float32(seen1)
        place0, place1 = locate(source0, i, j), locate(source1, i, j)
        distance = np.float32(0)
        for c in range(channels):
            value = sample_spline(source0.coefficients[c], place0)
            difference = sample_spline(source1.coefficients[c], place1) - value
            mixed[c, i, j] = fma(share, difference, value)
            distance = fma(difference, difference, distance)
        squared[i, j] = distance if seen0 and seen1 else np.float32(0)
