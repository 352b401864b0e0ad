"""Kernels on the vectors of points several pixels apart: forward-backward error, gradients and accelerations."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import FINITE_JIT, JIT, njit


@njit(inline="always", **FINITE_JIT)
def minmod(before, after):
    """Return the smaller in magnitude of two numbers of the same sign, else 0; without branches, which could not be
    predicted.
    """
    nothing = np.float32(0)
    return max(min(before, after), nothing) + min(max(before, after), nothing)


@njit(cache=True, **FINITE_JIT)
def find_gradients(vectors, spacing, gradients):
    """Write the gradients of vectors along both axes, using the minmod limiter; 0 at the ends of an axis.

    - `vectors`: (rows, columns, 2) float32, `spacing` pixels apart
    - `gradients`: of dx and dy along x, then along y, pixels per pixel, (rows, columns, 2, 2) float32 out
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
def forward_backward_vector_error(dx, dy, back, spacing, height, width, y, x):
    """Return the forward-backward error of a pixel's vector, and whether the vector ends within the frame."""
    landing_y, landing_x = np.rint(np.float64(y) + dy), np.rint(np.float64(x) + dx)
    nearest_y, nearest_x = min(max(int(landing_y), 0), height - 1), min(max(int(landing_x), 0), width - 1)
    row, column = nearest_y // spacing, nearest_x // spacing
    apart_x, apart_y = np.float64(dx + back[row, column, 0]), np.float64(dy + back[row, column, 1])
    inside = 0 <= landing_y < height and 0 <= landing_x < width
    return np.float32(math.sqrt(apart_x * apart_x + apart_y * apart_y)), inside


@njit(cache=True, **JIT)
def measure_forward_backward_errors(vectors, y, x, back, spacing, height, width, distance):
    """Measure the forward-backward error of vectors.

    - `vectors`: motion of the pixels in rows `y` and columns `x`, (rows, columns, 2) float32
    - `y`, `x`: (rows,), (columns,) int64
    - `back`: motion of the other frame, one vector for `spacing` x `spacing` pixels, (points down, points across, 2)
      float32; its edges are repeated
    - `distance`: pixels, (rows, columns) float32 out
    """
    for i in range(y.size):
        for j in range(x.size):
            distance[i, j], _ = forward_backward_vector_error(
                vectors[i, j, 0], vectors[i, j, 1], back, spacing, height, width, y[i], x[j]
            )


class RoundTrip(NamedTuple):
    """Motion to another frame and back, both (points down, points across, 2) float32."""

    there: NDArray[Any]
    back: NDArray[Any]


class FieldLayout(NamedTuple):
    """Layout of motion fields that have one vector for `spacing` x `spacing` pixels of a frame."""

    spacing: int
    height: int
    width: int


@njit(cache=True, **JIT)
def find_accelerations(onward, away, layout, y, x, ratio, consistent, changes):
    """Estimate the acceleration at the frame that two neighbouring pairs share.

    - `onward`, `away`: motion from the shared frame to the other frame of the pair, and to that of the neighbouring
      pair
    - `y`, `x`: rows and columns of the points, (rows,), (columns,) int64
    - `ratio`: duration of the neighbouring pair divided by that of the pair
    - `consistent`: maximum forward-backward error of a valid vector, pixels; a valid vector also ends within the frame
    - `changes`: 1 where both vectors are valid, and the acceleration, pixels per interval squared; else 0; (rows,
      columns, 3) float32 out
    """
    (there, back), (far_there, far_back), (spacing, height, width) = onward, away, layout
    # x(1) = v + a / 2 and x(-r) = -r v + r^2 a / 2
    duration, factor = np.float32(ratio), np.float32(2 / (ratio + ratio * ratio))
    changes[:] = 0
    for i in range(y.size):
        for j in range(x.size):
            row, column = y[i] // spacing, x[j] // spacing
            dx, dy = there[row, column, 0], there[row, column, 1]
            far_x, far_y = far_there[row, column, 0], far_there[row, column, 1]
            error, inside = forward_backward_vector_error(dx, dy, back, spacing, height, width, y[i], x[j])
            far_error, far_inside = forward_backward_vector_error(
                far_x, far_y, far_back, spacing, height, width, y[i], x[j]
            )
            if inside and far_inside and error <= consistent and far_error <= consistent:
                changes[i, j, 0] = 1
                changes[i, j, 1] = (dx * duration + far_x) * factor
                changes[i, j, 2] = (dy * duration + far_y) * factor
