"""What the vectors of points some pixels apart say together: whether they come back, and how they change."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT, JIT


@njit(inline="always", **FINITE_JIT)
def minmod(before, after):
    """The smaller one of two numbers of one sign, else 0; without branches, which nobody could foretell."""
    nothing = np.float32(0)
    return max(min(before, after), nothing) + min(max(before, after), nothing)


@njit(cache=True, **FINITE_JIT)
def find_gradients(vectors, spacing, gradients):
    """How vectors change along both axes, by the minmod limiter; 0 at the ends of an axis.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
    spacing : float32
        Distance of the points, pixels.
    gradients : (rows, columns, 2, 2) float32 out
        Along x, of dx and dy, then along y; pixels per pixel.
    """
    rows, columns, _ = vectors.shape
    gradients[:] = 0
    for i in range(rows):
        for j in range(columns):
            for axis in range(2):
                here = vectors[i, j, axis]
                if 0 < j < columns - 1:
                    before, after = here - vectors[i, j - 1, axis], vectors[i, j + 1, axis] - here
                    gradients[i, j, 0, axis] = minmod(before / spacing, after / spacing)
                if 0 < i < rows - 1:
                    before, after = here - vectors[i - 1, j, axis], vectors[i + 1, j, axis] - here
                    gradients[i, j, 1, axis] = minmod(before / spacing, after / spacing)


@njit(inline="always", **JIT)
def trip(dx, dy, back, y, x):
    """How far from its beginning a pixel's vector ends, there and back, and whether it leads into the frame."""
    height, width, _ = back.shape
    landing_y, landing_x = np.rint(np.float64(y) + dy), np.rint(np.float64(x) + dx)
    nearest_y, nearest_x = min(max(int(landing_y), 0), height - 1), min(max(int(landing_x), 0), width - 1)
    apart_x, apart_y = np.float64(dx + back[nearest_y, nearest_x, 0]), np.float64(dy + back[nearest_y, nearest_x, 1])
    inside = 0 <= landing_y < height and 0 <= landing_x < width
    return np.float32(math.sqrt(apart_x * apart_x + apart_y * apart_y)), inside


@njit(cache=True, **JIT)
def measure_trips(vectors, y, x, back, distance):
    """How far from where they began vectors end, there and back.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
        Motion of the pixels in rows `y` and columns `x`.
    y, x : (rows,), (columns,) int64
    back : (H, W, 2) float32
        Motion of the other frame; beyond its edges as at them.
    distance : (rows, columns) float32 out
        Pixels.
    """
    for i in range(y.size):
        for j in range(x.size):
            distance[i, j], _ = trip(vectors[i, j, 0], vectors[i, j, 1], back, y[i], x[j])


@njit(cache=True, **JIT)
def find_accelerations(there, back, away, away_back, y, x, ratio, consistent, changes):
    """How motion changes at the frame that two pairs share.

    Parameters
    ----------
    there, back : (H, W, 2) float32
        Motion from the shared frame to the other one of the pair, and back.
    away, away_back : (H, W, 2) float32
        The same to the other frame of the neighbouring pair.
    y, x : (rows,), (columns,) int64
        Rows and columns of the points.
    ratio : float
        Duration of the neighbouring pair over that of the pair.
    consistent : float32
        A vector counts if it leads into the frame and the way there and back ends this near to where it began, pixels.
    changes : (rows, columns, 3) float32 out
        1 where both vectors count, and the acceleration, pixels per interval squared; else 0.
    """
    # x(1) = v + a / 2 and x(-r) = -r v + r^2 a / 2
    duration, factor = np.float32(ratio), np.float32(2 / (ratio + ratio * ratio))
    changes[:] = 0
    for i in range(y.size):
        for j in range(x.size):
            dx, dy = there[y[i], x[j], 0], there[y[i], x[j], 1]
            away_x, away_y = away[y[i], x[j], 0], away[y[i], x[j], 1]
            apart, inside = trip(dx, dy, back, y[i], x[j])
            away_apart, away_inside = trip(away_x, away_y, away_back, y[i], x[j])
            if inside and away_inside and apart <= consistent and away_apart <= consistent:
                changes[i, j, 0] = 1
                changes[i, j, 1] = (dx * duration + away_x) * factor
                changes[i, j, 2] = (dy * duration + away_y) * factor
