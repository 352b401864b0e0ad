"""Forward splatting of pixels along their motion, as in video coding (section 2.1 of the report)."""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.jit import JIT, njit
from fpsboost.kernels.reproject import nearest_inside

NO_SOURCE = -1


@njit(cache=True, **JIT)
def splat(flow, similarity, least_similarity, t, source0, source1):
    """Find the most similar pixel that lands on each target at time t, and its position in both frames.

    Where no pixel lands, both positions are the target itself. The kernel runs in one thread, as a pass over the frame
    is cheap.

    Parameters
    ----------
    flow : (H, W, 2) float32
    similarity : (H, W) float32
    least_similarity : float32
        Minimum similarity of a pixel that is splatted.
    t : float32
    source0 : (H, W) int32
        Out: ``y * W + x`` of the pixel in frame 0, the first of several in raster order.
    source1 : (H, W) int32
        Out: the pixel of frame 1 to which it moves, clamped to the frame.
    """
    height, width = similarity.shape
    half = np.float32(0.5)
    source0[:] = NO_SOURCE
    for y in range(height):
        for x in range(width):
            if not similarity[y, x] >= least_similarity:
                continue
            place_y = np.floor(np.float32(y) + t * flow[y, x, 1] + half)
            place_x = np.floor(np.float32(x) + t * flow[y, x, 0] + half)
            if not (place_y >= 0 and place_y < height and place_x >= 0 and place_x < width):
                continue
            target_y, target_x = int(place_y), int(place_x)
            other = source0[target_y, target_x]
            if other == NO_SOURCE or similarity[y, x] > similarity[other // width, other % width]:
                source0[target_y, target_x] = y * width + x
    for y in range(height):
        for x in range(width):
            pixel = source0[y, x]
            if pixel == NO_SOURCE:
                source0[y, x] = source1[y, x] = y * width + x
                continue
            y0, x0 = pixel // width, pixel % width
            y1 = nearest_inside(np.float32(y0) + flow[y0, x0, 1], height)
            x1 = nearest_inside(np.float32(x0) + flow[y0, x0, 0], width)
            source1[y, x] = y1 * width + x1
