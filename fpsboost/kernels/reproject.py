"""Source pixels of an in-between pixel: the report's two searches (section 3), and splatting as in video coding.

In all kernels, `flow` is the motion of the source frame, (H, W, 2) float32, and `t` the distance in time from it, in
intervals. Sources are written as ``y * W + x``, (H, W) int32, and `lands`, (H, W) bool, tells whether a source lands on
the target pixel.
"""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.jit import JIT, njit

NO_SOURCE = -1
MAX_FLOAT32 = np.float32(np.finfo(np.float32).max)


@njit(**JIT)
def nearest_inside(value, size):
    """Return a value rounded half up and clamped to an index."""
    return min(max(int(np.floor(value + np.float32(0.5))), 0), size - 1)


@njit(**JIT)
def step_back(target, motion, size):
    """Return the pixel from which a motion leads to the target; half pixels round towards the target.

    The result is clamped to an index. A motion and its opposite therefore have the same length, and frame 0 and frame 1
    the same influence.
    """
    distance = np.int64(np.ceil(np.float32(min(abs(motion), np.float32(size))) - np.float32(0.5)))
    return min(max(target - distance if motion > 0 else target + distance, 0), size - 1)


@njit(**JIT)
def landing_error(flow, t, source_y, source_x, y, x):
    """Return the offset ``(dx, dy)`` of the source's landing position at time t from the target."""
    return (
        np.float32(source_x) + t * flow[source_y, source_x, 0] - np.float32(x),
        np.float32(source_y) + t * flow[source_y, source_x, 1] - np.float32(y),
    )


@njit(cache=True, **JIT)
def search_iteratively(flow, t, iterations, source, lands):
    """Search the source pixels by fixed-point iteration (Yang et al. 2011): q <- p - t m(q), until q lands on p.

    The iteration starts from q = p. Without success, the result of the first of the iterations is used.
    """
    height, width = flow.shape[:2]
    half = np.float32(0.5)
    for y in range(height):
        for x in range(width):
            source_y, source_x = y, x
            first = 0
            success = False
            for iteration in range(iterations):
                dx, dy = flow[source_y, source_x, 0], flow[source_y, source_x, 1]
                source_x = step_back(x, t * dx, width)
                source_y = step_back(y, t * dy, height)
                if iteration == 0:
                    first = source_y * width + source_x
                miss_x, miss_y = landing_error(flow, t, source_y, source_x, y, x)
                if abs(miss_x) <= half and abs(miss_y) <= half:
                    success = True
                    break
            source[y, x] = source_y * width + source_x if success else first
            lands[y, x] = success


@njit(cache=True, **JIT)
def bin_landings(flow, t, starts, members):
    """Sort all source pixels by the pixel on which they land at time t: a counting sort, in raster order within a cell.

    Landing positions outside of the frame are assigned to the nearest cell inside. The members of cell c, pixels as ``y
    * W + x``, are ``members[starts[c]:starts[c + 1]]``, (H * W,) and (H * W + 1,) int32 out.
    """
    height, width = flow.shape[:2]
    starts[:] = 0
    cells = np.empty(height * width, np.int32)
    for y in range(height):
        for x in range(width):
            cell_x = nearest_inside(np.float32(x) + t * flow[y, x, 0], width)
            cell_y = nearest_inside(np.float32(y) + t * flow[y, x, 1], height)
            cell = cell_y * width + cell_x
            cells[y * width + x] = cell
            starts[cell + 1] += 1
    for cell in range(height * width):
        starts[cell + 1] += starts[cell]
    cursor = starts[:-1].copy()
    for pixel in range(height * width):
        cell = cells[pixel]
        members[cursor[cell]] = pixel
        cursor[cell] += 1


@njit(cache=True, **JIT)
def search_nearest_landing(flow, t, search_radius, starts, members, source, lands):
    """Search all sources within the radius, along x and y, for the one that lands nearest to the target: exact brute
    force.

    Cells of `bin_landings` are visited in square rings around the target until no further ring can hold a nearer
    landing position, so that the cost depends on how evenly the landing positions are distributed and not on the
    radius. Of sources that land equally near, the one nearest to the target wins, whatever the direction of the motion,
    and of several such sources the first in raster order.
    """
    height, width = flow.shape[:2]
    half = np.float32(0.5)
    for y in range(height):
        for x in range(width):
            nearest, shortest = MAX_FLOAT32, np.int64(0)
            winner = y * width + x
            for ring in range(max(height, width)):
                # minimum distance in x or in y of a landing position in this ring
                bound = np.float32(max(0.0, ring - 0.5))
                if bound * bound > nearest:
                    break
                for cell_y in range(max(0, y - ring), min(height - 1, y + ring) + 1):
                    step = 1 if ring == 0 or abs(cell_y - y) == ring else 2 * ring
                    for cell_x in range(x - ring, x + ring + 1, step):
                        if cell_x < 0 or cell_x >= width:
                            continue
                        cell = cell_y * width + cell_x
                        for k in range(starts[cell], starts[cell + 1]):
                            pixel = members[k]
                            source_y, source_x = pixel // width, pixel % width
                            if abs(source_y - y) > search_radius or abs(source_x - x) > search_radius:
                                continue
                            miss_x, miss_y = landing_error(flow, t, source_y, source_x, y, x)
                            distance = miss_x * miss_x + miss_y * miss_y
                            length = (source_y - y) ** 2 + (source_x - x) ** 2
                            nearer_source = length < shortest or (length == shortest and pixel < winner)
                            if distance < nearest or (distance == nearest and nearer_source):
                                nearest, shortest = distance, length
                                winner = pixel
            source[y, x] = winner
            miss_x, miss_y = landing_error(flow, t, winner // width, winner % width, y, x)
            lands[y, x] = abs(miss_x) <= half and abs(miss_y) <= half


@njit(cache=True, **JIT)
def fetch_both(image0, image1, t, half, source0, lands0, source1, lands1, out):
    """Write the colour of every target: both sources blended in time, or the only source that lands on it.

    The images and the output are (H, W, C) of one type; `half` is 0.5 to round integers, else 0.
    """
    height, width, channels = image0.shape
    for y in range(height):
        for x in range(width):
            weight = t
            if lands0[y, x] and not lands1[y, x]:
                weight = np.float32(0)
            elif lands1[y, x] and not lands0[y, x]:
                weight = np.float32(1)
            y0, x0 = source0[y, x] // width, source0[y, x] % width
            y1, x1 = source1[y, x] // width, source1[y, x] % width
            for c in range(channels):
                value = (np.float32(1) - weight) * np.float32(image0[y0, x0, c]) + weight * np.float32(
                    image1[y1, x1, c]
                )
                out[y, x, c] = out.dtype.type(value + half)


@njit(cache=True, **JIT)
def splat(flow, similarity, least_similarity, t, source0, source1):
    """Find the most similar pixel that lands on each target at time t, and its position in both frames.

    Where no pixel of at least that similarity, (H, W) float32, lands, both positions are the target itself. Of equally
    similar pixels, the first in raster order is found; its position in frame 1 is clamped to the frame.
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
