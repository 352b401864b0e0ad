"""Slow, obvious twins of the kernels; nothing of fpsboost is imported here."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def offsets_from_the_centre(radius: int) -> list[int]:
    """0, 1, -1, -2, 2, 3, -3, -4, 4, ... up to the radius."""
    order = [0]
    for distance in range(1, radius + 1):
        order += [distance, -distance] if distance % 2 else [-distance, distance]
    return order


def box_weights(patch_radius: int) -> Array:
    """(2r + 1, 2r + 1) equal weights that sum to 1."""
    size = 2 * patch_radius + 1
    return np.full((size, size), 1 / size**2)


def gaussian_weights(patch_radius: int) -> Array:
    """(2r + 1, 2r + 1) weights that sum to 1, variance half the size of the similarity area."""
    size = 2 * patch_radius + 1
    weights = np.empty((size, size))
    for y in range(size):
        for x in range(size):
            weights[y, x] = math.exp(-((y - patch_radius) ** 2 + (x - patch_radius) ** 2) / (2 * 0.5 * size))
    return weights / weights.sum()


def pixel_similarity(a: Array, b: Array, v: float) -> Array:
    """The report's xi, a product of one Gaussian a component."""
    return np.exp(-((np.asarray(a, float) - np.asarray(b, float)) ** 2) / (2 * v * v)).prod(axis=-1)


def patch_scores(image0: Array, image1: Array, radius: int, weights: Array, v: float, repeat_target: bool) -> Array:
    """Weighted patch similarity of every pixel of frame 0 under every offset: (H, W, 2 R + 1, 2 R + 1) of [dy, dx].

    Pixels repeat beyond the edges. Targets out of frame 1 score -1, or are compared too with `repeat_target`.
    """
    height, width = image0.shape[:2]
    patch_radius = len(weights) // 2
    near, far = (patch_radius,) * 2, (patch_radius + radius,) * 2
    padded0 = np.pad(image0.astype(float), (near, near, (0, 0)), "edge")
    padded1 = np.pad(image1.astype(float), (far, far, (0, 0)), "edge")
    size = 2 * patch_radius + 1
    scores = np.full((height, width, 2 * radius + 1, 2 * radius + 1), -1.0)
    for y in range(height):
        for x in range(width):
            patch = padded0[y : y + size, x : x + size]
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    if not repeat_target and not (0 <= y + dy < height and 0 <= x + dx < width):
                        continue
                    top, left = y + dy + radius, x + dx + radius
                    other = padded1[top : top + size, left : left + size]
                    scores[y, x, dy + radius, dx + radius] = (weights * pixel_similarity(patch, other, v)).sum()
    return scores


def best_offset(scores: Array, sign: int = 1) -> tuple[Array, Array, Array]:
    """The flow of the best scores, those scores, and by how much each leads over every other offset.

    Offsets are tried from the centre outwards, dy in the outer loop; `sign` -1 tries the opposite offsets.
    """
    height, width, side = scores.shape[:3]
    radius = side // 2
    order = [sign * k for k in offsets_from_the_centre(radius)]
    flow, best, lead = np.zeros((height, width, 2)), np.full((height, width), -1.0), np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            for dy in order:
                for dx in order:
                    if scores[y, x, dy + radius, dx + radius] > best[y, x]:
                        best[y, x] = scores[y, x, dy + radius, dx + radius]
                        flow[y, x] = dx, dy
            second, first = np.sort(scores[y, x].ravel())[-2:]
            lead[y, x] = first - second
    return flow, best, lead


def clamped(value: float, size: int) -> int:
    """Round half up, then clamp to an index."""
    return min(max(math.floor(value + 0.5), 0), size - 1)


def miss(flow: Array, t: float, source: tuple[int, int], target: tuple[int, int]) -> tuple[float, float]:
    """How far a source ``(y, x)`` lands from a target at t: ``(dx, dy)``."""
    dx, dy = flow[source]
    return source[1] + t * float(dx) - target[1], source[0] + t * float(dy) - target[0]


def lands(flow: Array, t: float, source: tuple[int, int], target: tuple[int, int]) -> bool:
    """Whether a source lands within half a pixel of the target."""
    return all(abs(distance) <= 0.5 for distance in miss(flow, t, source, target))


def iterative_search(flow: Array, t: float, iterations: int) -> tuple[Array, Array]:
    """Yang et al.: q <- p - t m(q), from q = p, until q lands on p; else the first iteration's q."""
    height, width = flow.shape[:2]
    source, found = np.zeros((height, width), int), np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            visited = [(y, x)]
            while not lands(flow, t, visited[-1], (y, x)) and len(visited) <= iterations:
                dx, dy = flow[visited[-1]]
                visited.append((clamped(y - t * float(dy), height), clamped(x - t * float(dx), width)))
            found[y, x] = lands(flow, t, visited[-1], (y, x))
            q = visited[-1] if found[y, x] else visited[1]
            source[y, x] = q[0] * width + q[1]
    return source, found


def brute_force_search(flow: Array, t: float, radius: int) -> tuple[Array, Array]:
    """Of all sources within the radius, the one that lands nearest; the first in raster order of several."""
    height, width = flow.shape[:2]
    source, found = np.zeros((height, width), int), np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            nearest = math.inf
            for source_y in range(max(0, y - radius), min(height, y + radius + 1)):
                for source_x in range(max(0, x - radius), min(width, x + radius + 1)):
                    dx, dy = miss(flow, t, (source_y, source_x), (y, x))
                    if dx * dx + dy * dy < nearest:
                        nearest = dx * dx + dy * dy
                        source[y, x] = source_y * width + source_x
                        found[y, x] = lands(flow, t, (source_y, source_x), (y, x))
    return source, found


def landing_cells(flow: Array, t: float) -> list[list[int]]:
    """The sources that land on each pixel, in raster order; landings out of the frame count for the nearest pixel."""
    height, width = flow.shape[:2]
    cells: list[list[int]] = [[] for _ in range(height * width)]
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x]
            cell = clamped(y + t * float(dy), height) * width + clamped(x + t * float(dx), width)
            cells[cell].append(y * width + x)
    return cells


def fetched(
    image0: Array, image1: Array, t: float, source0: Array, found0: Array, source1: Array, found1: Array
) -> Array:
    """Both sources blended in time, or the only one that was found; not rounded."""
    height, width, channels = image0.shape
    out = np.empty(image0.shape)
    for y in range(height):
        for x in range(width):
            a = image0.reshape(-1, channels)[source0[y, x]].astype(float)
            b = image1.reshape(-1, channels)[source1[y, x]].astype(float)
            if found0[y, x] and not found1[y, x]:
                out[y, x] = a
            elif found1[y, x] and not found0[y, x]:
                out[y, x] = b
            else:
                out[y, x] = (1 - t) * a + t * b
    return out


def splatted(flow: Array, similarity: Array, sign: float, t: float, motion: Array, score: Array) -> None:
    """Every vector on the four pixels around its landing, the most similar staying, 0.05 off a squared pixel away."""
    height, width = flow.shape[:2]
    for y in range(height):
        for x in range(width):
            landing_x, landing_y = x + t * float(flow[y, x, 0]), y + t * float(flow[y, x, 1])
            for target_y in (math.floor(landing_y), math.floor(landing_y) + 1):
                for target_x in (math.floor(landing_x), math.floor(landing_x) + 1):
                    if not (0 <= target_y < height and 0 <= target_x < width):
                        continue
                    squared = (landing_x - target_x) ** 2 + (landing_y - target_y) ** 2
                    value = float(similarity[y, x]) - 0.05 * squared
                    if value > score[target_y, target_x]:
                        score[target_y, target_x] = value
                        motion[target_y, target_x] = sign * flow[y, x]


def catmull_rom(before: Array, at: Array, after: Array, behind: Array, f: float) -> Array:
    """The Catmull-Rom spline through four values, a share f of the way between the two in the middle."""
    slope0, slope1 = (after - before) / 2, (behind - at) / 2
    return (
        (2 * f**3 - 3 * f**2 + 1) * at
        + (f**3 - 2 * f**2 + f) * slope0
        + (3 * f**2 - 2 * f**3) * after
        + (f**3 - f**2) * slope1
    )


def sampled(image: Array, y: float, x: float) -> Array:
    """The image at a place between its pixels, edges repeated: one spline across each of four rows, one down."""
    height, width = image.shape[:2]
    top, left = math.floor(y), math.floor(x)

    def pixel(row: int, column: int) -> Array:
        return image[min(max(row, 0), height - 1), min(max(column, 0), width - 1)].astype(float)

    rows = [catmull_rom(*(pixel(top + j, left + i) for i in (-1, 0, 1, 2)), x - left) for j in (-1, 0, 1, 2)]
    return catmull_rom(*rows, y - top)


def blended(image0: Array, image1: Array, motion: Array, t: float) -> Array:
    """Both frames along the motion through each pixel, or the one whose end lies inside; not rounded."""
    height, width = image0.shape[:2]
    out = np.empty(image0.shape)
    for y in range(height):
        for x in range(width):
            dx, dy = (float(value) for value in motion[y, x])
            ends = (y - t * dy, x - t * dx), (y + (1 - t) * dy, x + (1 - t) * dx)
            inside0, inside1 = (0 <= end[0] <= height - 1 and 0 <= end[1] <= width - 1 for end in ends)
            weight = t if inside0 == inside1 else float(inside1)
            out[y, x] = (1 - weight) * sampled(image0, *ends[0]) + weight * sampled(image1, *ends[1])
    return out


def uncompiled(kernel):
    """The plain function behind a kernel, also where NUMBA_DISABLE_JIT has left it plain."""
    return getattr(kernel, "py_func", kernel)
