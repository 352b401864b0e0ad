"""A motion field: one vector and one similarity a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.points import find_gradients, measure_trips


@dataclass(frozen=True, slots=True)
class MotionField:
    """Motion of every pixel of one frame towards another.

    Attributes
    ----------
    flow : (H, W, 2) float32
        ``(dx, dy)`` in pixels; the direction is in the variable's name (``field01``, ``field10``).
    similarity : (H, W) float32
        How alike the patches at both ends are, in [0, 1]; 1 everywhere where an estimator does not know.
    search_radius : int or None
        Largest motion that was searched for, pixels in x and in y, where an estimator chose it for these frames.
    """

    flow: NDArray[Any]
    similarity: NDArray[Any]
    search_radius: int | None = None


def point_places(size: tuple[int, ...], spacing: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows and columns of points `spacing` apart, the first at spacing / 2 and the last within the frame."""
    height, width = size[:2]
    y, x = (np.minimum(np.arange(0, length, spacing) + spacing // 2, length - 1) for length in (height, width))
    return y, x


def at_points(flow: NDArray[Any], spacing: int) -> NDArray[Any]:
    """What the pixels at points `spacing` apart have; see `point_places`.

    Parameters
    ----------
    flow : (H, W, 2) or (H, W)
    spacing : int
        Pixels.

    Returns
    -------
    (rows, columns, 2) or (rows, columns)
    """
    y, x = point_places(flow.shape, spacing)
    points: NDArray[Any] = flow.take(y, axis=0).take(x, axis=1)  # six times as fast as both at once
    return points


def round_trip(vectors: NDArray[Any], y: NDArray[Any], x: NDArray[Any], back: NDArray[Any]) -> NDArray[Any]:
    """How far from where they began vectors end, there and back.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
        Motion of the pixels in rows `y` and columns `x`.
    y : (rows,) int
    x : (columns,) int
    back : (H, W, 2) float32
        Motion of the other frame; beyond its edges as at them.

    Returns
    -------
    (rows, columns) float32
        Pixels.
    """
    distance = np.empty(vectors.shape[:2], np.float32)
    measure_trips(vectors, y, x, back, distance)
    return distance


def motion_gradients(vectors: NDArray[Any], spacing: int) -> NDArray[Any]:
    """How motion changes from pixel to pixel around points: by zoom, rotation and perspective, not from thing to thing.

    Of the differences from the neighbours on both sides the smaller one where they have one sign, else none (the minmod
    limiter; Roe 1986, doi:10.1146/annurev.fl.18.010186.002005): at the edge of an object one of them is large.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
    spacing : int
        Distance of the points, pixels.

    Returns
    -------
    (rows, columns, 2, 2) float32
        Along x, of dx and dy, then along y; pixels per pixel.
    """
    gradients = np.empty((*vectors.shape, 2), np.float32)
    find_gradients(vectors, np.float32(spacing), gradients)
    return gradients
